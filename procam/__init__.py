"""procam: calibrates projection domes with cameras and removes the light that bounces round them."""

__version__ = "0.1.0"

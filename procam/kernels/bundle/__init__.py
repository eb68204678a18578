"""Normal equations of the bundle adjustment: camera ray, screen, projector pixel."""

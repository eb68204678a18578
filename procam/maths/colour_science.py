"""The door to colour-science, which takes a second to import and changes how NumPy prints."""

from types import ModuleType

import numpy as np


def colour_science() -> ModuleType:
    """The library `colour`, imported at first use; NumPy goes on printing as it did."""
    with np.printoptions():
        import colour  # noqa: PLC0415
    return colour

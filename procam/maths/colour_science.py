"""Lazy import of colour-science, which takes a second and changes NumPy's print options."""

from types import ModuleType

import numpy as np


def colour_science() -> ModuleType:
    """The library `colour`, imported at first use; NumPy's print options are restored."""
    with np.printoptions():
        import colour  # noqa: PLC0415
    return colour

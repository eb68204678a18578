"""Types of arrays, one name each, for signatures in every package.

A docstring gives the shape and unit; the type gives the kind of number. `Image` and `Map` are the
same type as `Array32` and say what it holds: samples of a picture, or a plane over the dome's master
picture.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

AnyArray = NDArray[Any]
Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.floating[Any]]
Image = Array32
IndexArray = NDArray[np.intp]
Map = Array32

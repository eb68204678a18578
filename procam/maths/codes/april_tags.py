"""AprilTags in pictures, by OpenCV (Olson, ICRA 2011, doi:10.1109/ICRA.2011.5979561)."""

from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray

TAG_SETS: dict[str, int] = {
    "36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "16h5": cv2.aruco.DICT_APRILTAG_16h5,
}
MIN_TAG_PX = 10.0  # edge, in the photograph
WINDOWS_PX = (7, 47, 20)  # of the adaptive threshold: smallest, largest, step
CORRECTED_SHARE = 0.4  # of the bits a family can correct: two for 36h11, none for 16h5


def find_tags(
    grey: NDArray[np.uint8], family: str, scale: int = 1, least_px: float = MIN_TAG_PX
) -> list[tuple[int, Array]]:
    """IDs and corners (4, 2) [px] of the AprilTags in a picture (H, W); corners to half a pixel.

    The corners go round each tag from its own top left. The search enlarges the picture `scale` times:
    2 finds tags of half the size. Edges of less than `least_px` of the enlarged picture are no tags, nor are
    mirrored ones.
    """
    if scale > 1:
        size = (scale * grey.shape[1], scale * grey.shape[0])
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    settings = cv2.aruco.DetectorParameters()
    settings.adaptiveThreshWinSizeMin, settings.adaptiveThreshWinSizeMax = WINDOWS_PX[:2]
    settings.adaptiveThreshWinSizeStep = WINDOWS_PX[2]
    settings.adaptiveThreshConstant = 5
    # without this limit every speck of noise is tried as a tag, which takes seconds per photograph
    settings.minMarkerPerimeterRate = 4 * least_px * scale / max(grey.shape)
    settings.errorCorrectionRate = CORRECTED_SHARE
    settings.perspectiveRemovePixelPerCell = 8
    found = cv2.aruco.ArucoDetector(_tag_set(family), settings).detectMarkers(grey)
    corners, ids = found[0], () if found[1] is None else found[1]
    places = [(np.asarray(c, float).reshape(-1, 2) + 0.5) / scale - 0.5 for c in corners]
    return [(int(n), place) for n, place in zip(np.ravel(ids), places, strict=True)]


def tag_cells(family: str, number: int) -> BoolArray:
    """Which cells (N, N) of an AprilTag are white, its black border included.

    >>> tag_cells("16h5", 3).shape
    (6, 6)
    """
    tags = _tag_set(family)
    return np.asarray(cv2.aruco.generateImageMarker(tags, number, tags.markerSize + 2) > 0)


@cache
def _tag_set(family: str) -> Any:
    return cv2.aruco.getPredefinedDictionary(TAG_SETS[family])

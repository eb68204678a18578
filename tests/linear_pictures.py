"""Pictures of linear light in files."""

from pathlib import Path

import numpy as np

from procam.arrays import Image
from procam.files.images.layers import RGB
from procam.files.images.pixels import write_image
from procam.maths.light.curves import srgb_encode


def write_picture(path: Path, linear: Image) -> None:
    """Write linear light (H, W, 3): EXR as is, PNG and TIFF as 16-bit sRGB."""
    if path.suffix == ".exr":
        write_image(path, linear.astype(np.float32), RGB)
        return
    encoded = np.rint(srgb_encode(np.clip(linear, 0, 1)) * 65535)
    write_image(path, encoded.astype(np.uint16))

"""The README's picture and what its demo prints: `procam demo`, before and after, beside what was meant.

Writes docs/before-after.png, of the pictures of the demo's report, and prints the demo's text;
`python -m studies readme` remakes them in two minutes.
"""

import io
import subprocess
import sys
import tempfile
from base64 import b64decode
from pathlib import Path

from matplotlib import pyplot as plt

from procam.interfaces.report.blocks import Pictures, ScreenPicture
from procam.interfaces.report.data import read_material
from procam.interfaces.report.light import pictures

PICTURE = Path(__file__).parents[1] / "docs" / "before-after.png"
BACKGROUND = "#11141b"


def main() -> None:
    """Run the demo and draw its dome masters."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "procam", "demo", "--out", folder], check=True)
        (row,) = pictures(read_material(Path(folder)))
        assert isinstance(row, Pictures)
        draw(row.groups[0].pictures)


def draw(domes: list[ScreenPicture], path: Path = PICTURE) -> None:
    """Draw dome masters of a report beside each other."""
    figure, axes = plt.subplots(1, len(domes), figsize=(11.4, 4.2), facecolor=BACKGROUND)
    figure.subplots_adjust(left=0.005, right=0.995, bottom=0.02, top=0.88, wspace=0.03)
    for axis, dome in zip(axes, domes, strict=True):
        axis.imshow(plt.imread(io.BytesIO(b64decode(dome.image.partition(",")[2]))))
        axis.set_title(dome.title.lower(), color="white", fontsize=16)
        axis.axis("off")
    figure.savefig(path, facecolor=BACKGROUND, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    main()

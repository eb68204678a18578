"""The README's picture and what its demo prints: `procam demo`, before and after, beside what was meant.

Writes docs/before-after.png and prints the demo's text; `python -m studies readme` remakes them in two
minutes.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from procam.arrays import Image
from procam.interfaces.report.data import read_material

PICTURE = Path(__file__).parents[1] / "docs" / "before-after.png"
BACKGROUND, DPI = "#11141b", 100
BRIGHTEST = (
    1.25  # light of white that is drawn as white: before, the dome is brighter than it was meant
)
GAMMA = 2.2


def main() -> None:
    """Run the demo and draw its dome masters."""
    with tempfile.TemporaryDirectory() as folder:
        run = [sys.executable, "-m", "procam", "demo", "--out", folder]
        subprocess.run(run, check=True)
        seen = read_material(Path(folder)).before_after()
        assert seen is not None and seen.source == "simulator"
        draw({"before": seen.before, "after": seen.after, "intended": seen.target})


def draw(pictures: dict[str, Image], path: Path = PICTURE) -> None:
    """Draw dome masters (N, N, 3) [rel] beside each other, at equal exposure."""
    figure, axes = plt.subplots(
        1, len(pictures), figsize=(11.4, 4.2), facecolor=BACKGROUND, dpi=DPI
    )
    figure.subplots_adjust(left=0, right=1, bottom=0.02, top=0.88, wspace=0.02)
    for axis, (name, light) in zip(axes, pictures.items(), strict=True):
        away = np.stack(np.meshgrid(*(np.linspace(-1, 1, len(light)),) * 2), -1)
        inside = np.linalg.norm(away, axis=-1, keepdims=True) <= 1
        shown = np.clip(np.nan_to_num(light) / BRIGHTEST, 0, 1) ** (1 / GAMMA)
        axis.imshow(np.dstack([shown, inside.astype(shown.dtype)]), interpolation="antialiased")
        axis.set_title(name, color="white", fontsize=16)
        axis.axis("off")
    figure.savefig(path, facecolor=BACKGROUND)
    plt.close(figure)


if __name__ == "__main__":
    main()

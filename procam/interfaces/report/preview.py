"""A page that shows what the audience will see of one picture, by each method, beside the target."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from procam.arrays import Array, Image
from procam.compensate.perceptual.objective import LUMA
from procam.files import atomic
from procam.interfaces.plots.charts import Scale
from procam.interfaces.plots.figure import require_matplotlib
from procam.interfaces.report.page import html_template
from procam.maths.geometry.canvas import STANDARD
from procam.maths.vision.pu21 import pu21
from procam.maths.warp import reduced_to
from procam.workflows.playout.explain import BEFORE, TARGET

LARGEST = 900  # px of the page's pictures
BRIGHT_PART = 0.25  # of the lit picture
TITLES = {
    BEFORE: ("Today", "sent as it is: scattered light over everything"),
    "exact": ("Exact", "each place is right, but shadows that would need negative light are flat"),
    "least-squares": ("Least squares", "the least squared error over the dome"),
    "perceptual": ("Perceptual", "contrast is kept in shadows, at some cost elsewhere"),
    TARGET: ("Target", "what the content asks for; no projector can show it all"),
}


def write_preview(
    path: Path, name: str, views: Mapping[str, Image], weight: Array, white_nits: float
) -> None:
    """Write the page of `views` (N, N, 3) as one HTML file; pixels count by `weight` (N, N) [sr]."""
    require_matplotlib()
    shown = [
        {
            "key": key,
            "title": title,
            "text": text,
            "image": _image(views[key]),
            "facts": _facts(views, key, weight, white_nits),
        }
        for key, (title, text) in TITLES.items()
        if key in views
    ]
    page = html_template("preview_template.html").render(
        name=name, views=shown, white_nits=f"{white_nits:g}"
    )
    atomic.write_text(path, page)


def _image(picture: Image) -> str:
    edge = min(len(picture), LARGEST)
    small = picture if edge == len(picture) else reduced_to(picture, (edge, edge))
    return Scale("light", 0.0, 1.0, "light").paint(small, STANDARD.directions(edge)[1])


def _facts(views: Mapping[str, Image], key: str, weight: Array, white_nits: float) -> str:
    """How near a view's luminance is to the target's, and its light where that is brightest."""
    if key == TARGET:
        return ""
    light = [views[name] @ LUMA for name in (key, TARGET)]
    units = [pu21(plane * white_nits) for plane in light]
    error = float(np.vdot(weight, (units[0] - units[1]) ** 2) / weight.sum())
    peak = float(pu21(np.array(white_nits))) ** 2
    bright = weight * (light[1] >= np.quantile(light[1][weight > 0], 1 - BRIGHT_PART))
    share = float(np.vdot(bright, light[0]) / max(np.vdot(bright, light[1]), 1e-9))
    return f"{10 * np.log10(peak / max(error, 1e-9)):.1f} dB; bright parts {share:.0%}"

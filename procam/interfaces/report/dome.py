"""Sections on the rig: who lights what, where pixels land, how projectors and dome behave."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.interfaces import plots
from procam.interfaces.plots import Scale
from procam.interfaces.report.blocks import (
    COLOURS,
    Block,
    Charts,
    DomePicture,
    Domes,
    Group,
    Table,
    Text,
    calibrating,
    not_there,
    signed,
)
from procam.interfaces.report.data import SHOWN, WHOLE, Material, drawn, resized, true_errors
from procam.interfaces.report.words import number, percent
from procam.maths.sphere import master_solid_angles
from procam.model.calibration import Calibration

Array = NDArray[np.float64]
Floats = NDArray[np.floating]


def coverage(material: Material) -> Iterator[Block]:
    """How many projectors reach each direction, and how they share it."""
    calibration = material.calibration
    if calibration is None:
        yield not_there("The map of which projector lights what", calibrating(material))
        return
    blends = {n: drawn(p.surface, p.blend) for n, p in calibration.projectors.items()}
    size = min(len(b) for b in blends.values())
    lit = material.coverage(size) > 0.5
    count = sum(np.isfinite(_to(b, size)).astype(int) for b in blends.values()) * lit
    most = int(np.max(count))
    legend = [
        (plots.category_colour(k), text)
        for k, text in enumerate(("none", "one", "two", "three", "four or more")[: most + 1])
    ]
    share = Scale("share of the light [%]", 0.0, 1.0, "amount", 100.0)
    solid = master_solid_angles(size)
    twice = float((solid * (np.asarray(count) > 1)).sum() / max((solid * lit).sum(), 1e-12))
    yield Domes(
        [
            Group(
                [DomePicture("Projectors per direction", plots.paint_categories(count))],
                None,
                legend,
            ),
            Group([DomePicture(f"Share of {n}", share.paint(b)) for n, b in blends.items()], share),
        ],
        f"Left: how many projectors reach each direction; {percent(twice)} of the lit dome is "
        "reached by more than one. Then, per projector, the share of the light it gives (its "
        "blend): where two meet, the shares fade across each other and add up to 100 %. Grey: "
        "the projector does not reach there.",
    )


def _to(picture: Floats, size: int) -> Floats:
    """A dome master by its nearest pixels at another size; keeps NaN."""
    pick = np.minimum(np.arange(size) * len(picture) // size, len(picture) - 1)
    return picture[np.ix_(pick, pick)]


def mapping(material: Material) -> Iterator[Block]:
    """Expected and true direction errors, and the verdict on the shape."""
    calibration = material.calibration
    if calibration is None:
        yield not_there("The map of mapping errors", calibrating(material))
        return
    shown: list[tuple[str, Array]] = []
    for name, projector in calibration.projectors.items():
        shown.append(
            (f"{name}: expected error", drawn(projector.surface, projector.surface.sigma_arcmin))
        )
        error = true_errors(material, name)
        if error is not None:
            shown.append((f"{name}: true error", drawn(projector.surface, error)))
    top = max(float(np.nanpercentile(values, 99)) for _, values in shown)
    scale = Scale("angle on the dome [arcmin]", 0.0, max(top, 1e-3))
    yield Domes(
        [Group([DomePicture(title, scale.paint(values)) for title, values in shown], scale)],
        "For every projector pixel, how far off its place on the dome may be (expected: one "
        "standard error, computed from the scatter of the camera's sightings"
        + ("; true: compared with the simulator" if material.truth else "")
        + "). One minute of arc is a sixtieth of a degree: about the finest detail an eye "
        "resolves. A 4K dome picture has pixels of 2.6 arcmin.",
    )
    yield from _geometry(calibration)


def _geometry(calibration: Calibration) -> Iterator[Block]:
    quality = calibration.quality
    sphere, residual = (
        quality.get(n) for n in ("sphere_variance_ratio", "geometry_residual_rms_px")
    )
    if residual is not None:
        yield Text(
            f"The model of camera, projectors and dome explains {residual.samples} sightings to "
            f"{number(_scalar(residual.value))} projector pixels (root mean square)."
        )
    if sphere is not None:
        verdict = (
            "The dome is a sphere as far as the camera can tell"
            if sphere.passed
            else "The dome is NOT a sphere to the camera's accuracy; directions carry a systematic error"
        )
        yield Text(
            f"{verdict}: what is left over scatters {number(_scalar(sphere.value))} times as much "
            "as the camera's noise explains (1 is perfect, above 2 the shape is to blame)."
        )


def _scalar(value: Any) -> float:
    return float(np.mean(value))


def response(material: Material) -> Iterator[Block]:
    """Response curves by projector."""
    if material.calibration is None:
        yield not_there("The response curves", calibrating(material))
        return
    images = [
        (plots.response_chart(name, p.photometry.response), f"Response of projector {name}")
        for name, p in material.calibration.projectors.items()
    ]
    yield Charts(
        images,
        "How much light each projector gives for what it is sent, per primary colour. The lower "
        "panel enlarges the difference from a plain power law of 2.2, with its 95 % band: a "
        "smooth curve is a projector without surprises, a kink is a picture mode to switch off.",
        width_px=350,
    )


def levels(material: Material) -> Iterator[Block]:
    """The most and the least direct light."""
    calibration = material.calibration
    if calibration is None:
        yield not_there("White and black levels", calibrating(material))
        return
    size = _map_size(material)
    inside = material.coverage(size) > WHOLE
    hi, lo = (resized(m, size) for m in (calibration.maps.hi, calibration.maps.lo))
    white, black = (np.where(inside, m.mean(axis=-1), np.nan) for m in (hi, lo))
    bright = Scale("full light, 1 = white", 0.0, float(np.nanpercentile(white, 99.9)))
    dark = Scale(
        "black [% of white]",
        0.0,
        max(float(np.nanpercentile(black, 99.9)), 1e-5),
        "alternative",
        100.0,
    )
    yield Domes(
        [
            Group([DomePicture("Brightest white", bright.paint(white))], bright),
            Group([DomePicture("Darkest black", dark.paint(black))], dark),
        ],
        "The most and the least light that all projectors together put on each direction, before "
        "any bounce. White = 1 is the level that every lit direction can reach; compensation works "
        "between these two limits.",
    )
    rows = []
    for title, level, show in (("White", hi, number), ("Black", lo, percent)):
        for c, colour in enumerate(COLOURS):
            low, middle, high = np.percentile(level[inside][:, c], (0, 50, 100))
            rows.append([f"{title}, {colour}", *(show(float(v)) for v in (low, middle, high))])
    yield Table(
        ["Level", "Smallest", "Median", "Largest"], rows, "In units of the reference white."
    )


def _map_size(material: Material) -> int:
    """The size dome maps are shown at."""
    assert material.calibration is not None
    size = material.calibration.maps.size
    return size // max(1, round(size / SHOWN))


def feedback(material: Material) -> Iterator[Block]:
    """Feedback and albedo with intervals, and their maps."""
    calibration = material.calibration
    if calibration is None:
        yield not_there("Feedback and albedo", calibrating(material))
        return
    truth = material.truth
    rows = []
    for title, measured, true in (
        ("Feedback m", calibration.feedback, truth.feedback if truth else None),
        ("Albedo", calibration.albedo, truth.albedo if truth else None),
    ):
        low, high = measured.interval()
        for c, colour in enumerate(COLOURS):
            row = [
                f"{title}, {colour}",
                f"{measured.value[c]:.4f}",
                f"{low[c]:.4f} to {high[c]:.4f}",
            ]
            rows.append([*row, f"{true[c]:.4f}"] if true is not None else row)
    head = ["Quantity", "Measured", "95 % interval", *(["True (simulator)"] if truth else [])]
    yield Text(
        "Feedback m is the bounced light per unit of light projected when the whole dome is "
        f"white: here every 100 units the projectors send arrive as {100 + 100 * calibration.feedback.value.mean():.0f}. "
        "Albedo is the share of light the screen throws back; it is worked out from m and what is "
        "known of the floor, and compensation does not depend on it."
    )
    yield Table(head, rows)
    yield _bounce_maps(material, calibration)


def _bounce_maps(material: Material, calibration: Calibration) -> Domes:
    size = _map_size(material)
    inside = material.coverage(size) > WHOLE
    albedo, scatter = (
        np.where(inside, resized(m, size).mean(axis=-1), np.nan)
        for m in (calibration.maps.albedo, calibration.maps.scatter_per_flux)
    )
    relative = scatter / np.nanmean(scatter) - 1
    low, high = np.nanpercentile(albedo, (0.5, 99.5))
    reflect = Scale("albedo", float(low), float(max(high, low + 1e-3)))
    end = max(0.01, float(np.nanpercentile(np.abs(relative), 99.5)))
    spread = signed("bounced light against its mean [%]", end)
    return Domes(
        [
            Group([DomePicture("Albedo", reflect.paint(albedo))], reflect),
            Group([DomePicture("Where bounced light shows", spread.paint(relative))], spread),
        ],
        "Left: how much light each part of the screen throws back; seams and stains show darker. "
        "Right: where bounced light shows more (red) or less (blue) than on average. On a perfect "
        "dome both would be flat.",
    )

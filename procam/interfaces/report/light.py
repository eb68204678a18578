"""Sections on the light: before and after, what bounces, the closed loop, what clipped."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from procam.interfaces import plots
from procam.interfaces.report.blocks import (
    COLOURS,
    Block,
    Charts,
    DomePicture,
    Domes,
    Group,
    Table,
    Text,
    brightness,
    calibrating,
    not_there,
    signed,
)
from procam.interfaces.report.data import WHOLE, Material, Seen, drawn, gain_change, resized
from procam.interfaces.report.words import percent
from procam.maths.sphere import angles_from_direction, master_directions, master_solid_angles

Array = NDArray[np.float64]
Floats = NDArray[np.floating]
PROFILE_STEP_DEG = 3.0
WITNESS = {
    "simulator": "as the simulated dome really shows them, without camera or noise",
    "camera": "as the camera photographed them",
    "prediction": "as the calibration predicts them; nothing has been photographed yet",
}


def pictures(material: Material) -> Iterator[Block]:
    """The pictures before and after, as intended, and what is left."""
    seen = material.seen()
    if seen is None:
        yield not_there("The pictures before and after compensation", calibrating(material))
        return
    unlit = seen.coverage < 0.5
    residual = np.where(unlit, np.nan, (seen.after - seen.target).mean(axis=-1))
    target = np.where(unlit[..., None], 0, seen.target)
    light = brightness(_top(seen.before))
    trio = (("Before", seen.before), ("After", seen.after), ("Intended", target))
    difference = signed("after \N{MINUS SIGN} intended [% of white]", 0.2)
    yield Domes(
        [
            Group([DomePicture(t, light.paint(p)) for t, p in trio], light),
            Group([DomePicture("Difference left", difference.paint(residual))], difference),
        ],
        f"Pictures are shown {WITNESS[seen.source]}. Each circle is the whole dome seen from "
        "below: the audience's front at the bottom edge, the zenith in the middle, rings at 30 "
        "and 60 degrees above the rim. The first three share one brightness scale. In the last, "
        "red is too bright, blue too dark and white is right; grey is screen that no projector "
        "reaches.",
        dark=True,
    )


def _top(picture: Floats) -> float:
    """The upper end of a brightness scale: a little more than the brightest, in tenths."""
    return max(0.2, float(np.ceil(np.percentile(picture, 99.9) * 10) / 10))


def pollution(material: Material) -> Iterator[Block]:
    """Scattered light and error, before and after, as maps and against elevation."""
    seen = material.seen()
    if seen is None or material.calibration is None:
        yield not_there("The bounced light before and after", calibrating(material))
        return
    unlit = seen.coverage < 0.5
    parts = [
        ("Bounced light, before", seen.before - _direct_without(material, len(seen.target))),
        ("Error before", seen.before - seen.target),
        ("Error after", seen.after - seen.target),
    ]
    maps = [(t, np.where(unlit, np.nan, p.mean(axis=-1))) for t, p in parts]
    end = float(np.ceil(np.nanpercentile(np.abs(maps[0][1]), 99) * 20) / 20)
    scale = signed("[% of white]", max(end, 0.05))
    before, after = seen.error_rms()
    yield Text(
        f"Where no limit holds, the picture differed from the intended one by {percent(before)} of "
        f"white before and by {percent(after)} after (root mean square)."
    )
    yield Domes(
        [Group([DomePicture(t, scale.paint(p)) for t, p in maps], scale)],
        "First: light that did not come from a projector directly but from the rest of the dome. "
        "Second: how far that puts the uncompensated picture off the intended one. Third: the "
        "same with compensation. Red is too bright, blue too dark, white is right; the mean of "
        "the three colours. What stays red afterwards asks for less light than bounces there.",
    )
    yield _profile(seen)


def _direct_without(material: Material, size: int) -> Floats:
    """Direct light (N, N, 3) of the uncompensated content: the content within its limits."""
    assert material.calibration is not None
    maps = material.calibration.maps
    lo, hi = (resized(m, size) for m in (maps.lo, maps.hi))
    return np.clip(resized(material.pictures["target"], size), lo, np.maximum(lo, hi))


def _profile(seen: Seen) -> Charts:
    size = len(seen.target)
    _, elevation = angles_from_direction(master_directions(size)[0])
    band = np.floor(np.degrees(elevation) / PROFILE_STEP_DEG).astype(int)
    weight = master_solid_angles(size) * (seen.coverage > WHOLE)
    bands = np.arange(int(90 / PROFILE_STEP_DEG))

    def mean(picture: Floats, share: Floats) -> Array:
        total = [
            [
                _band_mean(picture[band == b, c], (weight * share[..., c])[band == b])
                for c in range(3)
            ]
            for b in bands
        ]
        return np.array(total)

    everywhere = np.ones_like(seen.free)
    free = (seen.free > WHOLE).astype(np.float32)
    before, after = seen.before - seen.target, seen.after - seen.target
    image = plots.profile_chart(
        (bands + 0.5) * PROFILE_STEP_DEG,
        mean(before, everywhere),
        mean(after, everywhere),
        mean(after, free),
    )
    return Charts(
        [(image, "Error against elevation, before and after")],
        "The same errors averaged all the way round the dome, from its rim (0 degrees) to the "
        "zenith (90). Zero is the intended picture. Full lines on the right leave out directions "
        "where a limit holds.",
        width_px=980,
    )


def _band_mean(values: Floats, weight: Floats) -> float:
    total = float(weight.sum())
    return float((values * weight).sum() / total) if total > 0 else float("nan")


def loop(material: Material) -> Iterator[Block]:
    """The curve and photographs of the closed loop."""
    loop = material.loop
    if loop is None:
        yield not_there("The closed loop's photographs", f"`procam refine {material.directory}`")
        return
    yield Text(
        "The compensated picture was shown, photographed, compared with what the calibration had "
        f"predicted, and corrected {len(loop.residual) - 1} times. The difference fell from "
        f"{percent(loop.residual[0])} to {percent(loop.residual[-1])} of white; the noise of one "
        f"photograph is {percent(loop.noise_floor)}, and nothing below it can be seen."
    )
    image = plots.loop_chart(loop.residual, loop.noise_floor)
    yield Charts([(image, "What is left after each correction")], "", width_px=640)
    photographs = loop.photographs
    light = brightness(_top(photographs["before"]))
    trio = (
        ("Photograph, before", "before"),
        ("Photograph, refined", "after"),
        ("Predicted", "predicted"),
    )
    error = (photographs["after"] - photographs["predicted"]).mean(axis=-1)
    seen = photographs["free"].mean(axis=-1) > 0.5
    error = np.where(seen, error, np.nan)
    end = (
        max(0.005, float(np.ceil(np.nanpercentile(np.abs(error), 99) * 200) / 200))
        if seen.any()
        else 1.0
    )
    difference = signed("[% of white], enlarged", end)
    yield Domes(
        [
            Group([DomePicture(t, light.paint(photographs[n])) for t, n in trio], light),
            Group(
                [DomePicture("Refined \N{MINUS SIGN} predicted", difference.paint(error))],
                difference,
            ),
        ],
        "What the camera saw, turned into a dome picture. The last one is enlarged: grain is the "
        "camera's noise, structure would be a fault. Grey: directions where a limit holds, which "
        "the loop leaves alone.",
        dark=True,
    )
    yield from _gain_change(material)


def _gain_change(material: Material) -> Iterator[Block]:
    assert material.calibration is not None or not material.calibrations
    if material.calibration is None:
        return
    changes = {}
    for name, projector in material.calibration.projectors.items():
        factor = gain_change(material, name)
        if factor is not None:
            changes[name] = drawn(projector.surface, factor - 1)
    known = [v[np.isfinite(v)] for v in changes.values()]
    if not known:
        return
    end = max(0.005, float(np.percentile(np.abs(np.concatenate(known)), 99)))
    scale = signed("brightness factor minus 1 [%]", end)
    yield Domes(
        [
            Group(
                [DomePicture(f"Correction of {n}", scale.paint(v)) for n, v in changes.items()],
                scale,
            )
        ],
        "What the loop changed in the calibration: how much brighter (red) or darker (blue) each "
        "projector turned out to be than first measured.",
    )


def clipped(material: Material) -> Iterator[Block]:
    """Where a limit of the projectors holds, and which."""
    pictures = material.pictures
    if not pictures or material.calibration is None:
        yield not_there("The map of what clipped", calibrating(material))
        return
    size = len(pictures["target"])
    held = 1 - pictures["free"]
    above = pictures["compensated"] > pictures["target"]
    lit = material.coverage(size) > WHOLE
    weight = (master_solid_angles(size) * lit)[..., None]
    total = max(float(weight.sum()), 1e-12)
    low, high = ((weight * held * side).sum(axis=(0, 1)) / total for side in (above, ~above))
    codes = np.where(held > 0.5, np.where(above, 1, 2), 0)
    codes = np.where((material.coverage(size) > 0.5)[..., None], codes, 4)
    legend = [
        (plots.category_colour(0), "reproduced exactly"),
        (plots.category_colour(1), "asks for less light than bounces there"),
        (plots.category_colour(2), "asks for more light than the projectors have"),
        (plots.category_colour(4), "no projector reaches"),
    ]
    yield Text(
        f"{percent(float(1 - (low + high).mean()))} of the lit picture is reproduced exactly. "
        f"{percent(float(low.mean()))} asks for less light than already bounces there: no "
        "projector can take light away, so black stays a little grey. "
        f"{percent(float(high.mean()))} asks for more light than the projectors have."
    )
    yield Domes(
        [
            Group(
                [
                    DomePicture(c.capitalize(), plots.paint_categories(codes[..., i]))
                    for i, c in enumerate(COLOURS)
                ],
                None,
                legend,
            )
        ],
        "Per colour channel, where the compensated picture meets a limit of the projectors.",
    )
    rows = [
        [
            COLOURS[c].capitalize(),
            percent(float(1 - low[c] - high[c])),
            percent(float(low[c])),
            percent(float(high[c])),
        ]
        for c in range(3)
    ]
    yield Table(
        ["Channel", "Exact", "Held at black", "Held at full light"], rows, "Share of the lit dome."
    )

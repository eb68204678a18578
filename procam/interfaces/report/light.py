"""Sections on the light: before and after, bounced light, the closed loop, limits."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, FloatArray
from procam.files.history.figures import calibration_figures
from procam.files.images.layers import read_layers
from procam.interfaces.plots import charts as plots
from procam.interfaces.plots.figure import LIMITS
from procam.interfaces.report.before_after import WHOLE, BeforeAfter
from procam.interfaces.report.blocks import (
    Block,
    Charts,
    Pictures,
    Table,
    Text,
    brightness,
    calibrating,
    categories,
    extent,
    not_there,
    painted,
    signed,
    signed_light,
)
from procam.interfaces.report.data import Material
from procam.interfaces.report.errors_by_place import errors_by_place
from procam.interfaces.report.words import limits_text, percent
from procam.model.photometry import PRIMARIES

CIRCLE = (
    "Each circle is the whole dome seen from below: the audience's front at the bottom edge, the zenith in "
    "the middle, rings at 30 and 60 degrees above the rim."
)
CANVAS = "Each picture is the canvas that content is made for, its parts seen from inside."
SOURCES = {
    "simulator": "as the simulated screen shows them, without camera or noise",
    "camera": "as the camera photographed them",
    "prediction": "as the calibration predicts them; nothing has been photographed yet",
}
LIMIT_WORDS = (
    "reproduced exactly",
    "stays too bright: asks for less light than bounces there",
    "stays too dark: asks for more light than the projectors have",
    "no projector reaches",
)


def pictures(material: Material) -> Iterator[Block]:
    """The pictures before and after, as intended, and the remaining error."""
    seen = material.before_after()
    if seen is None:
        yield not_there("The pictures before and after compensation", calibrating(material))
        return
    unlit = seen.coverage < 0.5
    residual = np.where(unlit, np.nan, (seen.after - seen.target).mean(axis=-1))
    target = np.where(unlit[..., None], 0, seen.target)
    light = brightness(extent(seen.before, 0.2, 0.1))
    shown = {"Before": seen.before, "After": seen.after, "Intended": target}
    difference = signed_light(0.2)
    yield Pictures(
        [
            painted(material, shown, light),
            painted(material, {"Remaining error": residual}, difference),
        ],
        f"Pictures are shown {SOURCES[seen.source]}. {CIRCLE if material.is_dome else CANVAS} "
        "The first three are shown at equal exposure: all are scaled by the same factor, so what looks "
        f"darker here is darker in the {material.word}. In the last, red is too bright, blue "
        "too dark and white is right; grey is screen that no projector reaches.",
        dark=True,
    )


def pollution(material: Material) -> Iterator[Block]:
    """Scattered light and error, before and after, as maps, and against elevation or by part."""
    seen = material.before_after()
    if seen is None or material.calibration is None:
        yield not_there("The bounced light before and after", calibrating(material))
        return
    before, after = (percent(error, 2) for error in seen.error_rms())
    if seen.source == "prediction":
        after = "nothing, by construction: only a photograph (`procam refine`) shows the remaining error"
    yield Text(
        "Where no limit holds, the picture differs from the intended one by "
        f"{before} of white before (root mean square, a typical size), and after by {after}."
    )
    yield _pollution_maps(material, seen)
    yield errors_by_place(material.calibration.screen, seen)


def _pollution_maps(material: Material, seen: BeforeAfter) -> Pictures:
    unlit = seen.coverage < 0.5
    scattered = seen.before - _direct_without(material, seen.target.shape[1])
    parts = {
        "Bounced light, before": scattered,
        "Error before": seen.before - seen.target,
        "Error after": seen.after - seen.target,
    }
    maps = {title: np.where(unlit, np.nan, part.mean(axis=-1)) for title, part in parts.items()}
    scale = signed_light(extent(maps["Bounced light, before"], 0.05, 0.05))
    free = seen.free.min(axis=-1) > WHOLE
    left = np.where(free, maps["Error after"], np.nan)
    enlarged = signed_light(extent(left, 0.002, 0.002))
    return Pictures(
        [
            painted(material, maps, scale),
            painted(material, {"Error after, enlarged": left}, enlarged),
        ],
        f"First: light that comes from the rest of the {material.word}, not directly from a projector. "
        "Second: the error that it causes in the uncompensated picture. Third: the error with "
        "compensation; what stays red asks for less light than bounces there. Last: the error "
        "where no limit holds, on a much finer scale. All are means of the three colours.",
    )


def _direct_without(material: Material, size: int) -> FloatArray:
    """Direct light (H, W, 3) of the uncompensated content: the content within its limits."""
    assert material.calibration is not None
    maps = material.calibration.maps
    target, lo, hi = (
        material.resized(m, size) for m in (material.pictures["target"], maps.lo, maps.hi)
    )
    return np.clip(target, lo, np.maximum(lo, hi))


def loop(material: Material) -> Iterator[Block]:
    """The curve and photographs of the closed loop."""
    seen = material.loop
    if seen is None:
        yield not_there("The closed loop's photographs", f"`procam refine {material.directory}`")
        return
    times = len(seen.residual) - 1
    corrected = (
        f"corrected {times} time{'s' if times > 1 else ''}" if times else "found good enough"
    )
    yield Text(
        "The compensated picture was shown, photographed, compared with the prediction of the "
        f"calibration, and {corrected}. The difference went from {percent(seen.residual[0], 2)} to "
        f"{percent(seen.residual[-1], 2)} of white; the noise of one photograph is "
        f"{percent(seen.noise_floor, 2)}, and no smaller difference can be measured."
    )
    if seen.unseen:
        before, after = (percent(value, 2) for value in seen.unseen)
        yield Text(
            "The calibration that followed was tried on another picture, turned or mirrored and inverted, "
            f"from which nothing was learnt: its difference went from {before} to {after} of white, camera "
            "noise taken off."
        )
    if seen.worse:
        yield Text(f"The resulting calibration was not kept: {seen.worse}.")
    chart = plots.loop_chart(seen.residual, seen.noise_floor)
    yield Charts([(chart, "Difference after each correction")], "", width_px=640)
    yield _loop_pictures(material)
    yield from _gain_change(material)


def _loop_pictures(material: Material) -> Pictures:
    photographs = material.photographs
    light = brightness(extent(photographs["before"], 0.2, 0.1))
    shown = {
        "Photograph, before": photographs["before"],
        "Photograph, refined": photographs["after"],
        "Predicted": photographs["predicted"],
    }
    error = (photographs["after"] - photographs["predicted"]).mean(axis=-1)
    error = np.where(photographs["free"].min(axis=-1) > 0.5, error, np.nan)
    difference = signed_light(extent(error, 0.002, 0.002))
    minus = "Refined \N{MINUS SIGN} predicted, enlarged"
    return Pictures(
        [painted(material, shown, light), painted(material, {minus: error}, difference)],
        "The camera's photographs on the canvas. In the last, grain is the camera's noise, and "
        "structure would be a fault. Grey: places where a limit holds, which the loop does "
        "not correct.",
        dark=True,
    )


def _gain_change(material: Material) -> Iterator[Block]:
    """The loop's changes, if the calibration before it is there."""
    projectors = material.calibration.projectors if material.calibration else {}
    changes = {}
    for name, projector in projectors.items():
        factor = gain_change(material, name)
        if factor is not None:
            changes[f"Correction of {name}"] = material.on_screen(projector.surface, factor - 1)
    if not changes:
        return
    everything = np.concatenate([change.ravel() for change in changes.values()])
    scale = signed("brightness, change [%]", extent(everything, 0.002, 0.002))
    yield Pictures(
        [painted(material, changes, scale)],
        "How the loop changed the calibration: how much brighter (red) or darker (blue) each "
        "projector is than first measured.",
    )


def gain_change(material: Material, name: str) -> Array | None:
    """Factor (H, W) by which the loop changed a projector's gain; None without two calibrations.

    Calibrations that only added a venue state are passed over: they have the same gains.
    """
    change = None
    before = [p for p in material.calibrations if material.used and p.name < material.used.name]
    for earlier in reversed(before):
        found = _gain_since(earlier, material, name)
        if found is None:
            break
        change = found
        if (np.nan_to_num(change, nan=1.0) != 1).any():
            break
    return change


def _gain_since(earlier: Path, material: Material, name: str) -> Array | None:
    """Gain (H, W) over that of an earlier calibration of the same session; None if there is none."""
    newest = material.calibration
    session, _ = calibration_figures(earlier / "calibration.json")
    path = earlier / "maps" / f"{name}.exr"
    if newest is None or session != newest.provenance.session or not path.is_file():
        return None
    old = read_layers(path)["gain"].sum(axis=-1, dtype=float)
    new = newest.projectors[name].photometry.gain.sum(axis=-1, dtype=float)
    return np.where(old > 0, new / np.where(old > 0, old, 1.0), np.nan)


def clipped(material: Material) -> Iterator[Block]:
    """Where a limit of the projectors holds, and which."""
    limits = material.limits()
    if limits is None:
        yield not_there("The map of limits", calibrating(material))
        return
    low, high = limits.too_bright, limits.too_dark
    exact = (
        f"{percent(float(1 - (low + high).mean()), 2)} of the lit picture is reproduced exactly."
    )
    yield Text(f"{exact} {limits_text(float(low.mean()), float(high.mean()))}")
    masked = material.protected(limits.codes.shape[1]).any()
    yield _limits(material, limits.codes, " or protected by hand" if masked else "")
    rows = [
        [c.capitalize(), *(percent(float(share[i])) for share in (1 - low - high, low, high))]
        for i, c in enumerate(PRIMARIES)
    ]
    head = ["Channel", "Exact", "Held at black", "Held at full light"]
    left_out = ", without what is protected by hand" if masked else ""
    yield Table(head, rows, f"Shares of the lit {material.word}{left_out}.")


def _limits(material: Material, codes: NDArray[np.integer], also: str) -> Pictures:
    """The maps by channel; `also` is what else is left out than places without light."""
    legend = list(zip(LIMITS, (*LIMIT_WORDS[:-1], LIMIT_WORDS[-1] + also), strict=True))
    maps = {c.capitalize(): codes[..., i] for i, c in enumerate(PRIMARIES)}
    return Pictures(
        [categories(material, maps, legend)],
        "Per colour channel, where the compensated picture meets a limit of the projectors.",
    )

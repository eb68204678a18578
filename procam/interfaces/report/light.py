"""Sections on the light: before and after, bounced light, the closed loop, limits."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, FloatArray, Image
from procam.files.history.figures import calibration_figures
from procam.files.images.layers import read_layers
from procam.interfaces.plots import charts as plots
from procam.interfaces.plots.figure import LIMITS, css_colour
from procam.interfaces.report.blocks import (
    Block,
    Charts,
    DomePicture,
    Domes,
    Group,
    Table,
    Text,
    brightness,
    calibrating,
    extent,
    not_there,
    painted,
    signed,
    signed_light,
)
from procam.interfaces.report.data import WHOLE, BeforeAfter, Material, on_master, resized
from procam.interfaces.report.words import limits_text, percent
from procam.maths.geometry.sphere import (
    angles_from_direction,
    master_directions,
    master_solid_angles,
)
from procam.model.photometry import PRIMARIES

BAND_DEG = 3.0
SOURCES = {
    "simulator": "as the simulated dome shows them, without camera or noise",
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
    yield Domes(
        [painted(shown, light), painted({"Remaining error": residual}, difference)],
        f"Pictures are shown {SOURCES[seen.source]}. Each circle is the whole dome seen from "
        "below: the audience's front at the bottom edge, the zenith in the middle, rings at 30 "
        "and 60 degrees above the rim. The first three are shown at equal exposure: all are scaled by the "
        "same factor, so what looks darker here is darker on the dome. In the last, red is too bright, blue "
        "too dark and white is right; grey is screen that no projector reaches.",
        dark=True,
    )


def pollution(material: Material) -> Iterator[Block]:
    """Scattered light and error, before and after, as maps and against elevation."""
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
    yield _pollution_maps(seen, seen.before - _direct_without(material, len(seen.target)))
    yield _profile(seen)


def _pollution_maps(seen: BeforeAfter, scattered: FloatArray) -> Domes:
    unlit = seen.coverage < 0.5
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
    return Domes(
        [painted(maps, scale), painted({"Error after, enlarged": left}, enlarged)],
        "First: light that comes from the rest of the dome, not directly from a projector. Second: "
        "the error that it causes in the uncompensated picture. Third: the error with "
        "compensation; what stays red asks for less light than bounces there. Last: the error "
        "where no limit holds, on a much finer scale. All are means of the three colours.",
    )


def _direct_without(material: Material, size: int) -> FloatArray:
    """Direct light (N, N, 3) of the uncompensated content: the content within its limits."""
    assert material.calibration is not None
    maps = material.calibration.maps
    lo, hi = (resized(m, size) for m in (maps.lo, maps.hi))
    return np.clip(resized(material.pictures["target"], size), lo, np.maximum(lo, hi))


def _profile(seen: BeforeAfter) -> Charts:
    everywhere = np.ones_like(seen.free)
    free = (seen.free > WHOLE).astype(np.float32)
    before, after = seen.before - seen.target, seen.after - seen.target
    image = plots.profile_chart(
        np.arange(BAND_DEG / 2, 90, BAND_DEG, dtype=np.float64),
        _by_elevation(before, everywhere, seen.coverage),
        _by_elevation(after, everywhere, seen.coverage),
        _by_elevation(after, free, seen.coverage),
    )
    return Charts(
        [(image, "Error against elevation, before and after")],
        "The same errors averaged round the dome, by elevation from its rim (0 degrees) to the "
        "zenith (90); zero is the intended picture. The full lines on the right leave out "
        "directions where a limit holds. Rings that are mostly unlit are left out.",
        width_px=980,
    )


def _by_elevation(picture: FloatArray, share: FloatArray, coverage: FloatArray) -> Array:
    """Means (K, 3) over rings of equal elevation; NaN where a ring is mostly unlit."""
    size = len(picture)
    direction, inside = master_directions(size)
    elevation = np.degrees(angles_from_direction(direction)[1])
    ring = np.clip(elevation / BAND_DEG, 0, 90 / BAND_DEG - 1).astype(int).ravel()
    solid = master_solid_angles(size) * inside
    lit = solid * (coverage > WHOLE)
    mostly = np.bincount(ring, lit.ravel()) > 0.5 * np.bincount(ring, solid.ravel())
    columns = []
    for c in range(picture.shape[2]):
        weight = (lit * share[..., c]).ravel()
        total = np.bincount(ring, weight)
        mean = np.bincount(ring, weight * picture[..., c].ravel()) / np.maximum(total, 1e-12)
        columns.append(np.where(mostly & (total > 1e-9), mean, np.nan))
    return np.stack(columns, axis=-1)


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
            "The calibration that followed was tried on the picture turned and inverted, from which nothing "
            f"was learnt: its difference went from {before} to {after} of white, camera noise taken off."
        )
    if seen.worse:
        yield Text(f"The resulting calibration was not kept: {seen.worse}.")
    chart = plots.loop_chart(seen.residual, seen.noise_floor)
    yield Charts([(chart, "Difference after each correction")], "", width_px=640)
    yield _loop_pictures(material.photographs)
    yield from _gain_change(material)


def _loop_pictures(photographs: Mapping[str, Image]) -> Domes:
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
    return Domes(
        [painted(shown, light), painted({minus: error}, difference)],
        "The camera's photographs as dome pictures. In the last, grain is the camera's noise, and "
        "structure would be a fault. Grey: directions where a limit holds, which the loop does "
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
            changes[f"Correction of {name}"] = on_master(projector.surface, factor - 1)
    if not changes:
        return
    everything = np.concatenate([change.ravel() for change in changes.values()])
    scale = signed("brightness, change [%]", extent(everything, 0.002, 0.002))
    yield Domes(
        [painted(changes, scale)],
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
    masked = material.protected(len(limits.codes)).any()
    yield _limits(limits.codes, " or protected by hand" if masked else "")
    rows = [
        [c.capitalize(), *(percent(float(share[i])) for share in (1 - low - high, low, high))]
        for i, c in enumerate(PRIMARIES)
    ]
    head = ["Channel", "Exact", "Held at black", "Held at full light"]
    left_out = ", without what is protected by hand" if masked else ""
    yield Table(head, rows, f"Shares of the lit dome{left_out}.")


def _limits(codes: NDArray[np.integer], also: str) -> Domes:
    """The maps by channel; `also` is what else is left out than directions without light."""
    colours = [css_colour(c) for c in LIMITS]
    left_out = LIMIT_WORDS[-1] + also
    domes = [
        DomePicture(c.capitalize(), plots.paint_categories(codes[..., i], LIMITS))
        for i, c in enumerate(PRIMARIES)
    ]
    return Domes(
        [Group(domes, None, list(zip(colours, (*LIMIT_WORDS[:-1], left_out), strict=True)))],
        "Per colour channel, where the compensated picture meets a limit of the projectors.",
    )

"""Sections on the rig: coverage, directions, responses, levels, feedback and albedo.

The module is longer than 300 lines because each section is one part of that one rig.
"""

from collections.abc import Iterator

import numpy as np

from procam.arrays import Array, FloatArray
from procam.files.images.layers import read_layers
from procam.interfaces.plots import charts as plots
from procam.interfaces.plots.charts import Scale
from procam.interfaces.report.before_after import WHOLE
from procam.interfaces.report.blocks import (
    Block,
    Charts,
    Pictures,
    Table,
    Text,
    calibrating,
    categories,
    extent,
    not_there,
    painted,
    signed,
)
from procam.interfaces.report.data import SHOWN, Material
from procam.interfaces.report.words import number, percent
from procam.maths.geometry.sphere import angle_between
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES
from procam.model.quality import Figure
from procam.model.screen import Dome, RoomScreen, Screen
from procam.model.transport import Measured

FINEST = " A 4K dome picture has pixels of 2.6 arcmin."
ALBEDO = "computed from m and the floor's albedo, and compensation does not depend on it"
ROOM_ALBEDO = "what the walls scatter, over all that arrives at them by their shapes"
COUNT_WORDS = ("none", "one", "two", "three", "four or more")
SPHERE = "of an exact sphere ", "the dome is not a sphere"


def coverage(material: Material) -> Iterator[Block]:
    """How many projectors reach each place, and how they share it."""
    if material.calibration is None:
        yield not_there("The map of which projector lights what", calibrating(material))
        return
    projectors = material.calibration.projectors
    blends = {
        f"Share of {n}": material.on_screen(p.surface, p.blend) for n, p in projectors.items()
    }
    size = min(b.shape[1] for b in blends.values())
    lit = material.coverage(size) > 0.5
    count = np.sum([np.isfinite(_nearest(b, lit.shape)) for b in blends.values()], axis=0) * lit
    weight = material.canvas.weights(size)
    twice = float((weight * (count > 1)).sum() / max((weight * lit).sum(), 1e-12))
    share = Scale("share of the light [%]", 0.0, 1.0, "amount", 100.0)
    legend = list(zip(plots.COUNTS, COUNT_WORDS, strict=True))[: count.max() + 1]
    yield Pictures(
        [
            categories(material, {"Projectors per place": count}, legend),
            painted(material, blends, share),
        ],
        f"First: how many projectors reach each place; {percent(twice, 2)} of the lit {material.word} is "
        "reached by more than one. Then, per projector, the share of the light it gives (its "
        "blend): where two meet, the shares fade across each other and add up to 100 %. Grey: "
        "the projector does not reach there.",
    )


def _nearest(picture: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """A picture by its nearest pixels at another size; keeps NaN."""
    pick = [np.arange(n) * have // n for n, have in zip(shape, picture.shape, strict=True)]
    return np.asarray(picture[np.ix_(*pick)])


def mapping(material: Material) -> Iterator[Block]:
    """Expected and true direction errors, and whether the screen is what it is stated to be."""
    if material.calibration is None:
        yield not_there("The map of direction errors", calibrating(material))
        return
    shown: dict[str, Array] = {}
    for name, projector in material.calibration.projectors.items():
        surface = projector.surface
        shown[f"{name}: expected error"] = material.on_screen(surface, surface.sigma_arcmin)
        error = _true_errors(material, name)
        if error is not None:
            shown[f"{name}: true error"] = material.on_screen(surface, error)
    end = extent(np.concatenate([values.ravel() for values in shown.values()]), 0.01)
    true = "; true: compared with the simulator" if material.truth else ""
    yield Pictures(
        [painted(material, shown, Scale("angle from the middle [arcmin]", 0.0, end))],
        f"How far each projector pixel may be from its calculated place in the {material.word} (expected: "
        "one standard error, from the scatter of the camera's observations and of the surveyed marks"
        f"{true}). One minute of arc is a sixtieth of a degree, about the finest detail an eye "
        f"resolves.{FINEST if material.is_dome else _finest(material)}",
    )
    yield from _geometry(material.calibration)


def _finest(material: Material) -> str:
    """What an arc minute is on the walls of a room."""
    assert material.calibration is not None
    far_m = material.calibration.screen.shape.radius_m
    millimetres = number(1e3 * far_m * np.radians(1 / 60), 2)
    return f" It is {millimetres} mm on what is farthest from the middle of the room."


def _true_errors(material: Material, name: str) -> Array | None:
    """Angles (H, W) [arcmin] between estimated and true pixel directions; NaN where unknown."""
    if material.truth is None or material.calibration is None:
        return None
    path = material.truth.directory / "maps" / f"{name}.exr"
    if not path.is_file():
        return None
    maps = read_layers(path)
    truth = maps["direction"]
    estimated = material.calibration.projectors[name].surface.direction
    error = np.degrees(angle_between(estimated.astype(float), truth.astype(float))) * 60
    return np.where(maps["valid"] > 0.5, error, np.nan)


def _geometry(calibration: Calibration) -> Iterator[Block]:
    for note in calibration.provenance.notes:
        yield Text(f"Note: {note}.")
    residual = calibration.quality.get("geometry_residual_rms_px")
    if residual is not None:
        yield Text(
            f"The model of cameras, projectors and screen fits {number(residual.samples)} observations "
            f"to {number(_mean(residual))} projector pixels (root mean square)."
        )
    misfit = calibration.quality.get("sphere_variance_ratio")
    if misfit is not None:
        dome = isinstance(calibration.screen, Dome)
        what, limit = ("", "something is not as stated") if not dome else SPHERE
        yield Text(
            f"{_verdict(calibration.screen, bool(misfit.passed))}. The residuals {what}vary "
            f"{_mean(misfit):.2f} times as much as the cameras' noise explains "
            f"(1 is perfect; above 2.25 {limit})."
        )


def _verdict(screen: Screen, passed: bool) -> str:
    """Whether the screen has the shape that venue.toml states."""
    if isinstance(screen, RoomScreen) and passed and screen.moved:
        return "Walls are not quite where venue.toml has them; their places were solved"
    if isinstance(screen, RoomScreen):
        return f"The room {'has' if passed else 'does not quite have'} the dimensions of venue.toml"
    if passed:
        return "The dome is a sphere, as far as the cameras can measure"
    if degree := screen.shape.degree:
        return f"The dome is NOT a sphere; its shape was solved up to harmonics of degree {degree}"
    note = (
        "a smooth deformation does not explain it; the standard errors of directions include that"
    )
    return f"The pictures do not fit a sphere, and {note}"


def _mean(figure: Figure) -> float:
    return float(np.mean(figure.value))


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
        "panel enlarges the difference from a power law of 2.2, with its 95 % band. A smooth curve "
        "is good; a kink means that the projector processes the picture, in a mode to switch off.",
        width_px=345,
    )


def levels(material: Material) -> Iterator[Block]:
    """The most and the least direct light."""
    if material.calibration is None:
        yield not_there("White and black levels", calibrating(material))
        return
    maps, size = material.calibration.maps, _map_size(material.calibration)
    inside = material.coverage(size) > WHOLE
    hi, lo = (
        np.where(inside[..., None], material.resized(m, size), np.nan) for m in (maps.hi, maps.lo)
    )
    white, black = hi.mean(axis=-1), lo.mean(axis=-1)
    bright = Scale("full light, 1 = white", 0.0, extent(white, 0.1, 0.1))
    dark = Scale("black [% of white]", 0.0, extent(black, 1e-5), "alternative", 100.0)
    yield Pictures(
        [
            painted(material, {"Brightest white": white}, bright),
            painted(material, {"Darkest black": black}, dark),
        ],
        "The most and the least light that all projectors together put on each place, before "
        "light bounces; compensation works between these two limits. White = 1 is the level that "
        "practically every lit place can reach (all but one in a thousand).",
    )
    rows = [
        [f"{title}, {c}", *_spread(level[inside][:, i], as_percent)]
        for title, level, as_percent in (("White", hi, False), ("Black", lo, True))
        for i, c in enumerate(PRIMARIES)
    ]
    head = ["Level", "1 in 1000 is below", "Median", "1 in 1000 is above"]
    yield Table(head, rows, "White in units of the reference white, black in per cent of it.")


def _spread(values: FloatArray, as_percent: bool) -> list[str]:
    if not values.size:
        return ["not lit"] * 3
    show = percent if as_percent else number
    return [show(float(v)) for v in np.percentile(values, (0.1, 50, 99.9))]


def _map_size(calibration: Calibration) -> int:
    """The width at which maps are shown."""
    return calibration.maps.size // max(1, round(calibration.maps.size / SHOWN))


def feedback(material: Material) -> Iterator[Block]:
    """Feedback and albedo with intervals, and their maps."""
    if material.calibration is None:
        yield not_there("Feedback and albedo", calibrating(material))
        return
    arriving = 100 * (1 + float(material.calibration.feedback.value.mean()))
    yield Text(
        "Feedback m is the bounced light per unit of light projected when the whole "
        f"{material.word} is white: here 100 units sent by the projectors arrive as {arriving:.0f}. "
        f"Albedo is the share of light that the screen reflects; "
        f"it is {ALBEDO if material.is_dome else ROOM_ALBEDO}."
    )
    yield _measured(material, material.calibration)
    if material.calibration.states:
        yield _states(material, material.calibration)
    yield _bounce_maps(material, material.calibration)


def _measured(material: Material, calibration: Calibration) -> Table:
    truth = material.truth
    rows = []
    for title, measured, true in (
        ("Feedback m", calibration.feedback, truth.feedback if truth else None),
        ("Albedo", calibration.albedo, truth.albedo if truth else None),
    ):
        low, high = measured.interval()
        for i, c in enumerate(PRIMARIES):
            row = [f"{title}, {c}", f"{measured.value[i]:.4f}", f"{low[i]:.4f} to {high[i]:.4f}"]
            rows.append([*row, f"{true[i]:.4f}"] if true is not None else row)
    head = ["Quantity", "Measured", "95 % interval", *(["True (simulator)"] if truth else [])]
    return Table(head, rows)


def _states(material: Material, calibration: Calibration) -> Table:
    """Venue states, beside the calibrated one."""
    maps = calibration.maps
    weight = material.canvas.weights(maps.size) * maps.coverage
    rows = [["as calibrated", *_intervals(calibration.feedback), "not measured"]]
    for name, state in calibration.states.items():
        ambient = "none"
        if state.ambient is not None:
            mean = np.tensordot(weight, state.ambient, 2) / weight.sum()
            ambient = " / ".join(percent(v, 2) for v in mean)
        rows.append([name, *_intervals(state.feedback), ambient])
    return Table(
        ["Venue state", *(f"Feedback m, {c}" for c in PRIMARIES), "The room's own light"],
        rows,
        "An audience changes how much light bounces: in brackets the 95 % interval. The room's own "
        f"light, exit signs and the like, is the mean over the lit {material.word}, of white, "
        "red / green / blue.",
    )


def _intervals(measured: Measured) -> list[str]:
    low, high = measured.interval()
    return [
        f"{m:.4f} ({least:.4f} to {most:.4f})"
        for m, least, most in zip(measured.value, low, high, strict=True)
    ]


def _bounce_maps(material: Material, calibration: Calibration) -> Pictures:
    size = _map_size(calibration)
    inside = material.coverage(size) > WHOLE
    maps = calibration.maps
    albedo, scatter = (
        material.resized(m, size).mean(axis=-1) for m in (maps.albedo, maps.scatter_per_flux)
    )
    known = albedo[inside] if inside.any() else np.array([0.0, 1.0])
    low, high = np.percentile(known, (0.5, 99.5))
    reflect = Scale("albedo", float(low), float(max(high, low + 1e-3)))
    middle = float(scatter[inside].mean()) if inside.any() else 1.0
    relative = np.where(inside, scatter / max(middle, 1e-12) - 1, np.nan)
    spread = signed("against the mean [%]", extent(relative, 0.01))
    return Pictures(
        [
            painted(material, {"Albedo": np.where(inside, albedo, np.nan)}, reflect),
            painted(material, {"Bounced light against its mean": relative}, spread),
        ],
        "First: how much light each part of the screen reflects; seams and stains are darker. "
        "Second: where there is more (red) or less (blue) bounced light than on average."
        + (" On a perfect dome both would be flat." if material.is_dome else ""),
    )

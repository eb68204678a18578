"""Errors and intervals of whole calibrations in rooms that nobody designed for.

Every room is drawn at random (`simulators.drawn_rooms`): dome, paint, deck, wall, rig, camera and what its
owner knows. Each is captured, solved and compared with the truth. Writes studies/rooms.json and
studies/rooms.md; `python -m studies rooms` remakes them in an hour.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import simulators.truth
from procam.arrays import Array
from procam.errors import ProcamError
from procam.estimate.structured_light.patterns import LEVELS
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.interfaces import judge
from procam.model.calibration import Calibration
from simulators.scene import SceneSize
from simulators.template import room_text
from simulators.transport import Room
from studies.measure import side_by_side, write
from studies.photometry import calibrate_venue, response_errors, traced

ROOMS = range(101, 201)  # the first hundred were looked at when constants were set
SIZE = SceneSize(projector_size=(480, 300), camera_size=(600, 600), rays=1024)
TRUTH_SIZE = 512  # edge of its maps; the lit area is right to 1e-4
EVERY = 7  # pixel of a projector whose direction is compared


def calibrate_room(number: int, folder: Path, size: SceneSize = SIZE) -> dict[str, Any]:
    """Figures of one room; `refused` has procam's words if it would not calibrate."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "venue.toml").write_text(room_text(number, size))
    venue = load_venue(folder)
    row: dict[str, Any] = {"room": number, "projectors": len(venue.table.projectors)}
    row["intrinsics"] = next(iter(venue.table.cameras.values())).intrinsics
    try:
        found = load_calibration(calibrate_venue(venue))
    except ProcamError as error:
        return row | {"refused": str(error)}
    simulators.truth.write_truth(venue.backends["simulated"], folder, folder / "truth", {})
    return row | _figures(found, load_calibration(folder / "truth"))


def _figures(found: Calibration, truth: Calibration) -> dict[str, Any]:
    """Errors, and what was stated of them; light in the green channel, as channels share their errors."""
    floor = found.quality["floor_albedo_by_light"]
    relative, absolute = direction_errors(found, truth)
    return {
        "m": _compared(found.feedback.value[1], found.feedback.sigma[1], truth.feedback.value[1]),
        "albedo": _compared(found.albedo.value[1], found.albedo.sigma[1], truth.albedo.value[1]),
        "floor": _compared(
            floor.value, float(floor.note.removeprefix("sigma ")), truth.screen.floor_albedo
        ),
        "response": response_in_rooms(found, truth),
        "relative_arcmin": [relative, found.quality["direction_sigma_relative_arcmin"].value],
        "absolute_arcmin": [absolute, found.quality["direction_sigma_arcmin"].value],
        "notes": found.provenance.note_lines,
    }


def response_in_rooms(found: Calibration, truth: Calibration) -> list[list[float]]:
    """Errors of the projectors' responses at a quarter, half and three quarters, and their sigmas."""
    quarter = len(LEVELS) // 4
    both = response_errors(found, truth)
    return [np.round(part[:, quarter:-1:quarter, 1], 6).ravel().tolist() for part in both]


def _compared(value: float, sigma: float, true: float) -> list[float]:
    return [float(value), float(sigma), float(true)]


def direction_errors(found: Calibration, truth: Calibration) -> tuple[float, float]:
    """Root mean squares [arcmin] of direction errors less their common rotation, and of all."""
    a, b = list[Array](), list[Array]()
    for name, projector in truth.projectors.items():
        both = projector.surface.valid & found.projectors[name].surface.valid
        both &= np.indices(both.shape).sum(axis=0) % EVERY == 0
        a.append(found.projectors[name].surface.direction[both].astype(float))
        b.append(projector.surface.direction[both].astype(float))
    absolute, relative = judge.direction_errors(np.concatenate(a), np.concatenate(b))
    return _rms(relative), _rms(absolute)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown lines: a row per estimate."""
    solved = [row for row in rows if "refused" not in row]
    yield "| estimate | error: mean, rms, worst | within 95 % | mean of abs(z) | median sigma |"
    yield "|---|---|---|---|---|"
    for name, absolute in ("m", False), ("albedo", False), ("floor", True):
        value, sigma, true = np.array([row[name] for row in solved]).T
        unit = np.ones_like(true) if absolute else true
        yield _line(name, (value - true) / unit, sigma / unit)
    for name, what in ("relative", ", less a common rotation"), ("absolute", ""):
        wrong, stated = np.array([row[f"{name}_arcmin"] for row in solved]).T
        yield _line(f"directions{what} [arcmin]", wrong, stated)
    yield _line("response, of range", *np.concatenate([row["response"] for row in solved], axis=1))


def _line(name: str, error: Array, sigma: Array) -> str:
    """A row of the table: errors, and how they compare with their standard errors."""
    worst, z = error[np.abs(error).argmax()], np.abs(error) / sigma
    errors = f"{error.mean():+.4f}, {_rms(error):.4f}, {worst:+.4f}"
    return (
        f"| {name} | {errors} | {np.mean(z < 1.96):.0%} | {z.mean():.2f} | {np.median(sigma):.4f} |"
    )


def _row(number: int) -> dict[str, Any]:
    Room.trace = lambda surface, rays: traced(surface.preset, rays)
    simulators.truth.MASTER = TRUTH_SIZE
    with tempfile.TemporaryDirectory() as folder:
        return calibrate_room(number, Path(folder))


def main() -> None:
    """Run all rooms and write the results."""
    rows = side_by_side(_row, ROOMS)
    write("rooms", {"rows": rows}, ["# Rooms drawn at random", "", *table(rows)])

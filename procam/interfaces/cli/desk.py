"""`procam response`, `procam glare` and `procam vignetting`: a camera measured at a desk."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError, InputError
from procam.estimate.camera.glare_and_vignetting import (
    Vignetting,
    black_level,
    fit_glare,
    fit_vignetting,
    linear_light,
)
from procam.estimate.camera.radiance import Radiometer
from procam.files.atomic import write_text
from procam.files.images.images import read_image
from procam.files.images.photos import SUFFIXES, photo_counts, read_photo, write_response
from procam.files.venue.load import load_venue
from procam.interfaces.cli.output import Output
from procam.model.optics import CameraModel
from procam.workflows.capture.ingest import solve_brackets

Trap = tuple[float, float, float]


def run_response(folder: Path, exposures: str, out: Path, output: Output) -> None:
    """`procam response`: solve the curve of bracketed photographs and write OUT."""
    _check_out(out, ".csv")
    seconds = [_seconds(text) for text in exposures.split(",")] if exposures else []
    found = solve_brackets(folder, seconds)
    write_response(out, found.levels, found.light)
    worst = float(found.sigma.max())
    output.say(
        f"{len(found.exposures_s)} photographs, residual {found.residual:.2%} of the range; standard "
        f"error of the light {worst:.2%} of white at most"
    )
    output.say(f'{out} written; put it into the venue\'s folder and set response = "{out.name}"')
    output.finish(
        {
            "out": str(out),
            "residual": found.residual,
            "largest_sigma": worst,
            "exposures_s": found.exposures_s.tolist(),
            "levels": found.levels.tolist(),
            "light": found.light.tolist(),
            "sigma": found.sigma.tolist(),
        }
    )


def run_glare(
    photos: Sequence[Path],
    traps: Sequence[str],
    camera: tuple[Path, str],
    dark: Path | None,
    trap_sigma: float,
    out: Path,
    output: Output,
) -> None:
    """`procam glare`: the veil in a light trap; write its lines for venue.toml."""
    _check_out(out, ".toml")
    if not 0 <= trap_sigma < 1:
        raise InputError(f"--trap-sigma: got {trap_sigma:g}, expected a share from 0 to below 1")
    model = _camera(*camera)
    lines, document = [f"[cameras.{model.name}]"], dict[str, Any]()
    if dark is not None:
        level, error = black_level(_counts(dark, model), model.sensor.bits)
        model = replace(model, sensor=replace(model.sensor, black_level=level))
        lines.append(f"black_level = {level:.2f}  # +- {error:.2g}, from {dark.name}")
        document["black_level"] = {"value": level, "sigma": error}
    files = _files(photos)
    places = [_trap(text) for text in traps] * (len(files) if len(traps) == 1 else 1)
    if len(places) != len(files):
        raise InputError(
            f"--trap: got {len(traps)} for {len(files)} photographs, expected one for all, or one for "
            "each in their order"
        )
    radiometer = Radiometer(model)
    lights = [linear_light(_counts(path, model), radiometer) for path in files]
    veil = fit_glare(lights, places, radiometer.seen, trap_sigma=trap_sigma)
    each = ", ".join(f"{path.name} {g:.5f}" for path, g in zip(files, veil.each, strict=True))
    lines += [f"glare = {veil.glare:.5f}  # {each}", f"glare_sigma = {veil.sigma:.5f}", ""]
    write_text(out, "\n".join(lines))
    for line in lines[:-1]:
        output.say(line)
    output.say(f"{out} written; copy its lines into venue.toml")
    document["glare"] = {"value": veil.glare, "sigma": veil.sigma, "each": list(veil.each)}
    output.finish({"out": str(out), **document})


def run_vignetting(photos: Sequence[Path], camera: tuple[Path, str], output: Output) -> None:
    """`procam vignetting`: print its line for venue.toml."""
    model = _camera(*camera)
    plain = replace(model, sensor=replace(model.sensor, vignetting=()))
    radiometer, files = Radiometer(plain), _files(photos)
    lights = [linear_light(_counts(path, plain), radiometer) for path in files]
    found = fit_vignetting(lights, radiometer.rays, radiometer.seen)
    output.say(_line(found))
    output.say(
        f"light uneven by {found.uneven:.2%} round the axis in {len(files)} photographs; copy the line "
        f"under [cameras.{model.name}] in venue.toml"
    )
    output.finish(
        {
            "vignetting": found.coefficients.tolist(),
            "sigma": found.sigma.tolist(),
            "reach_deg": float(np.degrees(found.reach)),
            "uneven": found.uneven,
        }
    )


def _line(found: Vignetting) -> str:
    values = ", ".join(f"{value:.5f}" for value in found.coefficients)
    errors = ", ".join(f"{error:.2g}" for error in found.sigma)
    reach = np.degrees(found.reach)
    return f"vignetting = [{values}]  # +- {errors}; seen to {reach:.0f} degrees off the axis"


def _camera(venue: Path, name: str) -> CameraModel:
    cameras = load_venue(venue).cameras
    if name not in cameras:
        raise InputError(f"--camera: got {name!r}, expected one of {', '.join(cameras)}")
    return cameras[name]


def _files(photos: Sequence[Path]) -> list[Path]:
    """Photographs, and those of folders by name."""
    wanted = (*SUFFIXES, ".exr")
    found = list[Path]()
    for path in photos:
        inside = sorted(path.iterdir()) if path.is_dir() else [path]
        found += [p for p in inside if not path.is_dir() or p.suffix.lower() in wanted]
    if not found:
        raise FileFormatError(
            f"{', '.join(map(str, photos))}: got no photographs, expected some of {', '.join(wanted)}"
        )
    return found


def _counts(path: Path, camera: CameraModel) -> NDArray[Any]:
    """Linear counts (H, W, C), or light in floating point of an EXR, of the camera's size."""
    if path.suffix.lower() == ".exr":
        pixels = np.asarray(read_image(path), float)
        counts: NDArray[Any] = pixels[..., : 1 if pixels.shape[2] < 3 else 3]
    else:
        photo = read_photo(path)
        if photo.pixels.dtype == np.uint8:
            raise FileFormatError(
                f"{path}: got 8 bits, expected linear 16: a veil is below their last step; develop the "
                "raw file to linear 16-bit TIFF"
            )
        counts = photo_counts(photo, None, camera.sensor)
    height, width = counts.shape[:2]
    if (width, height) != tuple(camera.size):
        raise FileFormatError(
            f"{path}: got {width}x{height} px, expected {camera.size[0]}x{camera.size[1]} as venue.toml "
            "says; export it whole and unturned, or correct the camera's size"
        )
    return counts


def _trap(text: str) -> Trap:
    try:
        x, y, radius = (float(part) for part in text.split(","))
    except ValueError:
        x = y = radius = np.nan
    if not (np.isfinite([x, y, radius]).all() and radius > 0):
        raise InputError(
            f"--trap: got {text!r}, expected X,Y,RADIUS of the hole's inside in pixels, such as "
            "2000,1400,120"
        )
    return x, y, radius


def _seconds(text: str) -> float:
    """An exposure such as 1/60 or 0.5 [s]."""
    above, _, below = text.strip().partition("/")
    try:
        return float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError) as error:
        raise InputError(
            f"--exposures: got {text.strip()!r}, expected seconds such as 1/60 or 0.5, with commas between"
        ) from error


def _check_out(out: Path, suffix: str) -> None:
    if out.suffix != suffix:
        raise InputError(f"{out}: got the suffix {out.suffix!r}, expected {suffix}")
    if out.is_dir():
        raise InputError(f"{out}: got a folder, expected a file; choose another name for --out")
    if out.exists():
        raise InputError(f"{out}: got a file that exists, expected a new one; choose another name")

"""`procam lens glare`: a lens's veiling glare in a light trap."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from procam.errors import InputError
from procam.estimate.camera.glare_and_vignetting import black_level, fit_glare, linear_light
from procam.estimate.camera.radiance import Radiometer
from procam.files.venue.edit import Key
from procam.interfaces.cli._options import CameraOption, Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli.lens._flat_light import (
    FlatPhotosOption,
    linear_counts,
    linear_photographs,
    named_camera,
)
from procam.interfaces.cli.lens._into import VenueIntoOption, give

EXAMPLE = (
    "procam lens glare --photos desk --trap 2000,1400,40 --trap 900,700,40 --dark cap.tif --into my-dome "
    "--camera zenith"
)
Trap = tuple[float, float, float]  # x, y, radius [px]
WIDE = 0.02  # radius of a hole, of the picture's shorter side, from which it misses some of a veil


def glare(
    *,
    photos: FlatPhotosOption,
    trap: Annotated[
        list[str],
        typer.Option(help="X,Y,RADIUS of the hole's inside in pixels: one for all, or one each."),
    ],
    into: VenueIntoOption,
    camera: CameraOption,
    dark: Annotated[
        Path | None, typer.Option(help="Photograph with the cap on; gives black_level too.")
    ] = None,
    trap_sigma: Annotated[
        float, typer.Option(help="Light of the trap itself, as a share of the mean around it.")
    ] = 5e-4,
    json: Json = False,
) -> None:
    """Measure a lens's veiling glare with a light trap in the middle of a bright surface.

    A box lined with black velvet with a small hole, in front of a bright surround that fills the
    picture and is nowhere white. In a wide hole the part of the veil that stays near its light does not
    show: let its radius be 1 or 2 % of the picture. The light in the hole is the veiling glare. Take
    three photographs or more with the trap at different places: how they differ goes into glare_sigma.
    """
    output = Output(json)
    if not 0 <= trap_sigma < 1:
        raise InputError(f"--trap-sigma is {trap_sigma:g}; it must be a share, from 0 to below 1")
    model = named_camera(into, camera)
    keys, document = list[Key](), dict[str, Any]()
    if dark is not None:
        level, error = black_level(linear_counts(dark, model), model.sensor.bits)
        model = replace(model, sensor=replace(model.sensor, black_level=level))
        keys.append(Key("black_level", round(level, 2), f"{error:.2g}, from {dark.name}"))
        document["black_level"] = {"value": level, "sigma": error}
    files = linear_photographs(photos)
    places = _places(trap, len(files))
    radiometer = Radiometer(model)
    lights = [linear_light(linear_counts(path, model), radiometer) for path in files]
    veil = fit_glare(lights, places, radiometer.seen, trap_sigma=trap_sigma)
    each = ", ".join(f"{path.name} {g:.5f}" for path, g in zip(files, veil.each, strict=True))
    keys.append(Key("glare", round(veil.glare, 5), f"{veil.sigma:.2g}; {each}"))
    keys.append(Key("glare_sigma", round(veil.sigma, 5)))
    give(into, camera, keys, output)
    notes = _notes(max(radius for *_, radius in places) / min(radiometer.seen.shape))
    for note in notes:
        output.say(note)
    document["glare"] = {"value": veil.glare, "sigma": veil.sigma, "each": list(veil.each)}
    output.finish({"notes": notes, **document})


def _notes(radius: float) -> list[str]:
    if radius <= WIDE:
        return []
    return [
        f"The hole's radius is {radius:.1%} of the picture: veil that stays near its light hardly shows in "
        f"it and is missing from glare. Take photographs from further away, with {WIDE:.0%} or less."
    ]


def _places(traps: list[str], photographs: int) -> list[Trap]:
    """The trap's place in each photograph."""
    places = [_place(text) for text in traps] * (photographs if len(traps) == 1 else 1)
    if len(places) != photographs:
        raise InputError(
            f"--trap is given {len(traps)} times for {photographs} photographs; give it once for all, or "
            "once for each in their order"
        )
    return places


def _place(text: str) -> Trap:
    try:
        x, y, radius = (float(part) for part in text.split(","))
    except ValueError:
        x = y = radius = np.nan
    if not (np.isfinite([x, y, radius]).all() and radius > 0):
        raise InputError(
            f"--trap {text!r} is not X,Y,RADIUS of the hole's inside in pixels, such as 2000,1400,40"
        )
    return x, y, radius

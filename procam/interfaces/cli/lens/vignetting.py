"""`procam lens vignetting`: how a lens darkens towards the rim."""

from dataclasses import replace

import numpy as np

from procam.estimate.camera.glare_and_vignetting import Vignetting, fit_vignetting, linear_light
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

EXAMPLE = "procam lens vignetting --photos flat --into my-dome --camera zenith"


def vignetting(
    *, photos: FlatPhotosOption, into: VenueIntoOption, camera: CameraOption, json: Json = False
) -> None:
    """Measure how a lens darkens towards the rim, for venue.toml.

    Photographs of an evenly lit white surface that fills the picture, or of the inside of an
    integrating sphere; four, with the camera turned by 90 degrees about its axis after each.
    """
    output, model = Output(json), named_camera(into, camera)
    plain = replace(model, sensor=replace(model.sensor, vignetting=()))
    radiometer, files = Radiometer(plain), linear_photographs(photos)
    lights = [linear_light(linear_counts(path, plain), radiometer) for path in files]
    found = fit_vignetting(lights, radiometer.rays, radiometer.seen)
    output.say(f"light uneven by {found.uneven:.2%} round the axis in {len(files)} photographs")
    give(into, camera, [_key(found)], output)
    output.finish(
        {
            "vignetting": found.coefficients.tolist(),
            "sigma": found.sigma.tolist(),
            "reach_deg": float(np.degrees(found.reach)),
            "uneven": found.uneven,
        }
    )


def _key(found: Vignetting) -> Key:
    errors = ", ".join(f"{error:.2g}" for error in found.sigma)
    reach = f"seen to {np.degrees(found.reach):.0f} degrees off the axis"
    return Key("vignetting", found.coefficients.round(5).tolist(), f"{errors}; {reach}")

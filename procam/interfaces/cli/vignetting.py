"""`procam vignetting`: how a lens darkens towards the rim."""

from dataclasses import replace

import numpy as np

from procam.estimate.camera.glare_and_vignetting import Vignetting, fit_vignetting, linear_light
from procam.estimate.camera.radiance import Radiometer
from procam.interfaces.cli._flat_light import linear_counts, linear_photographs, named_camera
from procam.interfaces.cli._options import CameraOption, CameraVenueOption, Json, PhotosArgument
from procam.interfaces.cli._output import Output

EXAMPLE = "procam vignetting flat/*.tif --venue my-dome --camera zenith"


def vignetting(
    photos: PhotosArgument, *, venue: CameraVenueOption, camera: CameraOption, json: Json = False
) -> None:
    """Measure how a lens darkens towards the rim; prints the line for venue.toml.

    Photographs of an evenly lit white surface that fills the picture, or of the inside of an
    integrating sphere; four, with the camera turned by 90 degrees about its axis after each.
    """
    output, model = Output(json), named_camera(venue, camera)
    plain = replace(model, sensor=replace(model.sensor, vignetting=()))
    radiometer, files = Radiometer(plain), linear_photographs(photos)
    lights = [linear_light(linear_counts(path, plain), radiometer) for path in files]
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

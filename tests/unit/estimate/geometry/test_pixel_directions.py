"""The measured field on top of the model."""

from dataclasses import replace

import numpy as np
from domes import SimulatedDome

from procam.estimate.geometry.pixel_directions import (
    CELL_PX,
    PixelDirections,
    fit_pixel_directions,
    model_directions,
)
from procam.estimate.geometry.solve import solve_geometry
from procam.maths.geometry.sphere import ARCMIN, angle_between, normalise
from simulators.observations import lit_points
from simulators.presets import REALISTIC


def test_the_field_is_added_per_cell_of_the_panel() -> None:
    rig = SimulatedDome.build(1).rig()
    projector = rig.projectors["south"]
    width, height = (-(-n // CELL_PX) for n in projector.size)
    field = np.zeros((height, width, 3), np.float32)
    field[5, 7] = [1e-3, 0, 0]
    zero = np.zeros((2, 2), np.float32)
    found = PixelDirections(rig, projector, field, zero, zero, {})
    centre = (np.array([[[7, 5], [9, 5]]]) + 0.5) * CELL_PX - 0.5  # of that cell, and of another
    model = model_directions(rig, projector, centre)
    expected = normalise(model[0, 0] + [1e-3, 0, 0])
    np.testing.assert_allclose(found.at(centre)[0, 0], expected, atol=1e-7)
    np.testing.assert_allclose(found.at(centre)[0, 1], model[0, 1], atol=1e-12)


def test_measurements_correct_a_model_without_the_domes_panels() -> None:
    dome = SimulatedDome.build(5, REALISTIC)
    found = solve_geometry(dome.problem(dome.observations(24), most_degree=0))
    x, y = np.arange(7, 1920, 40), np.arange(9, 1200, 40)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
    build = dome.projectors[0]
    true = normalise(lit_points(dome.surface, build, pixels.reshape(-1, 2))).reshape(
        *pixels.shape[:2], 3
    )
    fitted = fit_pixel_directions(found, build.name)
    alone = replace(fitted, field=np.zeros_like(fitted.field))
    rms = [
        float(np.sqrt(np.nanmean((ARCMIN * angle_between(each.at(pixels), true)) ** 2)))
        for each in (fitted, alone)
    ]
    assert rms[0] < 0.7 * rms[1]
    # neighbours share errors: the mean square of z is known to a third, not to 1 / sqrt(pixels)
    z = ARCMIN * angle_between(fitted.at(pixels), true) / fitted.sigma_arcmin(x, y)
    assert 0.6 < np.sqrt(np.nanmean(z**2)) < 1.4

"""One projector of a calibration, from its light in camera channels."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.footprint import project_surface
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.separation import SeparatedLight
from procam.maths.warp import sample
from procam.model.calibration import ProjectorCalibration
from procam.model.mask import Nudge
from procam.model.photometry import Photometry
from procam.model.screen import Screen


@dataclass(frozen=True, slots=True)
class Placed:
    """What places the light of projectors on the screen: arguments of `project_surface`."""

    geometry: GeometrySolution
    screen: Screen
    view: ScreenView
    nudges: Sequence[Nudge]
    moved_arcmin: float

    @classmethod
    def of(
        cls,
        geometry: GeometrySolution,
        screen: Screen,
        view: ScreenView,
        nudges: Sequence[Nudge],
        measured: Iterable[ProjectorMeasurement],
    ) -> "Placed":
        """With the most that the camera turned while the projectors `measured` were photographed."""
        pixels = max(each.moved_px for each in measured)
        moved = float(60 * np.degrees(pixels / np.mean(view.camera.lens.focal)))
        return cls(geometry, screen, view, nudges, moved)


def unblended_projector(
    placed: Placed, name: str, measured: ProjectorMeasurement, content_from_camera: Array
) -> ProjectorCalibration:
    """Projector `name`, its gain in content channels, at each pixel's direction; its blend is NaN.

    `content_from_camera` (3, 3) converts radiance.
    """
    light, model = content_light(measured, content_from_camera), placed.geometry.projectors[name]
    screen, view, rest = placed.screen, placed.view, (placed.nudges, placed.moved_arcmin)
    surface = project_surface(placed.geometry, name, screen, view, light, *rest)
    at = view.camera_pixels(screen, np.nan_to_num(surface.direction))
    gain = np.maximum(sample(light.extended(), at), 0) * surface.valid[..., None]
    mix = content_from_camera @ (measured.colour.mix * measured.white[:, None])
    mix = np.asarray(mix / mix.sum(axis=1, keepdims=True), float)
    photometry = Photometry(measured.response, mix, gain, measured.exponent)
    return ProjectorCalibration(model, surface, photometry, np.full_like(surface.measured, np.nan))


def content_light(measured: ProjectorMeasurement, content_from_camera: Array) -> SeparatedLight:
    """A projector's white in content channels; not kept, for twice the light is much memory."""
    light, small = measured.light, content_from_camera.T.astype(np.float32)
    return replace(
        light,
        direct=light.direct @ small,
        scattered=light.scattered @ small,
        flux=light.flux @ content_from_camera.T,
    )


class ContentLight(Mapping[str, SeparatedLight]):
    """Light of projectors in content channels, converted when it is used."""

    def __init__(self, measured: Mapping[str, ProjectorMeasurement], matrix: Array) -> None:
        self._measured, self._matrix = measured, matrix

    def __getitem__(self, name: str) -> SeparatedLight:
        return content_light(self._measured[name], self._matrix)

    def __iter__(self) -> Iterator[str]:
        return iter(self._measured)

    def __len__(self) -> int:
        return len(self._measured)

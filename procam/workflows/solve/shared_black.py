"""Black of a rig whose projectors procam cannot make dark: estimated, noted, and with its error."""

from collections.abc import MutableMapping
from dataclasses import dataclass, replace

import numpy as np

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.shared_black import SharedBlack, fit_shared_black
from procam.files.venue.load import Venue
from procam.files.venue.tables import BY_HAND
from procam.model.calibration import Calibration
from procam.model.provenance import Note
from procam.model.quality import Figure
from procam.workflows.capture.session_images import SessionImages

LIT = 0.99  # coverage


@dataclass(frozen=True, slots=True)
class BlackLight:
    """Names of projectors that are never dark, and the fit of their blacks."""

    names: tuple[str, ...] = ()
    fit: SharedBlack | None = None

    @property
    def notes(self) -> list[Note]:
        """A note on black, if it had to be estimated."""
        if self.fit is None:
            return []
        # what is no brighter than its error is not measured
        error = float(np.minimum(self.fit.sigma / np.maximum(self.fit.total, 1e-12), 1).mean())
        text = (
            f"black of {', '.join(self.names)}: procam has no shutter to close there, so photographs of the "
            f"dark hold it. The sum of these blacks is estimated from the dark to +-{error:.0%}; light of "
            "the room may be part of it. To measure it give them a control, or photograph by hand, with "
            "lamps off or lenses covered in the dark (procam session plan)"
        )
        return [Note("shared black", "", text)]

    def figures(self, calibration: Calibration) -> dict[str, Figure]:
        """Direct light of black of the lit dome, and its standard error."""
        if self.fit is None:
            return {}
        maps = calibration.maps
        value = maps.lo[maps.coverage > LIT].mean(axis=0, dtype=float)
        sigma = value * self.fit.sigma / np.maximum(self.fit.total, 1e-12)
        note = f"estimated: {', '.join(self.names)} cannot be made dark"
        return {"black_level": Figure(value.tolist(), "rel", note=note, sigma=sigma.tolist())}


def never_dark(venue: Venue) -> tuple[str, ...]:
    """Projectors that procam drives and has no shutter of."""
    return tuple(
        name
        for name, table in venue.table.projectors.items()
        if table.backend != BY_HAND and table.control is None
    )


def with_shared_black(
    venue: Venue,
    images: SessionImages,
    view: ScreenView,
    measured: MutableMapping[str, ProjectorMeasurement],
    projector: str = "",
) -> BlackLight:
    """Estimate the blacks of measurements where the photographs of the dark hold them, and put them in.

    By the dark of the session, or of when a projector was photographed again.
    """
    names = never_dark(venue)
    if not names:
        return BlackLight()
    _, dark = images.dark(projector)
    lights = {name: measured[name].light for name in names}
    fit = fit_shared_black(dark, lights, view.direction, view.on_screen)
    for name in names:
        black = fit.black(name, measured[name].light)
        measured[name] = replace(measured[name], black=black)
    return BlackLight(names, fit)

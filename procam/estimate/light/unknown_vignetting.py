"""Vignetting that venue.toml does not have, by the scattered light of the dome.

Overlaps of projectors cannot show it: there the same camera pixels see both. But scattered light is nearly
uniform over a dome, wherever direct light falls, so what a camera sees of it falls towards the edge of the
picture as its lens does, apart from paint and from what the floor returns (docs/theory/photometry.md).
"""

import numpy as np

from procam.arrays import Image
from procam.estimate.geometry.camera_view import ScreenView
from procam.maths.geometry.lenses import unproject
from procam.model.provenance import Note

# rms over the screen of what an unknown lens takes: 0.04 by a fisheye that leaves 85 % at 90 degrees
USUAL = 0.04


def unknown_vignetting(per_flux: Image, view: ScreenView) -> float:
    """Relative rms over the screen of the vignetting that is not known; 0 if venue.toml has one, be it [0].

    Parameters
    ----------
    per_flux : (H, W, C) scattered light per flux at camera pixels.

    Notes
    -----
    Gains take the vignetting for the projectors' own: they have this relative standard error.
    """
    if view.camera.sensor.vignetting:
        return 0.0
    return max(USUAL, abs(_fall(per_flux, view)[1]))


def vignetting_notes(per_flux: Image, view: ScreenView) -> list[Note]:
    """A note that the lens has no vignetting in venue.toml, with the size of its effect."""
    rms = unknown_vignetting(per_flux, view)
    if not rms:
        return []
    edge, camera = _fall(per_flux, view)[0], view.camera.name
    seen = f"falls by {edge:.0%}" if edge > 0 else "does not fall"
    text = (
        f"venue.toml has no vignetting of its lens, and scattered light {seen} towards the "
        f"edge of its picture; gains and black carry it, by about {rms:.0%} and most at the edge, and the "
        "standard errors of m and albedo include it. Measure it with `procam lens vignetting`; [0] is "
        "for a lens that was found to have none"
    )
    return [Note("vignetting unknown", f"camera {camera}", text, rms / USUAL)]


def _fall(per_flux: Image, view: ScreenView) -> tuple[float, float]:
    """Relative fall of scattered light to the edge, and its rms over the screen, by a line in theta^2."""
    light, camera = per_flux.mean(axis=-1), view.camera
    use = view.on_screen & (light > 0)
    rows, columns = np.nonzero(use)
    if len(rows) < 2:
        return 0.0, 0.0
    rays = unproject(np.stack([columns, rows], axis=1).astype(float), camera.lens)
    theta2 = np.arccos(np.clip(rays[:, 2], -1, 1)) ** 2
    solid, log_light = view.weight[use].astype(float), np.log(light[use].astype(float))
    away = theta2 - np.average(theta2, weights=solid)
    square = np.average(away**2, weights=solid)
    slope = np.average(away * log_light, weights=solid) / max(square, 1e-12)
    edge = 1 - np.exp(slope * theta2.max())
    return float(edge), float(abs(slope) * np.sqrt(square))

"""Edge blends that projectors' own menus make, found in the light of their pixels."""

from collections.abc import Iterator, Mapping

import numpy as np

from procam.arrays import BoolArray, Image
from procam.model.calibration import ProjectorCalibration

DIM = 0.8  # of the light of pixels further inside; lenses take less, away from the corners
INSIDE = 0.25, 0.4  # of the panel: where the light is compared with
NOTED = 0.01  # of the panel; a blackout plate is sharper
GREEN = 1


def edge_blend_notes(projectors: Mapping[str, ProjectorCalibration]) -> list[str]:
    """Notes on projectors whose pixels get dark towards an edge of the panel.

    A pixel's light is its gain times its solid angle, which does not depend on where it lands. The gains
    take a blend into account, and the picture is right, but the black of a blend is not, and common white
    is lower than it could be.
    """
    notes = []
    for name, projector in projectors.items():
        surface = projector.surface
        light = projector.photometry.gain[..., GREEN] * surface.solid_angle_sr
        found = {side: share for side, share in _dim_shares(light, surface.valid) if share > NOTED}
        if found:
            where = ", ".join(f"{side} {share:.0%}" for side, share in found.items())
            notes.append(
                f"projector {name}: its pixels get darker towards the edge of its picture ({where} of it); an "
                "edge blend in its menu or in the player seems to be on. procam blends by itself: switch it "
                "off and calibrate again"
            )
    return notes


def _dim_shares(light: Image, valid: BoolArray) -> Iterator[tuple[str, float]]:
    """Share of the panel over which its light (H, W) falls towards each edge."""
    for side, turned, used in (
        ("left", light, valid),
        ("right", light[:, ::-1], valid[:, ::-1]),
        ("top", light.T, valid.T),
        ("bottom", light.T[:, ::-1], valid.T[:, ::-1]),
    ):
        lines, length = turned.shape
        middle = slice(lines // 4, lines - lines // 4)
        rows, use = turned[middle], used[middle]
        inside = slice(int(INSIDE[0] * length), int(INSIDE[1] * length))
        if not use[:, inside].any():
            continue
        usual = float(np.median(rows[:, inside][use[:, inside]]))
        edge = slice(0, inside.start)
        dim = use[:, edge] & (rows[:, edge] < DIM * usual)
        yield side, float(np.median(dim.sum(axis=1))) / length

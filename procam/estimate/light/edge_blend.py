"""Edge blends that projectors' own menus make, found in the light of their pixels."""

from collections.abc import Iterator, Mapping

import numpy as np

from procam.arrays import BoolArray, Image
from procam.model.calibration import ProjectorCalibration
from procam.model.provenance import Note

STEP = 0.04  # of the panel; over it lenses take a tenth at most
DIM = 0.82  # of the light a step further inside
# times the fall, in logarithms, of the step before: a hot spot falls off evenly, a blend ends at nothing
STEEPER = 1.5
CUT = 0.05  # of the panel: where light begins further inside, a plate or the rim of the dome cuts it off
SOFT_PX = 3  # the lens's blur takes light from the outermost pixels
GREEN = 1


def edge_blend_notes(projectors: Mapping[str, ProjectorCalibration]) -> list[Note]:
    """Notes on projectors whose pixels get dark towards an edge of the panel.

    A pixel's light is its gain times its solid angle, which does not depend on where it lands. The gains
    take a blend into account, and the picture is right, but the black of a blend is not, and common white
    is lower than it could be.
    """
    notes = []
    for name, projector in projectors.items():
        if projector.photometry.exponent is not None:
            continue  # a media server, whose own blend must stay on
        surface = projector.surface
        light = projector.photometry.gain[..., GREEN] * surface.solid_angle_sr
        dim = [
            side
            for side, share, further in _shares_at_edges(light, surface.valid)
            if share < min(DIM, further**STEEPER)
        ]
        if dim:
            text = (
                f"its pixels get darker towards the edge of its picture ({', '.join(dim)}); an edge blend in "
                "its menu or in the player seems to be on. procam blends by itself: switch it off and "
                "calibrate again"
            )
            notes.append(Note("edge blend", f"projector {name}", text, float(len(dim))))
    return notes


def _shares_at_edges(light: Image, valid: BoolArray) -> Iterator[tuple[str, float, float]]:
    """Light (H, W) at each edge of what is valid, over that a step further inside, and the same of there.

    Medians of lines.
    """
    for side, turned, used in (
        ("left", light, valid),
        ("right", light[:, ::-1], valid[:, ::-1]),
        ("top", light.T, valid.T),
        ("bottom", light.T[:, ::-1], valid.T[:, ::-1]),
    ):
        count, length = turned.shape
        step = max(SOFT_PX, round(STEP * length))
        first = used.argmax(axis=1) + SOFT_PX
        lines = np.arange(count // 4, count - count // 4)
        lines = lines[used[lines].any(axis=1) & (first[lines] < SOFT_PX + CUT * length)]
        at = first[lines, None] + np.arange(max(SOFT_PX, step // 4))
        edge, inside, further = (
            turned[lines[:, None], at + s].mean(axis=1) for s in (0, step, 2 * step)
        )
        sound = np.minimum(inside, further) > 0
        if sound.any():
            at_edge, before = edge[sound] / inside[sound], inside[sound] / further[sound]
            yield side, float(np.median(at_edge)), float(np.median(before))

"""Closed loop: corrections of a compensated picture, and of its calibration, from photographs of it.

`patches` has the update on patches of any dome (`LoopState`) and the stop criteria; `dome` applies it to a
dome master through the main camera (`DomeLoop`), `gains` decides how much of it is the gains' and
`refined` makes a calibration of the result; `brackets` merges exposures where one is not enough.
"""

from procam.estimate.closed_loop.brackets import bracket_for, merged_frame
from procam.estimate.closed_loop.dome import DomeLoop, LoopCells, noise_by_level
from procam.estimate.closed_loop.patches import LoopObservation, LoopState, PatchScatter
from procam.estimate.closed_loop.refined import with_gains, with_scatter

__all__ = [
    "DomeLoop",
    "LoopCells",
    "LoopObservation",
    "LoopState",
    "PatchScatter",
    "bracket_for",
    "merged_frame",
    "noise_by_level",
    "with_gains",
    "with_scatter",
]

"""Test patterns for a projector's settings (menu), and the analysis of their photographs.

`patterns` are shown, `patches` finds them in photographs and reads their light, `analysis` computes the
effects that would spoil a calibration.
"""

from procam.estimate.projector_tests.analysis import (
    Effect,
    Steps,
    StripedView,
    clipped_black,
    clipped_white,
    colour_effects,
    load_effect,
    persistence_effect,
    sharpness_effect,
    slant_effect,
    step_light,
)
from procam.estimate.projector_tests.patches import Patches, PatchLight, direct_light, find_patches

__all__ = [
    "Effect",
    "PatchLight",
    "Patches",
    "Steps",
    "StripedView",
    "clipped_black",
    "clipped_white",
    "colour_effects",
    "direct_light",
    "find_patches",
    "load_effect",
    "persistence_effect",
    "sharpness_effect",
    "slant_effect",
    "step_light",
]

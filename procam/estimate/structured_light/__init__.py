"""Structured light: codes, their patterns, and the projector pixel that each camera pixel saw.

`codes` and `patterns` make what is shown; `decode` turns the photographs into a correspondence map,
with `stripes` or `axis` per coordinate; the other modules check photographs and correct the map.
"""

from procam.estimate.structured_light.codes import CODES, Code, generate, make_code
from procam.estimate.structured_light.decode import Decoded, Decoder
from procam.estimate.structured_light.limits import DecodeLimits, default_limits
from procam.estimate.structured_light.panel_map import drop_inconsistent, fit_projector_map
from procam.estimate.structured_light.patterns import plan_of, plan_session

__all__ = [
    "CODES",
    "Code",
    "DecodeLimits",
    "Decoded",
    "Decoder",
    "default_limits",
    "drop_inconsistent",
    "fit_projector_map",
    "generate",
    "make_code",
    "plan_of",
    "plan_session",
]

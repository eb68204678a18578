"""Hot loops over pictures: one small C library and a NumPy twin of every function.

The library is built with the package and picks its instruction set at run time (`active`, `use`, or
PROCAM_KERNELS in the environment); without it the twins of `procam.kernels.reference` run, which
are also what the tests hold it against. All functions take uint8, uint16 or float32 pictures.
"""

from procam.kernels.gray import fold_pairs
from procam.kernels.loader import LEVELS, active, available, forced, use
from procam.kernels.phase import wrapped_phase
from procam.kernels.reference import PhaseFit
from procam.kernels.search import search_phase

__all__ = [
    "LEVELS",
    "PhaseFit",
    "active",
    "available",
    "fold_pairs",
    "forced",
    "search_phase",
    "use",
    "wrapped_phase",
]

"""Projector columns from sinusoids of several periods."""

from procam.kernels.search.api import search_phase
from procam.kernels.search.reference import PhaseFit

__all__ = ["PhaseFit", "search_phase"]

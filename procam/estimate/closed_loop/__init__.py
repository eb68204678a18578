"""Corrections learnt from photographs of a compensated picture."""

"""Fixtures of the small closed loop."""

from small_loop import cells, direct, few_cells, loop

__all__ = ["cells", "direct", "few_cells", "loop"]

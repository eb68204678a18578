"""The report of a venue, one HTML file.

`page` writes it and `data` reads the venue's folder; `dome`, `light` and `hand` make the sections from the
parts in `blocks` and the texts in `words`.
"""

from procam.interfaces.report.page import write_report

__all__ = ["write_report"]

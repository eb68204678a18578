"""The report of a venue, one HTML file, and the sheet for its operators.

`page` writes the report and `data` reads the venue's folder; `cover`, `acceptance`, `dome`, `light`, `drift`
and `hand` make its parts from the `blocks` and the texts in `words`. `sheet` writes the operators' page.
"""

from procam.interfaces.report.page import write_report

__all__ = ["write_report"]

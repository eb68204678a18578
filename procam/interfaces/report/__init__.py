"""`report.html`: one page, one file, that shows a venue to those who pay for it."""

from procam.interfaces.report.page import write_report

__all__ = ["write_report"]

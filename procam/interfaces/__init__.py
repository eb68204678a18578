"""Interfaces to people and scripts: the command line, the report, the judge."""

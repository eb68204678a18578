"""Sphinx: the documentation site (`make docs`). Warnings are errors."""

import re

import procam

project = "procam"
copyright = "the procam authors, Apache-2.0"
release = procam.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
]
html_theme = "furo"
html_title = "procam"
exclude_patterns = ["_build"]
autosummary_generate = True
autodoc_typehints = "none"
napoleon_google_docstring = False
autodoc_member_order = "bysource"
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

PARAMETER = re.compile(r"^([\w*][\w*, ]*) : (.*)", re.MULTILINE)


def describe_rather_than_type(_app, _what, _name, _obj, _options, lines):
    """Docstrings have `name : shape and meaning`, where napoleon expects a type after the colon."""
    lines[:] = PARAMETER.sub(r"\1\n    \2", "\n".join(lines)).split("\n")


def setup(app):
    """Run before napoleon, which has the priority 500."""
    app.connect("autodoc-process-docstring", describe_rather_than_type, priority=400)

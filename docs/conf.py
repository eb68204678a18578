"""Sphinx: the documentation site (`make docs`). Warnings are errors."""

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
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

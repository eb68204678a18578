"""The page of a preference test, from the template `page_template.html`."""

from collections.abc import Callable, Mapping
from importlib import resources
from typing import Any

from procam.errors import InputError
from procam.interfaces.plots.figure import EXTRA


def page_renderer() -> Callable[[Mapping[str, Any]], str]:
    """What makes the page of a plan without names of methods (`Plan.for_page`).

    Raises
    ------
    InputError
        jinja2 is not installed.
    """
    try:
        from jinja2 import Environment, StrictUndefined  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            f"ask: jinja2 is not installed, which writes the page; run: {EXTRA}"
        ) from error
    text = resources.files(__package__).joinpath("page_template.html").read_text("utf-8")
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(text)

    def render(plan: Mapping[str, Any]) -> str:
        return str(template.render(plan=dict(plan)))

    return render

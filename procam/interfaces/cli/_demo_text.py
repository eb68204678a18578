"""The result of `procam demo` in about ten lines for people."""

from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import Any

from procam.interfaces.report.data import Material
from procam.interfaces.report.words import limits_text, miss_text, number, percent

COLUMNS, LABEL = 100, 16
MASTER_PX = 4096  # edge of the dome master that errors are compared with
MASTER_PIXEL_ARCMIN = 180 * 60 / MASTER_PX
# a terminal may lack what the report's texts use
ASCII = str.maketrans(
    {
        "\N{NARROW NO-BREAK SPACE}": " ",
        "\N{NO-BREAK SPACE}": " ",
        "\N{MINUS SIGN}": "-",
        "\N{PLUS-MINUS SIGN}": "+-",
    }
)
Entries = Mapping[str, Mapping[str, Any]]


def result_lines(material: Material) -> Iterator[str]:
    """What was measured and what compensation achieved, a short paragraph each."""
    parts = {
        "Geometry": _geometry(material.figures, material.preset == "server"),
        "Screen": _screen(material),
        "Bounced light": _bounced_light(material.figures),
        "Picture": _picture(material.figures),
        "Not removed": _not_removed(material),
        "Time": _time(material.figures),
        "Goals missed": " ".join(
            miss_text(n, e) for n, e in material.figures.items() if e["pass"] is False
        ),
    }
    for label, text in parts.items():
        if text:
            lines = wrap(labelled(label, text), COLUMNS, subsequent_indent=" " * LABEL)
            yield from (line.translate(ASCII) for line in lines)


def labelled(label: str, text: object) -> str:
    """A line with its label in front."""
    return f"{label + ':':{LABEL}}{text}"


def _geometry(figures: Entries, through_server: bool) -> str:
    if "direction_error_rms_arcmin" not in figures:
        return ""
    relative, absolute = (
        figures[f"direction_error_{x}rms_arcmin"]["value"] for x in ("relative_", "")
    )
    who = "the media server's pixels" if through_server else "projector pixels"
    return (
        f"{who} are {number(relative, 2)} arcmin off relative to each other (root mean square), or "
        f"{number(relative / MASTER_PIXEL_ARCMIN, 2)} pixels of a dome master of {MASTER_PX} px; with the "
        f"survey of the marks {number(absolute, 2)} arcmin. A sharp eye resolves 1 arcmin."
    )


def _screen(material: Material) -> str:
    sphere = material.figures.get("dome_is_sphere")
    if sphere is None or material.calibration is None:
        return ""
    if sphere["value"]:
        return "a sphere, as far as the cameras can measure."
    degree = material.calibration.screen.degree
    solved = f"its shape was solved up to harmonics of degree {degree}"
    return f"not a sphere; {solved if degree else 'its shape could not be solved'}."


def _bounced_light(figures: Entries) -> str:
    names = ("scatter_left_refined", "scatter_left_exact")
    left = next((figures[name] for name in names if name in figures), None)
    if left is None or "scatter_before" not in figures:
        return ""
    before, after = figures["scatter_before"]["value"], left["value"]
    text = f"it adds {percent(before, 2)} of white to the picture before compensation; "
    alone = figures.get("interreflection_left")
    if alone is None:
        return f"{text}{percent(after, 2)} of it remains after compensation."
    return (
        f"{text}{percent(alone['value'], 2)} of it remains where projectors draw exactly what they are asked "
        f"for, {percent(after, 2)} as they draw."
    )


def _picture(figures: Entries) -> str:
    if "picture_error_jnd" not in figures:
        return ""
    after, before = (number(figures[f"picture_error_jnd{x}"]["value"], 2) for x in ("", "_before"))
    return (
        f"95 % of all that is lit is within {after} just noticeable differences of what was meant; "
        f"uncompensated within {before}."
    )


def _not_removed(material: Material) -> str:
    limits = material.limits()
    if limits is None:
        return ""
    return limits_text(float(limits.too_bright.mean()), float(limits.too_dark.mean()))


def _time(figures: Entries) -> str:
    seconds, shots = (figures.get(name) for name in ("simulated_run_s", "shots"))
    if seconds is None or shots is None:
        return ""
    return f"{seconds['value']:.0f} s on this computer, with {shots['value']} photographs."

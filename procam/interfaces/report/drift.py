"""The section on drift: figures of the calibration in use against one of an earlier capture."""

from collections.abc import Iterator

from procam.files.history.read import (
    MARKED_SIGMAS,
    FigureDifference,
    calibration_before,
    figure_differences,
)
from procam.interfaces.report.blocks import Block, Table, Text, calibrating, not_there
from procam.interfaces.report.data import Material
from procam.interfaces.report.words import number, words_for
from procam.model.acceptance import CRITERIA
from procam.model.photometry import PRIMARIES

LIGHT = {
    "feedback": "Feedback m",
    "albedo": "Albedo",
    "white_in_camera": "White, as the camera sees it",
}
CHANNELS = dict(zip("RGB", PRIMARIES, strict=True))


def drift(material: Material) -> Iterator[Block]:
    """What changed since the newest earlier calibration of another capture."""
    if material.used is None:
        yield not_there("Drift of the venue", calibrating(material))
        return
    now = material.used.name
    before = calibration_before(material.directory, now)
    if before is None:
        yield Text(
            "There is no calibration of an earlier capture to compare with. The next one will show how far "
            "the venue drifts."
        )
        return
    shown = [
        (title, row)
        for row in figure_differences(material.directory, before, now)
        if (title := _title(row.name))
    ]
    yield Text(_summary(before, now, [title for title, row in shown if row.is_marked]))
    head = ["Figure", before, now, "Difference", "In standard errors"]
    yield Table(
        head,
        [[title, *_cells(row)] for title, row in shown],
        f"Differences beyond {MARKED_SIGMAS:g} standard errors are marked; noise makes one of them in 370 "
        "figures. A figure without a standard error has no number in the last column.",
    )


def _summary(before: str, now: str, marked: list[str]) -> str:
    compared = f"Calibration {now} is compared with {before}, the newest of an earlier capture."
    if not marked:
        return f"{compared} No figure differs by more than the noise of the measurements explains."
    return f"{compared} These differ by more than noise explains: {'; '.join(marked)}."


def _title(name: str) -> str:
    """A figure's title; empty for those of the computation, which say nothing about the venue."""
    base, _, channel = name.partition(".")
    if base in LIGHT and channel in CHANNELS:
        return f"{LIGHT[base]}, {CHANNELS[channel]}"
    if name not in CRITERIA or name.startswith("loop_"):
        return ""
    unit = CRITERIA[name].unit
    return words_for(name).title + (f" [{unit}]" if unit != "-" else "")


def _cells(row: FigureDifference) -> list[str]:
    values = [_known(value, 4) for value in (row.a, row.b)]
    mark = " *" if row.is_marked else ""
    return [*values, _known(row.difference, 2), _known(row.sigmas, 2) + mark]


def _known(value: float | None, digits: int) -> str:
    return "\N{EN DASH}" if value is None else number(value, digits)

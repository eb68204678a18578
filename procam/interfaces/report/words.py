"""Figures in words: titles, explanations, values with their units."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Words:
    """A figure's title, what it means, and whether its number reads better in per cent."""

    title: str
    gloss: str = ""
    percent: bool = False


THIN = "\N{NARROW NO-BREAK SPACE}"
LEAST_SHARE = 5e-4  # of the lit picture; less is not worth a sentence
LEFT = "share of the bounced light that remains where no limit holds"
ANOTHER = "the picture turned and inverted, which it did not learn from, in % of white"
ALL_JND = "95 % of all that is lit is off by at most this; 1 can just be noticed"
LEFT_JND = "95 % of the screen where no limit holds is off by at most this; 1 can just be noticed"
NAMES = {
    "simulated_run_s": Words("Time for the whole run", "capture, solve, compensate and refine"),
    "peak_memory_mib": Words("Memory needed at most"),
    "shots": Words("Photographs taken"),
    "session_gb": Words("Disk space of the photographs"),
    "direction_error_relative_rms_arcmin": Words(
        "Direction error of projector pixels relative to each other, root mean square",
        "angle between the calculated and the true direction, less a common rotation",
    ),
    "direction_error_rms_arcmin": Words(
        "Direction error, root mean square", "the same with the survey of the marks on the screen"
    ),
    "direction_error_max_arcmin": Words("Direction error, worst pixel"),
    "solid_angle_sum_error": Words("Error of the projected area", percent=True),
    "dome_is_sphere": Words("The dome is a sphere", "as far as the cameras can measure"),
    "feedback": Words("Feedback m, red / green / blue", "bounced light per light projected"),
    "feedback_error": Words("Error of the feedback", "measured against true", percent=True),
    "feedback_interval_covers": Words("The feedback's 95 % interval holds the true value"),
    "albedo": Words("Albedo, red / green / blue", "share of light that the screen reflects"),
    "albedo_error": Words("Error of the albedo", "measured against true", percent=True),
    "albedo_interval_covers": Words(
        "The albedo's 95 % interval holds the true value",
        "and is narrower than \N{PLUS-MINUS SIGN}6 %",
    ),
    "interreflection_left": Words(
        "Bounced light that remains, were projectors to draw exactly what they are asked for",
        LEFT,
        percent=True,
    ),
    "interreflection_left_mean": Words("\u2014 its signed mean", percent=True),
    "picture_error_jnd_before": Words("Visible error of the picture before compensation", ALL_JND),
    "picture_error_jnd": Words("Visible error of the picture after compensation", ALL_JND),
    "picture_error_jnd_interreflection": Words("\u2014 of it, by light that bounces"),
    "picture_error_jnd_black": Words("\u2014 of it, by the projectors' black"),
    "picture_error_jnd_drawing": Words(
        "\u2014 of it, by how projectors draw", "blur of their lenses, gains, quantisation"
    ),
    "scatter_left_exact": Words(
        "Bounced light that remains with the calibration alone", LEFT, percent=True
    ),
    "scatter_left_exact_mean": Words("\u2014 its signed mean", percent=True),
    "scatter_left_exact_fine": Words("\u2014 on finer patches", percent=True),
    "scatter_left_paper_eq12": Words(
        "Bounced light that remains with the published formula",
        "subtraction by equation 12 of the paper, for comparison",
        percent=True,
    ),
    "scatter_left_paper_eq12_mean": Words("\u2014 its signed mean", percent=True),
    "scatter_left_paper_eq12_fine": Words("\u2014 on finer patches", percent=True),
    "scatter_left_refined": Words("Bounced light that remains after the loop", LEFT, percent=True),
    "scatter_left_refined_mean": Words("\u2014 its signed mean", percent=True),
    "scatter_left_refined_fine": Words("\u2014 on finer patches", percent=True),
    "lit_area_found": Words("Lit dome that the calibration covers", percent=True),
    "scatter_before": Words("Bounced light before compensation", "in % of white", percent=True),
    "loop_residual_by_iteration": Words(
        "Loop: difference after each correction", "root mean square, in % of white", percent=True
    ),
    "loop_noise_floor": Words(
        "Loop: noise of one photograph",
        "no smaller difference can be measured, in % of white",
        percent=True,
    ),
    "loop_residual_over_floor": Words("Loop: last difference, in units of that noise"),
    "loop_residual_own": Words(
        "Loop: difference with the new calibration alone",
        "root mean square, in % of white; the picture is compensated anew and photographed",
        percent=True,
    ),
    "loop_left_jnd_by_iteration": Words("Loop: visible difference after each correction", LEFT_JND),
    "loop_own_jnd": Words("Loop: visible difference with the new calibration alone", LEFT_JND),
    "loop_unseen_residual": Words(
        "Loop: difference of another picture, before / after", ANOTHER, percent=True
    ),
    "loop_scatter_factor": Words(
        "Loop: bounced light, red / green / blue", "measured over predicted"
    ),
    "loop_level": Words("Loop: light of the photographs", "measured over predicted"),
    "loop_iterations": Words("Loop: corrections made"),
    "geometry_residual_rms_px": Words(
        "Residual of the geometry",
        "between the cameras' observations and the model, in projector pixels",
    ),
    "direction_sigma_relative_arcmin": Words(
        "Standard error of directions relative to each other, root mean square",
        "what seams and pictures depend on",
    ),
    "direction_sigma_arcmin": Words(
        "Standard error of directions, root mean square",
        "the same with the survey of the marks on the screen",
    ),
    "sphere_variance_ratio": Words(
        "Test of the screen's shape",
        "variance of the residuals over the variance that noise explains",
    ),
    "shape_degree": Words(
        "Degree of the screen's shape", "of the harmonics that were solved; 0 is an exact sphere"
    ),
    "additivity_error": Words(
        "Colours add up",
        "red, green and blue alone against white; above 1 % the projector processes them",
        percent=True,
    ),
    "coverage": Words("Share of the screen that is lit", percent=True),
    "scatter_degree": Words(
        "Degree of the scatter kernel", "how bounced light depends on where the direct light falls"
    ),
    "floor_albedo_by_light": Words(
        "Albedo of the floor", "from the spatial distribution of the light that it reflects"
    ),
    "flux_doubt": Words("Inconsistency of the flux between pictures", percent=True),
    "server_misalignment_rms_arcmin": Words(
        "Misalignment of the media server, root mean square",
        "between the shown and the intended directions of its tags",
    ),
    "other_seat_direction_relative_rms_arcmin": Words(
        "Another seat: difference of directions relative to each other, root mean square",
        "against a calibration by a camera that stood elsewhere, less a common rotation",
    ),
    "other_seat_direction_rms_arcmin": Words(
        "Another seat: difference of directions, root mean square",
        "the same with the survey of the marks on the screen",
    ),
    "other_seat_direction_relative_over_sigma": Words(
        "Another seat: difference of directions relative to each other, in standard errors",
        "1 if the standard errors are right, above 2 something is wrong",
    ),
    "other_seat_solid_angle_sum": Words(
        "Another seat: difference of the area that a projector lights",
        "the projector with the largest one",
        percent=True,
    ),
    "other_seat_feedback": Words(
        "Another seat: difference of the feedback, red / green / blue", percent=True
    ),
    "other_seat_albedo": Words(
        "Another seat: difference of the albedo, red / green / blue", percent=True
    ),
}


def words_for(name: str) -> Words:
    """Words of a figure; those of an unknown one are its name."""
    return NAMES.get(name, Words(name.replace("_", " ").capitalize()))


def number(value: float, digits: int = 3) -> str:
    """A few significant digits, no exponent unless needed."""
    if not math.isfinite(value):
        return "not a number"
    if abs(value) < 1000:
        value = float(f"{value:.{digits}g}")  # 152 to two digits is 150, not 1.5e+02
    if value == int(value) and abs(value) < 1e7:
        return f"{int(value):,}".replace(",", THIN).replace("-", "\N{MINUS SIGN}")
    if abs(value) >= 1000:
        return f"{value:,.0f}".replace(",", THIN).replace("-", "\N{MINUS SIGN}")
    return f"{value:.{digits}g}".replace("-", "\N{MINUS SIGN}")


def percent(value: float, digits: int = 3) -> str:
    """A share in per cent."""
    return f"{number(float(f'{100 * value:.{digits}g}'), digits)}{THIN}%"


def limits_text(too_bright: float, too_dark: float) -> str:
    """Sentences on the shares of the lit picture where a limit of the projectors holds."""
    black = (
        f"{percent(too_bright, 2)} of the lit picture asks for less light than already bounces there. That "
        "would need negative light, which no projector has: black stays a little grey."
    )
    white = f" {percent(too_dark, 2)} asks for more light than the projectors have."
    return black + (white if too_dark >= LEAST_SHARE else "")


def value_text(name: str, entry: Mapping[str, Any]) -> str:
    """A figure's value with its unit."""
    return _text(entry["value"], name, str(entry.get("unit", "-")))


def quantity_text(name: str, value: float, unit: str, digits: int = 3) -> str:
    """A number of a figure, such as its value or a limit, with its unit."""
    if words_for(name).percent and unit in ("-", "rel"):
        return percent(value, digits)
    suffix = {"-": "", "rel": " of white"}.get(unit, f"\N{NO-BREAK SPACE}{unit}")
    return number(value, digits) + suffix


def goal_text(name: str, entry: Mapping[str, Any]) -> str:
    """A figure's goal in words; empty without one."""
    goal = entry.get("goal")
    if goal is None:
        return ""
    if isinstance(goal["value"], bool):
        return "yes" if goal["value"] else "no"
    limit = _text(goal["value"], name, str(entry.get("unit", "-")))
    before = {
        "<=": "at most ",
        ">=": "at least ",
        "==": "exactly ",
        "abs<=": "within \N{PLUS-MINUS SIGN}",
    }
    return before.get(str(goal["op"]), f"{goal['op']} ") + limit


def miss_text(name: str, entry: Mapping[str, Any]) -> str:
    """Value and goal of a figure that misses it, in one sentence."""
    note = f" ({entry['note']})" if entry.get("note") else ""
    title = words_for(name).title.rstrip(".")
    return f"{title}: {value_text(name, entry)}, should be {goal_text(name, entry)}{note}."


def _text(value: Any, name: str, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return " / ".join(_text(v, name, unit) for v in value)
    if not isinstance(value, (int, float)):
        return str(value)
    return quantity_text(name, value, unit)

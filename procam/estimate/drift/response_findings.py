"""Causes of a changed response: black level, signal range, gamma, and light that depends on the picture."""

from collections.abc import Iterator

import numpy as np

from procam.estimate.drift.finding import (
    CERTAIN,
    EXPONENT_SIGMA,
    LEAST_BLACK,
    LEAST_RAISED,
    MOST_BLACK,
    MOST_EXPONENT,
    MOST_SPAN,
    SPAN_SIGMA,
    Finding,
    not_seen,
)
from procam.estimate.drift.projector_change import ProjectorChange
from procam.estimate.drift.response_change import ResponseChange
from procam.model.photometry import PRIMARIES

GAMMA_ADVICE = "set its gamma or picture mode as it was, or recalibrate it"


def name_settings(name: str, change: ProjectorChange, *, drawn_anew: bool) -> Iterator[Finding]:
    """Causes of the change of one projector's response.

    Of a picture that its electronics draw anew, scaled or bent, black alone is judged: tiles are mixed there.
    """
    response = change.response
    doubtful = CERTAIN * change.black_sigma
    dynamic = change.black < min(LEAST_BLACK, 1 - doubtful)
    raised = change.black > max(MOST_BLACK, 1 + doubtful) and change.raised > LEAST_RAISED
    if raised:
        yield Finding(
            "black level",
            name,
            change.black - 1,
            change.black_sigma,
            "rel",
            f"its black is {change.black:.1f} times as bright",
            "set brightness and signal range as they were",
        )
    if drawn_anew:
        return
    if response is None:
        yield not_seen(
            name, "the camera sees too few of its grey levels, so its response is not judged"
        )
        return
    yield from _dynamic(name, change, response, dynamic)
    yield from _response(name, response, change.raised if raised else 0.0)


def _dynamic(
    name: str, change: ProjectorChange, response: ResponseChange, dynamic: bool
) -> Iterator[Finding]:
    """Light that depends on the picture."""
    seen = np.isfinite(response.span)
    span = float(np.median(response.span[seen])) - 1 if seen.any() else 0.0
    noise = float(np.median(response.span_sigma[seen])) if seen.any() else 0.0
    sigma = float(np.hypot(SPAN_SIGMA, noise))
    if dynamic or abs(span) > max(MOST_SPAN, CERTAIN * sigma):
        yield Finding(
            "dynamic setting",
            name,
            span,
            sigma,
            "rel",
            f"its light depends on the picture: mid-dark pictures have {1 + span:.0%} of their light, black "
            f"{change.black:.0%}",
            "switch off dynamic black, iris and economy modes",
        )


def _response(name: str, response: ResponseChange, raised: float) -> Iterator[Finding]:
    """Another response, by one cause; where black is `raised` [-] its exponent is known less."""
    exponents = list(_exponents(name, response, raised))
    yield from exponents
    if raised:  # the ends of the range moved, which is named already
        return
    if response.clipping.excess > 1:
        yield _signal_range(name, response)
    elif response.rest.excess > 1 and not exponents:
        rest = response.rest
        yield Finding(
            "gamma setting",
            name,
            rest.size,
            rest.sigma,
            "rel",
            f"{rest.place} changed by {rest.size:+.3f} of white, and no change of its gamma or its signal "
            "range explains it",
            GAMMA_ADVICE,
        )


def _signal_range(name: str, response: ResponseChange) -> Finding:
    low, high = np.rint(255 * response.ends)
    return Finding(
        "signal range",
        name,
        response.clipping.size,
        response.clipping.sigma,
        "rel",
        f"it shows drives up to {low:.0f} of 255 as black and from {high:.0f} on as white, which changes its "
        f"light by up to {abs(response.clipping.size):.2f} of white; an input set to limited range does so "
        "at 16 and 235",
        "set the range of its input (HDMI range, signal level) and of the player as it was, and its "
        "brightness and contrast too",
    )


def _exponents(name: str, response: ResponseChange, raised: float) -> Iterator[Finding]:
    """Another gamma, of all channels or of some."""
    of_all = (response.exponent, response.exponent_sigma, "gamma")
    of_each = [
        (float(each), float(sigma), f"gamma of {channel}")
        for each, sigma, channel in zip(response.each, response.each_sigma, PRIMARIES, strict=True)
    ]
    changed = [_is_other(value, sigma, raised) for value, sigma, _ in of_each]
    some = any(changed) and not all(changed)
    for value, sigma, what in of_each if some else [of_all]:
        if _is_other(value, sigma, raised):
            yield Finding(
                "gamma setting",
                name,
                value - 1,
                _exponent_sigma(sigma, raised),
                "rel",
                f"its {what} is {value:.3f} times what it was",
                GAMMA_ADVICE,
            )


def _is_other(exponent: float, sigma: float, raised: float) -> bool:
    return abs(exponent - 1) > max(MOST_EXPONENT, CERTAIN * _exponent_sigma(sigma, raised))


def _exponent_sigma(sigma: float, raised: float) -> float:
    return float(np.hypot(np.hypot(sigma, EXPONENT_SIGMA), raised / 2))

"""Statistics of paired comparisons: which of two do people prefer, and how sure is that.

People are the sample, not their choices: the choices of one person resemble each other, so each observer
counts once, with the share of choices in which the first of two was preferred.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, nct, norm, t

from procam.arrays import Array

CONFIDENCE = 0.95
POWER = 0.8
ONE_JOD = 0.75  # share that prefers what is one JOD better
MOST_OBSERVERS = 1_000_000


@dataclass(frozen=True, slots=True)
class Preference:
    """How often people prefer the first of two.

    Attributes
    ----------
    observers : how many people. share : mean of their own shares that prefer the first, 0..1.
    sigma : standard deviation of these shares between observers; NaN for one.
    low, high : 95 % interval of `share` by Student's t; NaN for one observer and without a spread.
    p_value : two-sided, of the t-test of `share` against one half; NaN as the interval.
    first, second : observers who prefer the first, the second, more often than the other.
    sign_p : two-sided, of the exact sign test of `first` against `second`.
    jod, jod_low, jod_high : the same as a distance [JOD], see `jod`.
    """

    observers: int
    share: float
    sigma: float
    low: float
    high: float
    p_value: float
    first: int
    second: int
    sign_p: float

    @property
    def jod(self) -> float:
        """Of `share`."""
        return jod(self.share)

    @property
    def jod_low(self) -> float:
        """Of `low`."""
        return jod(self.low)

    @property
    def jod_high(self) -> float:
        """Of `high`."""
        return jod(self.high)

    @property
    def reversed(self) -> "Preference":
        """The same of the second."""
        low, high = 1 - self.high, 1 - self.low
        sides = self.second, self.first, self.sign_p
        return Preference(
            self.observers, 1 - self.share, self.sigma, low, high, self.p_value, *sides
        )


def preference(shares: Array) -> Preference:
    """The preference of people of whom each prefers the first in a share (N,) of choices, 0..1.

    Student's t for the mean of N shares: share +- t sigma / sqrt(N) with N - 1 degrees of freedom, cut to
    0..1. Where all shares are equal there is no spread to judge by; only the sign test remains.

    >>> found = preference(np.array([0.5, 0.75, 1.0, 0.75]))
    >>> print(f"{found.share} {found.low:.3f} {found.high:.3f} {found.p_value:.3f}")
    0.75 0.425 1.000 0.092
    >>> print(found.first, found.second, found.sign_p, found.jod)
    3 0 0.25 1.0
    """
    count, share = len(shares), float(np.mean(shares))
    sigma = low = high = p_value = float("nan")
    if count > 1:
        sigma = float(np.std(shares, ddof=1)) if np.ptp(shares) > 0 else 0.0
    if count > 1 and sigma > 0:
        error = sigma / count**0.5
        half = float(t.ppf((1 + CONFIDENCE) / 2, count - 1)) * error
        low, high = max(0.0, share - half), min(1.0, share + half)
        p_value = float(2 * t.sf(abs(share - 0.5) / error, count - 1))
    first, second = int(np.sum(shares > 0.5)), int(np.sum(shares < 0.5))
    return Preference(
        count, share, sigma, low, high, p_value, first, second, sign_test(first, second)
    )


def sign_test(first: int, second: int) -> float:
    """Two-sided p-value that a fair coin falls as unevenly, exact; 1 without any.

    >>> sign_test(9, 1)
    0.021484375
    """
    return float(binomtest(first, first + second).pvalue) if first + second else 1.0


def jod(share: float) -> float:
    """Distance [JOD] of two of which the first is preferred in a share, by Thurstone's case V.

    The quality of each is normal with one sigma, and a share of 0.75 is 1 JOD (Perez-Ortiz et al. 2020,
    doi:10.1109/TIP.2019.2936103). A share of 0 or 1 gives an infinite distance: more than such
    a test can measure.

    >>> [round(jod(share), 3) for share in (0.25, 0.5, 0.75, 0.9)]
    [-1.0, 0.0, 1.0, 1.9]
    """
    return float(norm.ppf(share) / norm.ppf(ONE_JOD))


def power(observers: int, share: float, sigma: float) -> float:
    """Probability that a t-test at 5 % finds a share unequal to one half.

    With T of the non-central t distribution with N - 1 degrees of freedom and non-centrality
    sqrt(N) (share - 1/2) / sigma it is P(T > q) + P(T < -q), where q is the 97.5 % quantile of
    Student's t. `sigma` [1] is the standard deviation of shares between observers, which holds
    for as many choices of each as those that it was estimated from.

    >>> round(power(34, 0.6, 0.2), 3)
    0.808
    """
    freedom = observers - 1
    limit = t.ppf((1 + CONFIDENCE) / 2, freedom)
    distance = np.sqrt(observers) * abs(share - 0.5) / sigma
    # from a distance of about 8 on SciPy gives NaN for the far tail, which is below 1e-15 there
    return float(np.nansum([nct.sf(limit, freedom, distance), nct.cdf(-limit, freedom, distance)]))


def observers_needed(share: float, sigma: float) -> int | None:
    """The fewest observers whose `power` is 80 % or more.

    None where no number is enough (a share of one half) or the spread is not known (NaN or 0).

    >>> observers_needed(0.6, 0.2)
    34
    """
    if not sigma > 0 or share == 0.5:
        return None
    return _fewest(lambda count: power(count, share, sigma) >= POWER)


def _fewest(enough: Callable[[int], bool]) -> int | None:
    """The smallest number from 2 on that is enough, if all above it are."""
    most = 2
    while not enough(most):
        most *= 2
        if most > MOST_OBSERVERS:
            return None
    least = most // 2  # not enough, or 1
    while most - least > 1:
        middle = (least + most) // 2
        least, most = (least, middle) if enough(middle) else (middle, most)
    return most


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for being several (Holm 1979): the chance of one false finding or more is theirs.

    NaN stays NaN and does not count.

    >>> holm([0.01, 0.04, float("nan"), 0.03])
    [0.03, 0.06, nan, 0.06]
    """
    found = np.asarray(p_values, float)
    order = [i for i in np.argsort(found) if not np.isnan(found[i])]
    worst = 0.0
    for rank, place in enumerate(order):
        worst = max(worst, min(1.0, (len(order) - rank) * found[place]))
        found[place] = worst
    return [float(value) for value in found]

"""Finds large windows of a panel's picture again, by normalised cross-correlation, turned over too."""

from collections.abc import Callable
from dataclasses import fields

import numpy as np
from scipy.signal import fftconvolve

from procam.arrays import Array, Image
from procam.estimate.drift.displacement import LEAST_SHARE, TERMS, Windows
from procam.maths.warp import affine_inliers

Place = tuple[int, int]
Match = Callable[[Image, Image, Place], tuple[Place, float]]
AFFINE_POINTS = 3
ASTRAY = 0.05  # of the panel's width: keystone leaves less beside an affine motion
UNMOVED_MATCH = 0.97  # correlation of windows that need not be looked for elsewhere
COARSE_BLOCKS = 5, 4
COARSE_SHARE = 0.3  # of the panel's sides, edge of a coarse window
LEAST_MATCH = 0.6  # correlation of a window that counts
SAME_PICTURE = 0.8  # median over the windows: few tiles match others by chance, to 0.7
PANEL_FLIPS = {
    "as it was": (1, 1),
    "mirrored": (1, -1),
    "upside down": (-1, 1),
    "turned by 180 degrees": (-1, -1),
}


def find_windows(before: Image, now: Image) -> tuple[str, Windows | None]:
    """Where large windows of a texture (h, w) went, and how the picture is turned over; None if nowhere."""
    score, windows = _coarse(before, now, _match_there)
    if score > UNMOVED_MATCH:
        return "as it was", windows
    best, found = "", dict[str, tuple[float, Windows]]()
    for name, (down, across) in PANEL_FLIPS.items():
        found[name] = _coarse(before[::down, ::across], now, _best_match)
        best = max(found, key=lambda n: found[n][0])
        if name == best and found[name][0] > SAME_PICTURE:
            break
    score, windows = found[best]
    windows = _in_agreement(windows, before.shape[1])
    found_it = score > SAME_PICTURE and len(windows.place) > TERMS // 2
    return best, windows if found_it else None


def _in_agreement(windows: Windows, width: int) -> Windows:
    """Windows that fit one affine motion; others match elsewhere by chance."""
    if len(windows.place) <= AFFINE_POINTS:  # they always fit one
        return windows
    end = windows.place + windows.shift
    use = affine_inliers(windows.place, end, ASTRAY * width)
    return Windows(*(np.asarray(getattr(windows, f.name)[use]) for f in fields(windows)))


def _coarse(before: Image, now: Image, match: Match) -> tuple[float, Windows]:
    """Median correlation of large windows, and their shifts to whole grid px."""
    height, width = before.shape
    size = int(COARSE_SHARE * height), int(COARSE_SHARE * width)
    rows = list[tuple[tuple[float, float], tuple[float, float], float]]()
    for top in np.linspace(0, height - size[0], COARSE_BLOCKS[1]).astype(int):
        for left in np.linspace(0, width - size[1], COARSE_BLOCKS[0]).astype(int):
            window = before[top : top + size[0], left : left + size[1]]
            if np.isfinite(window).mean() >= LEAST_SHARE:
                (y, x), score = match(window, now, (int(top), int(left)))
                middle = left + (size[1] - 1) / 2, top + (size[0] - 1) / 2
                rows.append((middle, (x - left, y - top), score))
    if not rows:
        return 0.0, Windows(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    places, shifts, scores = (np.array(column, float) for column in zip(*rows, strict=True))
    good = scores > LEAST_MATCH
    blank = np.full(int(good.sum()), np.nan)
    windows = Windows(places[good], shifts[good], np.full(len(blank), 0.5), blank)
    return float(np.median(scores)), windows


def _match_there(window: Image, now: Image, at: Place) -> tuple[Place, float]:
    """The place where the window was, and the correlation there."""
    top, left = at
    there = now[top : top + window.shape[0], left : left + window.shape[1]]
    good = np.isfinite(window) & np.isfinite(there)
    if good.mean() < LEAST_SHARE:
        return at, 0.0
    return at, float(np.corrcoef(window[good], there[good])[0, 1])


def _best_match(window: Image, now: Image, at: Place) -> tuple[Place, float]:
    """Place of the window's upper left corner anywhere in a texture, and the correlation there."""
    del at
    known, there = np.isfinite(now), np.isfinite(window)
    scene = np.where(known, now - np.mean(now[known]) if known.any() else 0.0, 0.0).astype(float)
    template = np.where(there, window - np.mean(window[there]), 0.0).astype(float)
    weight = there.astype(float)

    def correlated(picture: Array, pattern: Array) -> Array:
        return np.asarray(fftconvolve(picture, pattern[::-1, ::-1], mode="valid"))

    count = np.maximum(correlated(known.astype(float), weight), 1.0)
    mean = correlated(scene, weight) / count
    square = correlated(scene**2, weight) - count * mean**2
    pattern2 = correlated(known.astype(float), template**2)
    cross = correlated(scene, template) - mean * correlated(known.astype(float), template)
    score = cross / np.sqrt(np.maximum(square, 1e-6) * np.maximum(pattern2, 1e-6))
    score = np.where(count > 0.7 * weight.sum(), score, -1.0)
    y, x = np.unravel_index(int(np.argmax(score)), score.shape)
    return (int(y), int(x)), float(score[y, x])

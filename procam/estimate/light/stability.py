"""Check that light, camera and screen held still while one projector's pictures were taken.

Pictures that share out a panel add up to white. A regression of what is missing on white and on a
constant separates two causes: a part proportional to white is drift of the lamp or the camera, a
constant part is light of the room that changed (docs/theory/photometry.md). What is left shows two
more: along the slopes of white a camera that moved, in a place of its own something that stood there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image, IndexArray
from procam.errors import OutOfModelRange
from procam.maths.statistics import robust_sigma
from procam.maths.warp import block_mean
from procam.model.provenance import Note

MAX_PIXELS = 20_000
ROUNDS = 4  # of the regressions; each leaves outliers out
OUTLIER_SIGMAS = 3.0  # glints, moving people
NOTED_DRIFT, MAX_DRIFT = 0.005, 0.015  # of white
NOTED_ROOM, MAX_ROOM = 0.002, 0.01  # of white; scattered light is 5 to 20 % of white
NOTED_SHIFT = 0.05  # camera pixels
SIGNIFICANT_SIGMAS = 5.0
MAX_SCATTER = 0.3  # of the direct light: the most that scatters to any place
STEEP = 0.1  # slope of white, of its bright level a pixel, from which a shift shows
MIN_STEEP = 50  # pixels
BLOCK_PX = 6
TILE_PX = 16  # within such a tile errors may be alike, as those of JPEG are
CHANGED = 0.15  # of a block's light, and as much of a tenth of the bright level
NOTED_CHANGE = 1e-3  # of the screen
GREEN = 1


@dataclass(frozen=True, slots=True)
class PatternSum:
    """Departure of a sum of pictures from white.

    `shots` : the pictures, for messages. `drift`, `room` relative to white; `sigma` of the worse one.
    `shift_px` : root mean square by which the camera's picture moved, with `shift_sigma_px`.
    `changed` : share of the screen where something stood in one of them.
    """

    shots: str
    drift: float
    room: float
    sigma: float
    shift_px: float = 0.0
    shift_sigma_px: float = 0.0
    changed: float = 0.0


class StabilityChecks:
    """Collects sums of one projector's pictures.

    Parameters
    ----------
    white : (H, W, 3) radiance of its white, black subtracted. on_screen : (H, W).
    step : radiance of one count. Pixels of one level are rounded alike, so errors of rounding average
        over levels, not over pixels.
    """

    def __init__(self, white: Image, on_screen: BoolArray, step: float = 0.0) -> None:
        self._green = white[..., GREEN].astype(np.float32)
        self._use = on_screen & np.isfinite(white).all(axis=-1)
        pixels = np.flatnonzero(self._use)
        self._pixels = pixels[:: max(1, len(pixels) // MAX_PIXELS)]
        bright = self._picked()
        self._level = float(np.percentile(bright, 95)) if len(bright) else 0.0
        self._rounding = (
            (step / max(float(bright.mean()), step, 1e-9)) ** 1.5 if self._level > 0 else 0.0
        )
        self._steep, self._slopes = self._steep_pixels()
        self.sums: list[PatternSum] = []

    def _steep_pixels(self) -> tuple[IndexArray, Image]:
        """Indices (n,) of pixels where white is steep, as at a border, and its slopes (n, 2) there."""
        down, across = np.gradient(self._green)
        with np.errstate(invalid="ignore"):
            steep = np.hypot(across, down) > STEEP * self._level
        found = np.flatnonzero(steep & self._use)
        found = found[:: max(1, len(found) // MAX_PIXELS)]
        return found, np.stack([across.ravel()[found], down.ravel()[found]], axis=-1)

    def add(self, shots: str, pictures: Sequence[Image], mark_share: float = 0.0) -> None:
        """Compare the sum of pictures (H, W, 3), black subtracted from each, with white.

        `mark_share`: share of the panel that shows shot marks more often in the pictures than in
        white. Their light scatters too, and is no change of the room's light.
        """
        if not self._level > 0 or not pictures:
            return
        total = np.asarray(np.sum([p[..., GREEN] for p in pictures], axis=0), np.float32)
        drift, room, sigma, left = self._compared(total)
        sigma = float(np.hypot(sigma, self._rounding * np.sqrt((len(pictures) + 1) / 12)))
        room = float(np.copysign(max(abs(room) - MAX_SCATTER * mark_share, 0.0), room))
        self.sums.append(
            PatternSum(shots, drift, room, sigma, *self._shift(left), self._changed(left))
        )

    def add_dimmed(self, shots: str, picture: Image) -> None:
        """Compare a white of less light (H, W, 3), black subtracted: it shows only whether anything moved."""
        if not self._level > 0:
            return
        green = picture[..., GREEN]
        dimming = float(np.nansum(green.flat[self._pixels]) / np.nansum(self._picked()))
        if dimming > 0:
            *_, left = self._compared(green / np.float32(dimming))
            self.sums.append(PatternSum(shots, 0.0, 0.0, 0.0, *self._shift(left)))

    def _compared(self, light: Image) -> tuple[float, float, float, Image]:
        """Drift, room light, the sigma of the worse one, and what is left (H, W) of light (H, W)."""
        surplus, white = light - self._green, self._picked()
        design = np.stack([white, np.full_like(white, self._level)], axis=1)
        (drift, room), covariance = self._fit(design, surplus, self._pixels)
        left = surplus - np.float32(drift) * self._green - np.float32(room * self._level)
        return float(drift), float(room), float(np.sqrt(np.diag(covariance).max())), left

    def _picked(self) -> Image:
        return np.asarray(self._green.flat[self._pixels])

    def _shift(self, left: Image) -> tuple[float, float]:
        """Root mean square of the movement that explains what is left of a sum (H, W), and its sigma [px].

        The picture may shift, turn and change its scale, as that of a camera that was nudged or refocused.
        """
        if len(self._steep) < MIN_STEEP:
            return 0.0, 0.0
        rows, columns = np.unravel_index(self._steep, left.shape)
        y, x = (place - place.mean() for place in (rows, columns))
        size = max(float(np.hypot(x, y).max()), 1.0)
        ones, zeros, y, x = np.ones_like(x), np.zeros_like(x), y / size, x / size
        moves = np.stack(
            [[ones, zeros, -y, x], [zeros, ones, x, y]]
        )  # (across or down, kind, pixel)
        design = -np.einsum("nd,dkn->nk", self._slopes, moves)
        found, covariance = self._fit(design, left, self._steep)
        squares = np.einsum("dkn,dln->kl", moves, moves) / len(self._slopes)
        length = float(np.sqrt(found @ squares @ found))
        along = squares @ found / max(length, 1e-12)  # unknown where borders all run one way
        return length, float(np.sqrt(along @ covariance @ along))

    def _fit(self, design: FloatArray, light: Image, pixels: IndexArray) -> tuple[Array, Array]:
        """Coefficients (K,) and covariance (K, K) of light (H, W) at pixels (n,) over `design` (n, K).

        Without outliers. Errors may be alike within tiles of the picture (Liang and Zeger 1986,
        doi:10.1093/biomet/73.1.13).
        """
        design, values = design.astype(float), light.flat[pixels].astype(float)
        use = np.isfinite(values)
        for _ in range(ROUNDS):
            found = np.linalg.lstsq(design[use], values[use], rcond=None)[0]
            residual = values - design @ found
            scale = robust_sigma(residual[use], 0.0)
            limit = OUTLIER_SIGMAS * scale + 1e-12 * self._level
            use = np.isfinite(values) & (np.abs(residual) <= limit)
        y, x = np.unravel_index(pixels[use], light.shape)
        _, tile = np.unique(y // TILE_PX * light.shape[1] + x // TILE_PX, return_inverse=True)
        weighed = design[use] * residual[use, None]
        in_tiles = np.stack([np.bincount(tile, column) for column in weighed.T], axis=1)
        spread = np.linalg.pinv(design[use].T @ design[use])
        tiles, terms = in_tiles.shape
        if tiles <= terms:  # the fit leaves nothing of their sums: all errors may be one
            return np.asarray(found), np.asarray(spread * np.sum(residual[use] ** 2))
        covariance = spread @ (in_tiles.T @ in_tiles) @ spread * tiles / (tiles - terms)
        return np.asarray(found), np.asarray(covariance)

    def _changed(self, left: Image) -> float:
        """Share of the screen's blocks whose light is not white's."""
        use = block_mean(self._use.astype(np.float32), BLOCK_PX) == 1
        white, rest = (block_mean(np.nan_to_num(x), BLOCK_PX)[use] for x in (self._green, left))
        limit = CHANGED * (np.abs(white) + 0.1 * self._level)
        return float(np.mean(np.abs(rest) > limit)) if use.any() else 0.0

    @property
    def shift_px(self) -> float:
        """The largest significant shift of the camera's picture [px]."""
        return max((s.shift_px for s in self.sums if _has_moved(s)), default=0.0)

    def notes(self, projector: str) -> list[Note]:
        """Notes for the report on changes that the calibration tolerates.

        Raises
        ------
        OutOfModelRange
            If the room's light or the projector's changed too much for the separation of light.
        """
        notes, subject = list[Note](), f"projector {projector}"
        for kind, noted, largest, advice in (
            ("room", NOTED_ROOM, MAX_ROOM, ROOM_ADVICE),
            ("drift", NOTED_DRIFT, MAX_DRIFT, DRIFT_ADVICE),
        ):
            worst = max(self.sums, key=lambda s: abs(getattr(s, kind)), default=None)
            if worst is None:
                continue
            size = getattr(worst, kind)
            if abs(size) <= max(SIGNIFICANT_SIGMAS * worst.sigma, noted):
                continue
            note = Note(kind, subject, advice.format(worst.shots, size), size / noted)
            if abs(size) > largest:
                raise OutOfModelRange(
                    f"{note}; at most {largest:.1%} is usable, photograph it again"
                )
            notes.append(note)
        return notes + self._movement_notes(subject)

    def _movement_notes(self, subject: str) -> list[Note]:
        notes = list[Note]()
        moved = max(self.sums, key=lambda s: s.shift_px * _has_moved(s), default=None)
        if moved is not None and _has_moved(moved):
            text = MOVED_ADVICE.format(moved.shots, moved.shift_px)
            notes.append(Note("moved", subject, text, moved.shift_px / NOTED_SHIFT))
        # a camera that moved changes what is seen at every border
        still = [s for s in self.sums if not _has_moved(s)]
        changed = max(still, key=lambda s: s.changed, default=None)
        if changed is not None and changed.changed > NOTED_CHANGE:
            text = CHANGED_ADVICE.format(changed.shots, changed.changed)
            notes.append(Note("obstruction", subject, text, changed.changed / NOTED_CHANGE))
        return notes


def _has_moved(total: PatternSum) -> bool:
    return total.shift_px > max(NOTED_SHIFT, SIGNIFICANT_SIGMAS * total.shift_sigma_px)


ROOM_ADVICE = (
    "light of the room changed while it was photographed (a door, a lamp, dusk): the "
    "pictures {} together differ from white by {:+.2%} of it over the whole picture"
)
DRIFT_ADVICE = (
    "its light, or the camera's gain, drifted while it was photographed (lamp warming up, "
    "automatic brightness or exposure): the pictures {} together differ from white by {:+.2%} of it"
)
MOVED_ADVICE = (
    "the camera or the projector moved: the pictures {} are {:.2f} camera pixels beside white; "
    "standard errors of directions include that, photograph again for better ones"
)
CHANGED_ADVICE = (
    "someone or something moved before the screen: the pictures {} together are not white on "
    "{:.1%} of it; keep everybody out of the dome and photograph again"
)

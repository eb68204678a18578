"""Codes photographed in scenes of known truth, and the errors of the decoded positions."""

import json
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from multiprocessing import get_context
from pathlib import Path
from shlex import quote
from subprocess import getoutput
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from procam.estimate.structured_light.codes import AXES, Code, generate
from procam.estimate.structured_light.decode import Decoded, Decoder
from procam.estimate.structured_light.panel_map import fit_projector_map
from procam.maths.codes.phase import cramer_rao_variance
from procam.maths.warp import sample
from procam.model.correspondence import CorrespondenceMap
from simulators.photograph_bench import PhotographBench
from simulators.sensor import ROUNDING, Sensor

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Job, Row = TypeVar("Job"), TypeVar("Row")
WORKERS = 2
HERE = Path(__file__).parent
BINS = 64  # of a period, for the bias of a code
# of the code as git describes it, before a study rewrites its files; "-dirty" where it was changed since
REVISION = getoutput(f"git -C {quote(str(HERE))} describe --always --dirty")
FULL_PATCH = 40  # camera pixels that a patch must have to be evaluated


class Shots:
    """All pictures of a code, rendered once without noise; noise is drawn for each seed."""

    def __init__(self, bench: PhotographBench, code: Code) -> None:
        self.bench, self.code = bench, code
        self.signals = list(bench.photograph(generate(code)))
        self.truth = bench.projector_pixels()

    def decode(self, seed: Iterable[int], snr: float | None = None) -> Decoded:
        """Decode the photographs with the noise of a seed."""
        rng = np.random.Generator(np.random.SFC64(list(seed)))
        decoder = Decoder(self.code)
        for number, signal in enumerate(self.signals):
            decoder.add(number, self.bench.digitise(signal, rng, snr))
        return decoder.result()


@dataclass(frozen=True)
class Errors:
    """Decoded positions against the truth, both as maps (H, W, 2)."""

    found: CorrespondenceMap
    truth: Image

    @cached_property
    def lit(self) -> NDArray[np.bool_]:
        """Pixels (H, W) with light of the projector's picture."""
        return np.asarray(np.isfinite(self.truth[..., 0]))

    @cached_property
    def both(self) -> NDArray[np.bool_]:
        """Decoded and lit."""
        return np.asarray(self.lit & self.found.valid)

    @property
    def coverage(self) -> float:
        """Share of the lit pixels that were decoded."""
        return float(self.both.sum() / self.lit.sum())

    @property
    def invented(self) -> int:
        """Number of pixels decoded outside the picture."""
        return int((self.found.valid & ~self.lit).sum())

    @cached_property
    def error(self) -> Array:
        """(N, 2) found - true [px] of the decoded lit pixels."""
        return np.asarray((self.found.projector_xy - self.truth)[self.both], float)

    @cached_property
    def sigma(self) -> Array:
        """(N, 2) standard error as estimated [px]."""
        return np.asarray(self.found.sigma_px[self.both], float)

    @cached_property
    def place(self) -> Array:
        """(N, 2) true projector pixel."""
        return np.asarray(self.truth[self.both], float)

    def off(self, limit: float | Array = 1.0) -> float:
        """Share of the decoded pixels that are off by more than a limit [px] on either axis."""
        far = (np.abs(self.error) > limit).any(axis=1).sum() + self.invented
        return float(far / max(1, len(self.error) + self.invented))

    def inliers(self, limit: float | Array = 1.0) -> NDArray[np.bool_]:
        """(N,) decoded lit pixels within the limit [px]."""
        return np.asarray((np.abs(self.error) <= limit).all(axis=1))

    def bias(self, axis: int, period: float) -> Array:
        """Mean error [px] in each of `BINS` bins of the true coordinate modulo a period [px]."""
        near = self.inliers()
        return binned(self.place[near, axis], self.error[near, axis], period)


def binned(place: Array, error: Array, period: float, fewest: int = 20) -> Array:
    """Mean errors in bins of place modulo period, without bins of few pixels."""
    cell = np.floor(place % period / period * BINS).astype(int).clip(0, BINS - 1)
    count = np.bincount(cell, minlength=BINS)
    mean = np.bincount(cell, error, BINS) / np.maximum(count, 1)
    return np.asarray(mean[count >= fewest])


def rms(values: NDArray[np.floating], axis: int | None = None) -> Array:
    """Root of the mean square, in double precision."""
    return np.asarray(np.sqrt(np.mean(np.square(values, dtype=float), axis=axis)))


def smallest_sigma(shots: Shots, decoded: Decoded, errors: Errors, axis: int) -> Array:
    """Cramer-Rao bound (N,) [px] of pixels with their true noise and amplitudes.

    The amplitude is that of the true wave, fitted to the photographs without noise.
    """
    bench, name = shots.bench, AXES[axis]
    waves, look = shots.code.axis(name).waves, decoded.waves[name].distortion
    assert waves is not None
    order = [i for i, p in enumerate(shots.code.planes) if p.axis == name and p.kind == "sine"]
    signals = np.stack([shots.signals[i][errors.both] for i in order], axis=1).astype(float)
    sensor = Sensor(bench.scene, bench.camera)
    noise = sensor.noise
    assert noise is not None
    counts = np.maximum(signals * sensor.full_dn, 0)
    variance = (noise.per_dn * counts + noise.read_dn**2 + ROUNDING) / sensor.full_dn**2
    depth = look.modulation(waves)
    wave = np.cos(waves.angles(errors.place[:, axis])) * depth
    wave -= wave.mean(axis=1, keepdims=True)
    amplitude = (wave * signals).sum(axis=1) / (wave**2).sum(axis=1)
    bound = cramer_rao_variance(waves, errors.place[:, axis], amplitude[:, None] * depth, variance)
    return np.asarray(np.sqrt(bound))


def patch_errors(errors: Errors, size: tuple[int, int]) -> tuple[Array, Array]:
    """Errors (P, 2) [projector px] and estimated sigmas (P, 2) of well observed patches of the panel."""
    seen = fit_projector_map(errors.found, size)
    true = sample(np.where(errors.lit[..., None], errors.truth, np.nan), seen.camera_px)
    rows, columns = np.indices(seen.valid.shape)
    centre = (np.stack([columns, rows], axis=-1) + 0.5) * seen.patch_px - 0.5
    error = true - centre
    use = seen.valid & (seen.count >= FULL_PATCH) & np.isfinite(error).all(axis=-1)
    sigma = np.broadcast_to(seen.sigma_px.reshape(*seen.valid.shape, -1), error.shape)
    return error[use].astype(float), np.asarray(sigma[use], float)


def side_by_side(work: Callable[[Job], Row], jobs: Iterable[Job]) -> list[Row]:
    """Results of jobs in their order, each printed as it comes, in processes with a core of their own."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    rows = []
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        for row in pool.map(work, jobs):
            rows.append(row)
            print(row, flush=True)
    return rows


def write(name: str, document: dict[str, object], lines: Iterable[str]) -> None:
    """Write results as studies/NAME.json, with the code's revision, and a readable studies/NAME.md."""
    command = f"python -m studies {name.replace('_', '-')}"
    text = json.dumps({"command": command, "revision": REVISION, **document}, indent=1)
    (HERE / f"{name}.json").write_text(text + "\n")
    (HERE / f"{name}.md").write_text("\n".join([*lines, "", f"`{command}`", ""]))

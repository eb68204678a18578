"""Calls of the compiled kernels with arguments of wrong shapes, types, layouts and values.

A kernel may refuse such a call, or return a result of the shape that the reference in NumPy returns; the
process must not crash.
Each kernel is called in processes of its own, whose allocator fills freed memory and checks it. Writes
studies/wrong_calls.json and studies/wrong_calls.md; `python -m studies wrong-calls` remakes them in minutes.
"""

import json
import os
import subprocess
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procam import kernels
from procam.errors import ProcamError
from procam.kernels import ObservationBlock, PlacedDevice, ShapeDerivatives
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.model import FrameModel
from procam.kernels.warp.reference import KNOTS
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from studies.measure import write

CASES, CHUNK = 2000, 500  # calls of each kernel, and of them in a process
CHECKED = {"MALLOC_CHECK_": "3", "MALLOC_PERTURB_": "165", "OMP_NUM_THREADS": "2"}
TYPES = ("u1", "i4", "u2", "f2", "f4", "f8", ">f8", "c16", "?", "O", "U3")
NUMBERS = (0, -1, 1, 2, 3, 7, 1e9, -1e18, 1e300, float("nan"), float("inf"), None, "x", True)
PYTHONS = TypeError, ValueError, AttributeError, OverflowError  # as for a text in place of a number
Arguments = dict[str, Any]


@dataclass(frozen=True)
class Kernel:
    """A kernel: arguments that it takes, made anew for each call, and how it is called with them."""

    arguments: Callable[[np.random.Generator], Arguments]
    call: Callable[[Arguments], object]


def _rays(rng: np.random.Generator) -> Arguments:
    return {
        "pixels": rng.uniform(0, 600, (7, 11, 2)),
        "lens": np.array([190.0, 191, 300, 301, 0.01, -0.003, 0, 0]),
    }


def _search(rng: np.random.Generator) -> Arguments:
    frames = (rng.random((5, 12, 13)) * 250).astype(np.float32)
    return {
        **{"frames": frames, "periods": np.array([40.0, 40, 40, 46, 52])},
        **{"shifts": np.radians([0.0, 120, 240, 0, 0]), "modulation": np.ones(5)},
        **{"harmonic": np.zeros(5), "base": 3, "length": 300.0, "steps": 2},
    }


def _bundle(rng: np.random.Generator) -> Arguments:
    ray = np.c_[rng.uniform(-0.5, 0.5, (70, 2)), np.ones(70)]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return {
        **{"rotation": np.eye(3), "translation": np.array([0.1, 0, 0.2]), "pupil": np.zeros(2)},
        "lens": np.array([870.0, 872, 960, 640, -0.02, 0.002, 0.001, 0, 0]),
        **{"radius": 6.0, "harmonics": np.zeros(4), "kind": "brown"},
        **{"ray": ray, "seen": rng.normal(0, 300, (70, 2)), "weight": rng.uniform(0.5, 2, 70)},
        **{"start": ray.copy(), "values": rng.normal(0, 1, (70, 4))},
        **{"slopes": rng.normal(0, 1, (70, 4, 3)), "lens_free": True},
    }


def _call_bundle(a: Arguments) -> object:
    device = PlacedDevice(a["rotation"], a["translation"], a["kind"], a["lens"], a["pupil"])
    block = ObservationBlock(device, device, a["radius"], a["harmonics"])
    slopes = ShapeDerivatives(a["start"], a["values"], a["slopes"])
    found = kernels.bundle_residuals(block, a["ray"], a["seen"], slopes)
    kernels.bundle_equations(block, a["ray"], a["seen"], a["weight"], slopes, a["lens_free"])
    return found


def _warp(rng: np.random.Generator) -> Arguments:
    return {
        **{"place": rng.uniform(-3, 30, (17, 40, 2)), "black": rng.uniform(0, 0.01, (17, 40, 3))},
        **{"share": rng.uniform(0, 1, (17, 40, 3)), "unmix": np.eye(3)},
        "drives": np.repeat(KNOTS[:, None], 3, axis=1),
        **{"decode": np.linspace(0, 1, 256), "thresholds": rng.uniform(0, 1, (64, 64))},
        "master": (rng.random((24, 25, 3)) * 255).astype(np.uint8),
        **{"out": np.zeros((17, 40, 3), np.uint8), "dtype": np.uint8},
    }


def _call_warp(a: Arguments) -> object:
    names = ("place", "black", "share", "unmix")
    more = {name: a[name] for name in ("drives", "decode", "thresholds")}
    plan = kernels.plan_warp(*(a[name] for name in names), **more)
    kernels.warp_frame(a["master"], plan, dtype=a["dtype"])
    return np.array(kernels.warp_frame(a["master"], plan, a["out"]))


def _frame(rng: np.random.Generator) -> Arguments:
    nodes, size = 33, 35
    direction, inside = master_directions(nodes)
    coverage = (inside & (direction[..., 2] > 0.2)).astype(np.float32)

    def field(low: float, high: float, *shape: int) -> Any:
        return rng.uniform(low, high, (nodes, nodes, *shape)).astype(np.float32)

    solid = master_solid_angles(nodes) * (nodes / size) ** 2 * coverage
    return {
        **{"size": size, "spread": field(0.02, 0.04, 3), "lo": field(0, 0.01, 3)},
        **{"hi": field(0.5, 1.2, 3), "ambient": field(0, 0.01, 3), "gain": field(0.8, 1)},
        **{"coverage": coverage, "solid_angle_sr": solid.astype(np.float32)},
        "direction": np.ascontiguousarray(np.moveaxis(direction, -1, 0), np.float32),
        **{"terms": 9, "coefficients": rng.normal(0, 0.3, (3, 9)), "offset": np.zeros((3, 9))},
        **{"light": field(0, 0.05, 3), "threshold": rng.uniform(0, 1, (64, 64)).astype("f4")},
        "image": (rng.random((size, size, 3)) * 255).astype(np.uint8),
        **{"out": np.zeros((size, size, 3), np.uint8), "sums": np.zeros((3, 9))},
        **{"strength": 0.7, "top": 1.0},
    }


def _call_frame(a: Arguments) -> object:
    names = ("size", "spread", "lo", "hi", "ambient", "gain", "coverage", "solid_angle_sr")
    model = FrameModel(*(a[name] for name in (*names, "direction", "terms")))
    coding = Coding(lambda v: v**2.2, lambda v: v**0.45, a["threshold"], a["strength"], a["top"])
    found = kernels.scattered_light(model, a["coefficients"], a["offset"])
    kernels.frame_sums(model, a["image"], found, "light", coding)
    kernels.frame_sums(model, a["image"], a["light"], "at least", coding)
    kernels.frame_apply(model, a["image"], a["light"], coding, a["out"], a["sums"])
    return np.array(found)


KERNELS: Mapping[str, Kernel] = {
    "fisheye_rays": Kernel(_rays, lambda a: kernels.fisheye_rays(a["pixels"], a["lens"])),
    "search_phase": Kernel(
        _search, lambda a: np.array(kernels.search_phase(list(a["frames"]), *list(a.values())[1:]))
    ),
    "bundle": Kernel(_bundle, _call_bundle),
    "warp_frame": Kernel(_warp, _call_warp),
    "frame": Kernel(_frame, _call_frame),
}


def wrong_calls(name: str, seeds: range) -> Counter[str]:
    """What came of calls with one or two wrong arguments: "refused", a result of "same" shape, or else."""
    found = Counter[str]()
    for seed in seeds:
        found[_outcome(KERNELS[name], seed)] += 1
    return found


def _outcome(kernel: Kernel, seed: int) -> str:
    results = []
    for level in (None, "numpy"):
        rng = np.random.default_rng(seed)
        arguments = kernel.arguments(rng)
        for name in rng.choice(list(arguments), rng.integers(1, 3), replace=False):
            arguments[str(name)] = _wrong(arguments[str(name)], rng)
        try:
            with kernels.forced(level), np.errstate(all="ignore"):
                results.append(kernel.call(arguments))
        except ProcamError:
            return "refused"
        except PYTHONS:
            return "Python's" if level is None else "refused by NumPy alone"
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            return f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error}"
    first, second = (np.nan_to_num(np.asarray(r, float)) for r in results)
    return "same" if first.shape == second.shape else "another shape"


def _wrong(value: Any, rng: np.random.Generator) -> Any:
    """An argument that is not what it should be."""
    if not isinstance(value, np.ndarray):
        return NUMBERS[rng.integers(len(NUMBERS))]
    how = rng.integers(4)
    if how == 0:
        return _of_another_shape(value, rng)
    if how == 1:
        return _of_another_type(value, TYPES[rng.integers(len(TYPES))])
    if how == 2:
        return _laid_out_otherwise(value, rng)
    changed = value.copy()
    strange = (0, -1, 1e30, np.nan, np.inf, -np.inf, 1e-300)[rng.integers(7)]
    if changed.dtype.kind == "f":
        changed.flat[rng.integers(changed.size, size=3)] = strange
    return changed


def _of_another_shape(value: Any, rng: np.random.Generator) -> Any:
    shapes = (
        *(lambda: value[:-1], lambda: value[..., :-1], lambda: value[None], value.ravel),
        *(lambda: value[:0], lambda: value.T, lambda: value[..., None], lambda: value[0]),
        *(lambda: np.concatenate([value, value]), lambda: np.concatenate([value, value], -1)),
        *(lambda: value.flat[0], lambda: np.zeros((0,) * value.ndim, value.dtype)),
    )
    return shapes[rng.integers(len(shapes))]()


def _of_another_type(value: Any, kind: str) -> Any:
    with np.errstate(all="ignore"):
        return value.astype(kind)


def _laid_out_otherwise(value: Any, rng: np.random.Generator) -> Any:
    """The same values in memory of another order; unaligned, read-only, or one value everywhere."""
    how = rng.integers(5)
    if how == 0:
        return np.asfortranarray(value)
    if how == 1:
        wide = np.zeros((*value.shape[:-1], 2 * value.shape[-1]), value.dtype)
        wide[..., ::2] = value
        return wide[..., ::2]
    if how == 2:
        room = np.zeros(value.nbytes + 1, np.uint8)[1:].view(value.dtype).reshape(value.shape)
        room[...] = value
        return room
    if how == 3:
        fixed = value.copy()
        fixed.flags.writeable = False
        return fixed
    return np.broadcast_to(value.flat[0], value.shape)


def _in_a_process(name: str, first: int) -> tuple[int, Counter[str]]:
    """Exit code of a process that makes a chunk of calls, and what came of them."""
    code = (
        "import json; from studies.wrong_calls import wrong_calls; "
        f"print(json.dumps(wrong_calls({name!r}, range({first}, {first + CHUNK}))))"
    )
    done = subprocess.run(
        (sys.executable, "-W", "ignore", "-c", code),
        env=os.environ | CHECKED,
        stdout=subprocess.PIPE,
        check=False,
    )
    return done.returncode, Counter(json.loads(done.stdout) if not done.returncode else {})


def main() -> None:
    """Call all kernels and write studies/wrong_calls.json and .md."""
    rows = []
    for name in KERNELS:
        done = [_in_a_process(name, first) for first in range(0, CASES, CHUNK)]
        total = sum((counts for _, counts in done), Counter[str]())
        crashed = sum(code != 0 for code, _ in done)
        rows.append({"kernel": name, "crashed": crashed, "found": dict(total)})
        print(rows[-1], flush=True)
    write("wrong_calls", {"cases": CASES, "rows": rows}, _table(rows))


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "# Kernels with wrong arguments",
        "",
        f"{CASES} calls of each, with one or two arguments of another shape, type, layout or value. Refused: "
        "in a sentence. Python's: a TypeError or the like, as for a text in place of a number.",
        "",
        "| kernel | crashed processes | refused | accepted | Python's | others |",
        "|---|---|---|---|---|---|",
    )
    for row in rows:
        found = Counter(row["found"])
        own = found.pop("Python's", 0)
        known = [found.pop(name, 0) for name in ("refused", "same")]
        cells = [row["kernel"], row["crashed"], *known, own, sum(found.values())]
        yield f"| {' | '.join(map(str, cells))} |"

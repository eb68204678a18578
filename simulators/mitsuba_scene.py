"""Mitsuba 3 (extra `sim`): the variant that works here, and a scene of glowing triangles to trace."""

import os
import subprocess
import sys
from ctypes.util import find_library
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, Array32, IndexArray
from procam.errors import InputError

Faces = NDArray[np.integer[Any]]
EXTRA = 'pip install "procam[sim]"'
LIBRARY = "DRJIT_LIBLLVM_PATH"  # the environment variable by which Mitsuba finds LLVM
LLVM = ("LLVM-22", "LLVM-21", "LLVM-20", "LLVM-19", "LLVM")
PROBE = """
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere"}, "sky": {"type": "constant"}})
path, sampler = mi.load_dict({"type": "path"}), mi.load_dict({"type": "independent"})
sampler.seed(0, 2)
ray = mi.Ray3f(mi.Point3f(0, 0, -3), mi.Vector3f(mi.Float([0.0, 0.1]), 0, 1))
print(path.sample(scene, sampler, mi.RayDifferential3f(ray))[0])
"""
PROBE_S = 120
CHANNELS = 3  # that a path carries
ROULETTE_DEPTH = (
    6  # bounces before Russian roulette; no path is cut at a depth, which would lose light
)
LOBE_ROUGHNESS = 0.16  # Beckmann's alpha: about as wide as cos^20 round the mirror direction


@cache
def load_mitsuba() -> Any:
    """Mitsuba with its fastest variant that works here: LLVM, else scalar, which is slow.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        import mitsuba  # noqa: PLC0415
    except ImportError as error:
        raise InputError(f"path tracer: mitsuba is not installed; run: {EXTRA}") from error
    library = os.environ.get(LIBRARY) or next(filter(None, map(find_library, LLVM)), "")
    if _llvm_works(library):
        os.environ[LIBRARY] = library
        mitsuba.set_variant("llvm_ad_rgb")
    else:
        mitsuba.set_variant("scalar_rgb")
    return mitsuba


def _llvm_works(library: str) -> bool:
    """Whether paths can be traced with an LLVM `library`; tried in a process of its own: old ones abort."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROBE],
            env={**os.environ, LIBRARY: library},
            capture_output=True,
            timeout=PROBE_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


class GlowingMesh:
    """A mesh whose faces emit and reflect light, each with its own values.

    Parameters
    ----------
    vertices : (V, 3) [m]. faces : (F, 3), counter-clockwise seen from the side that emits.
    radiosity : (F, 3) that the faces emit, as diffuse light.
    matte : (F, 3) diffuse reflectance, 0 to 1. glossy : (F, 3) that of a lobe round the mirror direction.
    """

    def __init__(
        self, vertices: Array, faces: Faces, radiosity: Array, matte: Array, glossy: Array
    ) -> None:
        self._mi = mi = load_mitsuba()
        share = glossy.sum(axis=1) / np.maximum((matte + glossy).sum(axis=1), 1e-30)
        attributes = {
            "face_radiance": radiosity / np.pi,
            "face_albedo": matte + glossy,
            "face_gloss": share[:, None],
        }
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(_bsdf(share))
        # Mitsuba cannot sample emitters with radiance per face, so it must never choose this one
        properties["emitter"] = mi.load_dict(
            {"type": "area", "radiance": _per_face("face_radiance"), "sampling_weight": 0.0}
        )
        properties["face_normals"] = True
        mesh = mi.Mesh("room", len(vertices), len(faces), properties, False, False)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
        parameters["faces"] = faces.astype(np.uint32).ravel()
        parameters.update()
        for name, values in attributes.items():
            mesh.add_attribute(name, values.shape[1], values.astype(np.float32).ravel())
        chosen = {"type": "point", "position": [0, 0, 0], "intensity": {"type": "rgb", "value": 0}}
        self._scene = mi.load_dict({"type": "scene", "mesh": mesh, "dark": chosen})
        path = {"type": "path", "max_depth": -1, "rr_depth": ROULETTE_DEPTH}
        self._integrator = mi.load_dict(path)
        self._sampler = mi.load_dict({"type": "independent"})

    def radiance(self, origin: Array32, direction: Array32, seed: int) -> Array:
        """Radiance (n, 3) along rays of (n, 3) `origin` and `direction`."""
        mi, scene, sampler = self._mi, self._scene, self._sampler
        if _is_scalar(mi):
            sampler.seed(seed)
            rays = zip(origin.tolist(), direction.tolist(), strict=True)
            seen = [
                self._integrator.sample(scene, sampler, mi.RayDifferential3f(mi.Ray3f(o, d)))[0]
                for o, d in rays
            ]
            return np.array(seen, dtype=float)
        sampler.seed(seed, len(origin))
        rays = mi.RayDifferential3f(self._rays(origin, direction))
        return np.array(self._integrator.sample(scene, sampler, rays)[0], dtype=float).T

    def first_faces(self, origin: Array32, direction: Array32) -> IndexArray:
        """Face (n,) that each ray hits first, from either side; -1 where it leaves the room."""
        mi, scene = self._mi, self._scene
        if _is_scalar(mi):
            rays = zip(origin.tolist(), direction.tolist(), strict=True)
            hits = (scene.ray_intersect_preliminary(mi.Ray3f(o, d)) for o, d in rays)
            return np.array([h.prim_index if h.is_valid() else -1 for h in hits], dtype=np.intp)
        hit = scene.ray_intersect_preliminary(self._rays(origin, direction))
        face = np.array(hit.prim_index, dtype=np.intp)
        return np.where(np.array(hit.is_valid()), face, -1)

    def _rays(self, origin: Array32, direction: Array32) -> Any:
        mi = self._mi
        across = (np.ascontiguousarray(v.T) for v in (origin, direction))
        return mi.Ray3f(
            *(kind(v) for kind, v in zip((mi.Point3f, mi.Vector3f), across, strict=True))
        )


def _is_scalar(mi: Any) -> bool:
    return str(mi.variant()).startswith("scalar")


def _per_face(name: str) -> dict[str, Any]:
    return {"type": "mesh_attribute", "name": name}


def _bsdf(gloss: Array) -> dict[str, Any]:
    paint = _per_face("face_albedo")
    matte = {"type": "diffuse", "reflectance": paint}
    lobe = {
        "type": "roughconductor",
        "material": "none",
        "alpha": LOBE_ROUGHNESS,
        "specular_reflectance": paint,
    }
    if not gloss.any():
        return matte
    if (gloss == 1).all():
        return lobe
    return {"type": "blendbsdf", "weight": _per_face("face_gloss"), "matte": matte, "lobe": lobe}

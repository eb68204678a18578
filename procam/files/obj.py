"""OBJ files: a surface whose groups are the parts of a room.

trimesh reads them, after what is neither a vertex, a place on the canvas, a face nor a group is left out:
materials would split groups. Other words of a file never leave the venue.
"""

import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from procam.arrays import Array, IndexArray
from procam.errors import FileFormatError
from procam.files.meshes import Surface
from procam.maths.mesh.rooms import BOX, CYLINDER

EXTRA = 'pip install "procam[geom]"'
MOST_FACES = 100_000  # whose form factors fit into 1.5 GB
GEOMETRY = ("v", "vt", "f")
NUMBERS = re.compile(r"[-+0-9.eE/]+|[-+]?(?:nan|inf)", re.IGNORECASE)
USUAL = {*BOX, *CYLINDER}
UNNAMED = "part"


def read_obj(path: Path) -> tuple[Surface, tuple[str, ...]]:
    """The surface of a file, polygons as triangles, and the names of its parts.

    Raises
    ------
    FileFormatError
        There is no such file, it is damaged, or it has too many faces.
    """
    if path.suffix.lower() != ".obj":
        raise FileFormatError(f"{path}: meshes are read from .obj files; export it as one")
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; a mesh is needed. Check the name")
    loader = _trimesh()
    _check_size(path)
    try:
        text, groups = _geometry_text(path)
        scene = loader.load_scene(
            io.StringIO(text), "obj", process=False, split_groups=groups, split_objects=not groups
        )
        parts = dict(sorted(scene.geometry.items()))
        if not any(len(getattr(part, "faces", ())) for part in parts.values()):
            raise ValueError("it has no faces")
        if any(part.vertices.shape[1:] != (3,) for part in parts.values()):
            raise ValueError("its points have no three coordinates")
        return _joined(path, list(parts.values())), tuple(map(_part_name, parts))
    except Exception as error:  # trimesh raises of every kind
        raise FileFormatError(
            f"{path} is not a readable OBJ mesh ({' '.join(str(error).split())}); export it again"
        ) from error


def _check_size(path: Path) -> None:
    """Refuse files of very many faces before they are read, which takes gigabytes."""
    with path.open("rb") as file:
        faces = sum(line.startswith((b"f ", b"f\t")) for line in file)
    if faces > MOST_FACES:
        raise FileFormatError(
            f"{path}: {faces} faces; {MOST_FACES} fit into memory, and 20000 are plenty. Reduce it, such as "
            "by quadric decimation"
        )


def _trimesh() -> Any:
    try:
        import trimesh  # noqa: PLC0415
    except ImportError as error:
        raise FileFormatError(
            f"mesh screen: trimesh, which reads meshes, is not installed; run: {EXTRA}"
        ) from error
    return trimesh


def _geometry_text(path: Path) -> tuple[str, bool]:
    """Vertices, texture coordinates and faces of an OBJ file, and nothing that may be private.

    Also whether it has groups; else its objects are the parts. Faces of none are the part `UNNAMED`.
    """
    text = path.read_text("utf-8-sig", errors="replace").replace("\\\n", " ")
    rows = [line.partition("#")[0].split() or [""] for line in text.split("\n")]
    names = {key: {" ".join(w) for k, *w in rows if k == key} for key in ("g", "o")}
    groups = len(names["g"]) > 1 or not names["o"]
    part, named, lines, counts = "g" if groups else "o", False, list[str](), Counter[str]()
    points = list[list[float]]()
    _refuse_one_name(names[part])
    for key, *words in rows:
        if key == part:
            named = True
            lines.append(f"{part} {_part_name(' '.join(words))}")
        elif key in GEOMETRY:
            if not all(NUMBERS.fullmatch(word) for word in words):
                line = " ".join([key, *words])[:40]
                raise ValueError(f"{line!r} has words where numbers belong")
            if key == "f" and not named:
                named = True
                lines.append(f"{part} {UNNAMED}")
            counts[key] += 1
            if key == "v":
                points.append([float(word) for word in words[:3]])
            if key == "f":
                words = _fan([_from_first(word, counts) for word in words], points)  # noqa: PLW2901
            lines.append(" ".join([key, *words]))
    return "\n".join(lines) + "\n", groups


def _fan(corners: list[str], points: Sequence[Sequence[float]]) -> list[str]:
    """Corners of a polygon, turned so that triangles from its first corner cover it."""
    if len(corners) <= 3:
        return corners
    at = np.array([points[int(corner.split("/")[0]) - 1] for corner in corners])
    for first in range(len(corners)):
        edges = np.roll(at, -first, axis=0)[1:] - at[first]
        normals = np.cross(edges[:-1], edges[1:])
        total = normals.sum(axis=0)
        if not (normals @ total < -1e-9 * (total @ total)).any():  # NaN is for others to refuse
            return corners[first:] + corners[:first]
    raise ValueError(
        f"a polygon of {len(corners)} corners has several that point inwards; triangulate when exporting"
    )


def _refuse_one_name(names: set[str]) -> None:
    """Refuse names that differ only in signs that names of parts do not have."""
    given = dict[str, str]()
    for name in sorted(names):
        other = given.setdefault(_part_name(name), name)
        if other != name:
            raise ValueError(f"its parts {other!r} and {name!r} would both be {_part_name(name)!r}")


def _from_first(corner: str, counts: Mapping[str, int]) -> str:
    """A corner such as "-1/-1", which counts from the last vertex before it, as one from the first."""
    numbers = zip(corner.split("/"), ("v", "vt"), strict=False)  # normals are not read
    return "/".join(
        str(counts[kind] + 1 + int(n)) if n.startswith("-") else n for n, kind in numbers
    ).rstrip("/")


def shared_parts(path: Path) -> dict[str, str]:
    """Names of a file's parts, and those that they have in a bundle: numbers, but those of usual walls."""
    text, _ = _geometry_text(path)
    names = dict.fromkeys(re.findall(r"^[go] (\S+)$", text, re.MULTILINE))
    fresh = (f"part-{number}" for number in count(1))
    return {name: name if name in USUAL else next(fresh) for name in names}


def shared_text(path: Path) -> str:
    """What a bundle has of a file."""
    names = shared_parts(path)
    return re.sub(
        r"^([go]) (\S+)$",
        lambda found: f"{found[1]} {names[found[2]]}",
        _geometry_text(path)[0],
        flags=re.MULTILINE,
    )


def _part_name(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or UNNAMED


def _joined(path: Path, parts: Sequence[Any]) -> Surface:
    """One surface of the parts."""
    faces, texture, start = list[IndexArray](), list[Array](), 0
    for part in parts:
        own = np.asarray(part.faces, np.intp).reshape(-1, 3)
        uv = getattr(part.visual, "uv", None)
        blank = np.full((len(part.vertices), 2), np.nan)
        texture.append((blank if uv is None else np.asarray(uv, float)[:, :2])[own])
        faces.append(own + start)
        start += len(part.vertices)
    return Surface(
        path,
        np.concatenate([np.asarray(part.vertices, float)[:, :3] for part in parts]),
        np.concatenate(faces),
        np.repeat(np.arange(len(parts)), [len(own) for own in faces]),
        np.concatenate(texture),
    )

"""A player of shows that uses a track's folder and OpenGL, without procam."""

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

os.environ.setdefault("LP_NUM_THREADS", "1")  # Mesa's software renderer

TERMS = ("1", "x", "y", "z", "xy", "yz", "xz", "x^2-y^2", "z^2")
VERTEX = """#version 330 core
in vec2 corner; out vec2 place;
void main() { place = corner; gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0); }
"""
CORNERS = np.array([0, 0, 1, 0, 0, 1, 1, 1], np.float32).tobytes()
FORMATS = {"uint8": "f1", "float16": "f2", "float32": "f4"}
TILES = 32


def open_gl() -> Any:
    """A context without a window; skips where there is none."""
    moderngl = pytest.importorskip("moderngl", reason="moderngl (extra `display`) is not installed")
    try:
        context = moderngl.create_standalone_context(backend="egl", require=330)
    except Exception as error:  # any error of the driver
        pytest.skip(f"no OpenGL through EGL ({error}); apt-get install libegl1 libgl1-mesa-dri")
    return context


class Player:
    """Plays one track."""

    def __init__(self, context: Any, folder: Path) -> None:
        self.gl = context
        self.document = json.loads((folder / "track.json").read_text())
        self.size = self.document["size"]
        self.rows = _rows(folder / self.document["numbers"]["file"])
        self.units = [
            (name, self._texture(folder / entry["file"], entry["filter"], entry["wrap"]))
            for name, entry in self.document["textures"].items()
        ]
        self.show = self._program((folder / "compensate.frag").read_text())
        self._live_folder = folder / "live"
        self.content: Any = None
        self._targets: dict[str, Any] = {}
        self._numbers: list[Any] = []
        self._parts: list[Any] = []

    def play(self, frame: np.ndarray, number: int, strength: float = 1.0) -> np.ndarray:
        """A frame (N, N, 3) as the track compensates it."""
        self._load(frame)
        _, program = self.show
        program["numbers"] = [tuple(triple) for triple in self.rows[number].reshape(-1, 3)]
        program["strength"] = strength
        return self._draw(self.show, frame)

    def play_live(self, frame: np.ndarray, steps: int = 3) -> np.ndarray:
        """A frame without a track, started from the coefficients of the last frame."""
        if not self._numbers:
            self._start_live()
        self._load(frame)
        for _ in range(steps):
            self._reduce()
            self._solve()
        self.live["apply"][1]["strength"] = 1.0
        self._bind(self.live["apply"][1], [("numbers", self._numbers[0])])
        return self._draw(self.live["apply"], frame)

    def live_numbers(self) -> np.ndarray:
        """The present coefficients (3, 9) of the live variant."""
        return np.frombuffer(self._numbers[0].read(), np.float32).reshape(9, 4)[:, :3].T

    def _start_live(self) -> None:
        folder = self._live_folder
        self.live = {
            name: self._program((folder / f"{name}.frag").read_text())
            for name in ("reduce", "solve", "apply")
        }
        self.moves = self._texture(folder / "moves.exr", "nearest", "clamp")
        zero = np.zeros((9, 4), np.float32).tobytes()
        self._numbers = [self._nearest(self.gl.texture((9, 1), 4, zero, dtype="f4")) for _ in "ab"]
        self._parts = [self.gl.texture((TILES, TILES), 4, dtype="f4") for _ in range(7)]
        self._targets["parts"] = self.gl.framebuffer(self._parts)

    def _reduce(self) -> None:
        quad, program = self.live["reduce"]
        program["tiles"] = TILES
        self._bind(program, [("numbers", self._numbers[0])])
        self._targets["parts"].use()
        quad.render(self.gl.TRIANGLE_STRIP)
        for part in self._parts:
            part.build_mipmaps()

    def _solve(self) -> None:
        quad, program = self.live["solve"]
        program["tiles"] = TILES
        parts = [(f"part_{i}", part) for i, part in enumerate(self._parts)]
        self._bind(program, [("numbers", self._numbers[0]), ("moves", self.moves), *parts])
        target = self.gl.framebuffer([self._numbers[1]])
        target.use()
        quad.render(self.gl.TRIANGLE_STRIP)
        target.release()
        self._numbers.reverse()

    def _program(self, source: str) -> Any:
        program = self.gl.program(vertex_shader=VERTEX, fragment_shader=source)
        for name, value in self.document["uniforms"].items():
            if name in program:
                program[name] = value
        return self.gl.vertex_array(program, [(self.gl.buffer(CORNERS), "2f", "corner")]), program

    def _texture(self, path: Path, smooth: str, wrap: str) -> Any:
        pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)
        height, width, channels = pixels.shape
        data = np.ascontiguousarray(pixels, np.float32).tobytes()
        texture = self.gl.texture((width, height), channels, data, dtype="f4")
        kind = self.gl.LINEAR if smooth == "linear" else self.gl.NEAREST
        texture.filter = (kind, kind)
        texture.repeat_x = texture.repeat_y = wrap == "repeat"
        return texture

    def _nearest(self, texture: Any) -> Any:
        texture.filter = (self.gl.NEAREST, self.gl.NEAREST)
        return texture

    def _load(self, frame: np.ndarray) -> None:
        kind = FORMATS[str(frame.dtype)]
        if self.content is None:
            self.content = self._nearest(
                self.gl.texture(frame.shape[:2], 3, dtype=kind, alignment=1)
            )
        self.content.write(np.ascontiguousarray(frame).tobytes())

    def _draw(self, how: tuple[Any, Any], frame: np.ndarray) -> np.ndarray:
        quad, program = how
        kind = FORMATS[str(frame.dtype)]
        if kind not in self._targets:
            held = self.gl.texture(frame.shape[:2], 4, dtype=kind)
            self._targets[kind] = self.gl.framebuffer([held])
        self._bind(program, [])
        self._targets[kind].use()
        quad.render(self.gl.TRIANGLE_STRIP)
        read = self._targets[kind].read(components=3, alignment=1, dtype=kind)
        return np.frombuffer(read, frame.dtype).reshape(frame.shape)

    def _bind(self, program: Any, more: list[tuple[str, Any]]) -> None:
        for unit, (name, texture) in enumerate([("content", self.content), *self.units, *more]):
            if name in program:
                texture.use(unit)
                program[name] = unit


def _rows(path: Path) -> dict[int, np.ndarray]:
    """The 27 coefficients by frame; absent columns are 0."""
    with path.open() as file:
        return {
            int(row["frame"]): np.array(
                [float(row.get(f"{term}.{colour}", 0)) for term in TERMS for colour in "RGB"]
            )
            for row in csv.DictReader(file)
        }

"""Movies there and back, against BT.709 written out, and what must not pass for a movie."""

import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from procam.errors import FileFormatError, InputError
from procam.files.images.movie_writer import new_movie
from procam.files.images.movies import MovieFrame, MovieReader

av = pytest.importorskip("av", reason="needs the extra `video`")
SIZE, FRAMES = 32, 5
KR, KB = 0.2126, 0.0722  # BT.709
HALF_STEP = 0.5 / 255
SIXTEEN = 2e-4  # swscale's own rounding, of full scale


def ycbcr(rgb: np.ndarray, bits: int, full: bool) -> np.ndarray:
    """BT.709 codes (3,) of an RGB colour 0..1."""
    luma = rgb @ np.array([KR, 1 - KR - KB, KB])
    blue, red = (rgb[2] - luma) / (2 * (1 - KB)), (rgb[0] - luma) / (2 * (1 - KR))
    step = 2.0 ** (bits - 8)
    if full:
        top = 2**bits - 1
        codes = np.array([luma * top, blue * top + 2 ** (bits - 1), red * top + 2 ** (bits - 1)])
    else:
        codes = step * np.array([16 + 219 * luma, 128 + 224 * blue, 128 + 224 * red])
    return np.rint(codes.clip(0, 2**bits - 1))


def colour_of(codes: np.ndarray, bits: int, full: bool) -> np.ndarray:
    """RGB 0..1 of BT.709 codes; not the inverse of `ycbcr`, which rounds."""
    step, top, middle = 2.0 ** (bits - 8), 2**bits - 1, 2 ** (bits - 1)
    if full:
        luma, blue, red = codes[0] / top, (codes[1] - middle) / top, (codes[2] - middle) / top
    else:
        luma = (codes[0] / step - 16) / 219
        blue, red = (codes[1] / step - 128) / 224, (codes[2] / step - 128) / 224
    r, b = luma + 2 * (1 - KR) * red, luma + 2 * (1 - KB) * blue
    return np.clip([r, (luma - KR * r - KB * b) / (1 - KR - KB), b], 0, 1)


def flat(layout: str, planes: list[float]) -> Any:
    """A frame of one colour, given by its codes."""
    frame = av.VideoFrame(SIZE, SIZE, layout)
    for plane, value in zip(frame.planes, planes, strict=True):
        wide = plane.line_size * plane.height
        dtype = np.uint8 if wide < 2 * plane.width * plane.height else np.uint16
        plane.update(np.full(plane.buffer_size // dtype().itemsize, value, dtype).tobytes())
    return frame


def shoot(path: Path, layout: str, frames: list[Any], **tags: Any) -> Path:
    """A lossless movie of ready frames at 30000/1001 frames per second, with sound if asked."""
    sound = tags.pop("sound", False)
    with av.open(str(path), "w") as movie:
        stream = movie.add_stream(tags.pop("codec", "ffv1"), rate=Fraction(30000, 1001))
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, layout
        for name, value in ({"color_trc": 13} | tags).items():
            setattr(stream.codec_context, name, value)
        stream.metadata["timecode"], movie.metadata["title"] = "10:00:00:00", "sky"
        heard = movie.add_stream("pcm_s16le", rate=48000) if sound else None
        for index, frame in enumerate(frames):
            frame.pts, frame.time_base = index, Fraction(1001, 30000)
            for name in ("color_range", "colorspace"):
                if name in tags:
                    setattr(frame, name, tags[name])
            movie.mux(stream.encode(frame))
            if heard:
                tone = (1000 * np.sin(np.arange(1600) + 1600 * index)).astype(np.int16)
                piece = av.AudioFrame.from_ndarray(tone[None], format="s16", layout="mono")
                piece.rate, piece.pts = 48000, 1600 * index
                movie.mux(heard.encode(piece))
        movie.mux(stream.encode())
        if heard:
            movie.mux(heard.encode())
    return path


def noise(layout: str = "rgb24", count: int = FRAMES) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    channels = 4 if layout.startswith("rgba") else 3
    deep = layout in ("rgb48le", "rgba64le")
    top, dtype = (65536, np.uint16) if deep else (256, np.uint8)
    return [rng.integers(0, top, (SIZE, SIZE, channels)).astype(dtype) for _ in range(count)]


def lossless(path: Path, layout: str = "rgb24", **tags: Any) -> list[np.ndarray]:
    """Write a movie of noise; returns its frames."""
    stored = {"rgb24": "bgr0", "rgba": "bgra", "rgb48le": "gbrp16le", "rgba64le": "gbrap16le"}
    shots = noise(layout)
    frames = [
        av.VideoFrame.from_ndarray(f, format=layout).reformat(format=stored[layout]) for f in shots
    ]
    shoot(path, stored[layout], frames, **tags)
    return shots


def through(source: Path, out: Path, transfer: str = "srgb") -> list[MovieFrame]:
    """Copy a movie frame by frame; returns what the copy shows."""
    with MovieReader(source) as reader, new_movie(out, reader, transfer=transfer) as movie:
        for frame in reader:
            movie.write(frame.rgb, frame)
    with MovieReader(out) as reader:
        return list(reader)


class TestReading:
    @pytest.mark.parametrize("full", [False, True])
    @pytest.mark.parametrize(
        ("layout", "bits"),
        [
            ("yuv420p", 8),
            ("yuv444p", 8),
            ("yuv420p10le", 10),
            ("yuv422p10le", 10),
            ("yuv444p12le", 12),
        ],
    )
    def test_codes_mean_what_bt709_says(
        self, tmp_path: Path, layout: str, bits: int, full: bool
    ) -> None:
        rng = np.random.default_rng(bits)
        colours = [np.ones(3), np.zeros(3), *rng.random((6, 3))]
        codes = [ycbcr(colour, bits, full) for colour in colours]
        frames = [flat(layout, list(code)) for code in codes]
        path = shoot(tmp_path / "m.mkv", layout, frames, color_range=2 if full else 1, colorspace=1)
        with MovieReader(path) as reader:
            assert reader.dtype == (np.uint8 if bits == 8 else np.uint16)
            shown = [frame.rgb / np.iinfo(reader.dtype).max for frame in reader]
        for rgb, code in zip(shown, codes, strict=True):
            error = np.abs(rgb - colour_of(code, bits, full)).max()
            assert error <= (HALF_STEP * 1.02 if bits == 8 else SIXTEEN)

    @pytest.mark.parametrize(
        ("number", "name"), [(1, "bt1886"), (2, None), (4, "gamma2.2"), (8, "linear"), (16, None)]
    )
    def test_the_transfer_function_by_name(
        self, tmp_path: Path, number: int, name: str | None
    ) -> None:
        lossless(tmp_path / "m.mkv", color_trc=number)
        with MovieReader(tmp_path / "m.mkv") as reader:
            assert reader.transfer == name


class TestWriting:
    @pytest.mark.parametrize("layout", ["rgb24", "rgba", "rgb48le", "rgba64le"])
    def test_ffv1_is_lossless(self, tmp_path: Path, layout: str) -> None:
        shots = lossless(tmp_path / "m.mkv", layout)
        for frame, shot in zip(through(tmp_path / "m.mkv", tmp_path / "o.mkv"), shots, strict=True):
            np.testing.assert_array_equal(frame.rgb, shot[..., :3])
            if "a" in layout:
                np.testing.assert_array_equal(frame.alpha, shot[..., 3])

    @pytest.mark.parametrize("layout", ["rgb24", "rgb48le"])
    def test_prores_holds_flat_colours_to_a_step_of_10_bits(
        self, tmp_path: Path, layout: str
    ) -> None:
        top = 255 if layout == "rgb24" else 65535
        colours = (np.random.default_rng(1).random((FRAMES, 3)) * top).round()
        colours[0] = top
        shots = [
            np.full((SIZE, SIZE, 3), c, np.uint8 if top == 255 else np.uint16) for c in colours
        ]
        stored = {"rgb24": "bgr0", "rgb48le": "gbrp16le"}[layout]
        frames = [
            av.VideoFrame.from_ndarray(s, format=layout).reformat(format=stored) for s in shots
        ]
        shoot(tmp_path / "m.mkv", stored, frames)
        shown = through(tmp_path / "m.mkv", tmp_path / "o.mov")
        for frame, colour in zip(shown, colours, strict=True):
            assert np.abs(frame.rgb / 65535 - colour / top).max() < 2 / 1023

    def test_prores_keeps_alpha(self, tmp_path: Path) -> None:
        shots = lossless(tmp_path / "m.mkv", "rgba")
        for frame, shot in zip(through(tmp_path / "m.mkv", tmp_path / "o.mov"), shots, strict=True):
            assert frame.alpha is not None
            assert np.abs(frame.alpha / 65535 - shot[..., 3] / 255).max() < HALF_STEP
            assert (frame.alpha[shot[..., 3] == 255] == 65535).all()

    @pytest.mark.parametrize("suffix", [".mov", ".mkv"])
    def test_time_tags_and_sound_are_kept(self, tmp_path: Path, suffix: str) -> None:
        tags = {"color_primaries": 9, "sample_aspect_ratio": Fraction(1, 1), "sound": True}
        lossless(tmp_path / "m.mkv", **tags)
        out = tmp_path / f"o{suffix}"
        through(tmp_path / "m.mkv", out, "gamma2.2")
        with av.open(str(out)) as movie:
            stream = movie.streams.video[0]
            context = stream.codec_context
            times = [float(f.pts * f.time_base) for f in movie.decode(stream)]
            assert stream.average_rate == Fraction(30000, 1001)
            assert (int(context.color_trc), int(context.color_primaries)) == (4, 9)
            assert int(context.color_range) == (1 if suffix == ".mov" else 2)
            assert int(context.colorspace) == (1 if suffix == ".mov" else 0)
            labels = {k.lower(): v for k, v in (stream.metadata | movie.metadata).items()}
            assert (labels["timecode"], labels["title"]) == ("10:00:00:00", "sky")
        exact = 1e-9 if suffix == ".mov" else 5.1e-4  # Matroska counts milliseconds
        np.testing.assert_allclose(times, np.arange(FRAMES) * 1001 / 30000, atol=exact)
        np.testing.assert_array_equal(self.heard(out), self.heard(tmp_path / "m.mkv"))

    def heard(self, path: Path) -> np.ndarray:
        with av.open(str(path)) as movie:
            return np.concatenate([f.to_ndarray()[0] for f in movie.decode(audio=0)])

    def test_frames_at_uneven_times_stay_there(self, tmp_path: Path) -> None:
        frames = [
            av.VideoFrame.from_ndarray(f, format="rgb24").reformat(format="bgr0") for f in noise()
        ]
        at = [0, 40, 47, 200, 1000]
        with av.open(str(tmp_path / "m.mkv"), "w") as movie:
            stream = movie.add_stream("ffv1", rate=25)
            stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "bgr0"
            stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
            for frame, pts in zip(frames, at, strict=True):
                frame.pts, frame.time_base = pts, Fraction(1, 1000)
                movie.mux(stream.encode(frame))
            movie.mux(stream.encode())
        through(tmp_path / "m.mkv", tmp_path / "o.mov")
        with av.open(str(tmp_path / "o.mov")) as movie:
            times = [1000 * float(f.pts * f.time_base) for f in movie.decode(video=0)]
        np.testing.assert_allclose(times, at, atol=1e-6)

    def test_a_movie_that_failed_leaves_no_file(self, tmp_path: Path) -> None:
        lossless(tmp_path / "m.mkv")
        with (
            pytest.raises(RuntimeError),
            MovieReader(tmp_path / "m.mkv") as reader,
            new_movie(tmp_path / "o.mov", reader, transfer="srgb") as movie,
        ):
            frame = next(iter(reader))
            movie.write(frame.rgb, frame)
            raise RuntimeError
        assert [p.name for p in tmp_path.iterdir()] == ["m.mkv"]

    def test_other_suffixes_are_refused(self, tmp_path: Path) -> None:
        lossless(tmp_path / "m.mkv")
        with (
            MovieReader(tmp_path / "m.mkv") as reader,
            pytest.raises(
                InputError, match=r"written as \.mov \(ProRes 4444\) or \.mkv .* not '\.mp4'"
            ),
            new_movie(tmp_path / "o.mp4", reader, transfer="srgb"),
        ):
            pass


class TestDamage:
    def test_a_truncated_movie(self, tmp_path: Path) -> None:
        lossless(tmp_path / "m.mkv")
        lossless(tmp_path / "whole.mkv", "rgb48le")
        through(tmp_path / "whole.mkv", tmp_path / "m.mov")
        content = (tmp_path / "m.mov").read_bytes()
        for share in (0.3, 0.9):
            (tmp_path / "cut.mov").write_bytes(content[: int(share * len(content))])
            with pytest.raises(
                FileFormatError, match=r"cut\.mov is not a complete movie"
            ) as caught:
                MovieReader(tmp_path / "cut.mov")
            assert "\n" not in str(caught.value)

    def test_frames_that_are_missing_at_the_end(self, tmp_path: Path) -> None:
        """An index at the front, as of a movie for the web, hides that the end is not there."""
        shots = noise(count=8)
        with av.open(str(tmp_path / "m.mov"), "w", options={"movflags": "faststart"}) as movie:
            stream = movie.add_stream("png", rate=25)
            stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "rgb24"
            for shot in shots:
                movie.mux(stream.encode(av.VideoFrame.from_ndarray(shot, format="rgb24")))
            movie.mux(stream.encode())
        self.cut(tmp_path / "m.mov")

    def test_a_truncated_matroska(self, tmp_path: Path) -> None:
        """It has no index, so the duration in its header has to show the damage."""
        lossless(tmp_path / "m.mkv")
        self.cut(tmp_path / "m.mkv")

    def cut(self, path: Path) -> None:
        content = path.read_bytes()
        path.write_bytes(content[: int(0.5 * len(content))])
        with MovieReader(path) as reader, pytest.raises(FileFormatError) as caught:
            list(reader)
        assert str(caught.value).startswith(str(path))
        assert "opy it again" in str(caught.value)

    @pytest.mark.parametrize("content", [b"", b"no movie\n" * 20])
    def test_foreign_files(self, tmp_path: Path, content: bytes) -> None:
        (tmp_path / "m.mov").write_bytes(content)
        with pytest.raises(FileFormatError, match=r"m\.mov is not a complete movie"):
            MovieReader(tmp_path / "m.mov")

    def test_an_absent_file(self, tmp_path: Path) -> None:
        with pytest.raises(FileFormatError, match="no such file; a movie is needed"):
            MovieReader(tmp_path / "m.mov")

    def test_sound_alone(self, tmp_path: Path) -> None:
        with av.open(str(tmp_path / "m.mkv"), "w") as movie:
            stream = movie.add_stream("pcm_s16le", rate=48000)
            tone = av.AudioFrame.from_ndarray(
                np.zeros((1, 64), np.int16), format="s16", layout="mono"
            )
            tone.rate, tone.pts = 48000, 0
            movie.mux(stream.encode(tone))
            movie.mux(stream.encode())
        with pytest.raises(FileFormatError, match="holds no pictures"):
            MovieReader(tmp_path / "m.mkv")

    def test_grey(self, tmp_path: Path) -> None:
        shoot(tmp_path / "m.mkv", "gray", [flat("gray", [9.0])])
        with pytest.raises(
            FileFormatError, match="has pictures of layout gray; encode it again in colour"
        ):
            MovieReader(tmp_path / "m.mkv")


class TestSilentDamage:
    """FFmpeg conceals what is wrong with FFV1, and goes on after what it cannot read of a container."""

    def _movie(
        self,
        path: Path,
        times: range | list[int] = range(6),
        *,
        options: dict[str, str] | None = None,
        layout: str = "bgr0",
    ) -> bytes:
        rng = np.random.default_rng(0)
        with av.open(str(path), "w") as movie:
            options = options or {"level": "3", "slicecrc": "1"}
            stream = movie.add_stream("ffv1", rate=25, options=options)
            stream.width, stream.height, stream.pix_fmt = 96, 64, layout
            for time in times:
                frame = av.VideoFrame.from_ndarray(rng.integers(0, 255, (64, 96, 3), np.uint8))
                frame = frame.reformat(format=layout)
                frame.pts = time
                movie.mux(stream.encode(frame))
            movie.mux(stream.encode())
        return path.read_bytes()

    @pytest.mark.parametrize("place", [0.2, 0.5, 0.9])
    def test_a_changed_bit_of_a_frame_is_noticed(self, tmp_path: Path, place: float) -> None:
        path = tmp_path / "a.mkv"
        content = bytearray(self._movie(path))
        content[int(place * len(content))] ^= 4
        path.write_bytes(content)
        with MovieReader(path) as movie, pytest.raises(FileFormatError, match="checksum of the fr"):
            list(movie)

    @pytest.mark.parametrize(
        "options",
        [
            {"level": "1"},
            {"level": "3", "slicecrc": "0"},
            {"level": "3", "slices": "24", "g": "3"},
            {"level": "4", "strict": "-2"},
        ],
    )
    @pytest.mark.parametrize("layout", ["bgr0", "gbrp16le", "yuv422p10le"])
    def test_other_versions_are_read(
        self, tmp_path: Path, options: dict[str, str], layout: str
    ) -> None:
        self._movie(tmp_path / "a.mkv", options=options, layout=layout)
        with MovieReader(tmp_path / "a.mkv") as movie:
            assert len(list(movie)) == 6 and movie.note == ""

    def test_undamaged_and_without_checksums(self, tmp_path: Path) -> None:
        self._movie(tmp_path / "a.mkv")
        for path in (tmp_path / "a.mkv", shoot(tmp_path / "b.mkv", "bgr0", [flat("bgr0", [9])])):
            with MovieReader(path) as movie:
                assert list(movie) and movie.note == ""

    @pytest.mark.parametrize(
        ("times", "words"),
        [
            ([0, 1, 2, 4, 5], "frame 3 of .* is shown at 0.160 s"),
            ([1, 2, 3], "first frame is shown"),
        ],
    )
    def test_a_frame_that_is_missing_is_named(
        self, tmp_path: Path, times: list[int], words: str
    ) -> None:
        self._movie(tmp_path / "a.mkv", times)
        with MovieReader(tmp_path / "a.mkv") as movie:
            assert len(list(movie)) == len(times)
            assert re.search(words + ".*, out of step with 25 frames per second", movie.note)

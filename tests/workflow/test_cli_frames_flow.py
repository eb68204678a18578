"""The machine that clips run through: order, bounds, errors; and pipes."""

import fcntl
import gc
import io
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count, islice
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from tiny_venue import refused

from procam.errors import FileFormatError, InputError
from procam.files.calibration import save_calibration
from procam.files.system import widen_pipe
from procam.interfaces.cli._pipe import _latency
from procam.model.calibration import Calibration
from procam.workflows.playout.compensate import compensate_clip, each_frame
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.pipe_clip import PIXELS, PipeClip, pixel_type, read_frame, write_frame
from procam.workflows.playout.pipeline import ThreadPlan, flow
from procam.workflows.playout.sources import ClipFrame, count_above_one

SIZE = 24
PATIENCE_S = 20.0


def same(frame: int) -> Callable[[], int]:
    return lambda: frame


class TestFlow:
    @pytest.mark.parametrize("plan", [ThreadPlan(1, 1), ThreadPlan(1, 3), ThreadPlan(4, 8)])
    def test_everything_comes_in_order(self, plan: ThreadPlan) -> None:
        made = flow((same(n) for n in range(50)), lambda n: lambda: 10 * n, plan)
        assert list(made) == [10 * n for n in range(50)]

    def test_a_read_of_none_ends_it(self) -> None:
        numbers = iter([1, 2, None, 3])
        reads = (lambda: next(numbers) for _ in count())
        assert list(flow(reads, lambda n: lambda: n, ThreadPlan(1, 1))) == [1, 2]

    def test_no_more_frames_live_than_the_plan_allows(self) -> None:
        """1,000 frames; what is read and not yet written is counted."""
        lock, live, most = threading.Lock(), 0, 0

        def change(by: int) -> None:
            nonlocal live, most
            with lock:
                live += by
                most = max(most, live)

        def read() -> int:
            change(1)
            return 1

        def work(frame: int) -> Callable[[], None]:
            return lambda: change(-1)

        plan = ThreadPlan(3, 4)
        assert sum(1 for _ in flow((read for _ in range(1000)), work, plan)) == 1000
        # read ahead, at work, waiting to be written or being written
        assert most <= (plan.depth + 1) + 1 + (plan.depth + 1)

    def test_what_came_before_a_bad_frame_is_written(self) -> None:
        written: list[int] = []

        def reads() -> Iterator[Callable[[], int]]:
            yield same(1)
            yield same(2)
            yield lambda: int("bad")
            yield same(4)

        def work(frame: int) -> Callable[[], None]:
            return lambda: written.append(frame)

        with pytest.raises(ValueError, match="bad"):
            list(flow(reads(), work, ThreadPlan(2, 2)))
        assert written == [1, 2]

    def test_an_error_of_the_writer_arrives(self) -> None:
        def work(frame: int) -> Callable[[], int]:
            return lambda: 1 // (3 - frame)

        with pytest.raises(ZeroDivisionError):
            list(flow((same(n) for n in range(9)), work, ThreadPlan(1, 1)))

    def test_reading_goes_on_while_a_frame_is_worked_on(self) -> None:
        second = threading.Event()

        def reads() -> Iterator[Callable[[], int]]:
            yield same(1)
            yield lambda: second.set() or 2  # type: ignore[func-returns-value]

        def work(frame: int) -> Callable[[], int]:
            assert second.wait(PATIENCE_S)
            return lambda: frame

        assert list(flow(reads(), work, ThreadPlan(1, 1))) == [1, 2]

    def test_crews_hold_less_of_large_frames(self) -> None:
        assert ThreadPlan.for_pictures(2**20).depth >= ThreadPlan.for_pictures(2**33).depth == 1
        assert ThreadPlan.for_movie(2**33).threads == 1


class Feed:
    """A pipe that gives a few bytes at a time, as pipes do."""

    def __init__(self, content: bytes, step: int = 1000) -> None:
        self._content, self._step = io.BytesIO(content), step

    def readinto(self, view: memoryview, /) -> int:
        got = self._content.read(min(self._step, len(view)))
        view[: len(got)] = got
        return len(got)


class Drip(io.RawIOBase):
    """A pipe that takes a few bytes at a time."""

    def __init__(self) -> None:
        super().__init__()
        self.content = b""

    def writable(self) -> bool:
        return True

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        self.content += bytes(data[:777])
        return len(data[:777])


class TestPipe:
    @pytest.mark.parametrize("name", PIXELS)
    def test_frames_pass_whole_through_pipes_that_split_them(self, name: str) -> None:
        dtype = pixel_type(name)
        frame = np.random.default_rng(2).random((5, 5, 3)).astype(dtype)
        out, again = Drip(), np.empty_like(frame)
        write_frame(out, frame)  # type: ignore[arg-type]
        assert out.content == frame.tobytes()
        pipe = Feed(out.content, 7)
        assert read_frame(pipe, again, 0)  # type: ignore[arg-type]
        np.testing.assert_array_equal(again, frame)
        assert not read_frame(pipe, again, 1)  # type: ignore[arg-type]

    def test_a_part_of_a_frame_is_refused(self) -> None:
        with pytest.raises(
            FileFormatError, match="stdin ended after 50 of the 75 bytes of frame 3"
        ):
            read_frame(Feed(bytes(50)), np.empty((5, 5, 3), np.uint8), 3)  # type: ignore[arg-type]

    def test_an_unknown_layout_is_refused_with_the_list(self) -> None:
        with pytest.raises(
            InputError, match="--pixels is 'yuv420p'; it must be one of rgb24, rgb48le"
        ):
            pixel_type("yuv420p")

    def test_a_clip_through_it(self, calibration: Calibration) -> None:
        """Strength 0 leaves 16-bit frames alone, so that the pipe alone is judged."""
        frames = np.random.default_rng(4).integers(0, 65536, (3, SIZE, SIZE, 3)).astype(np.uint16)
        out = Drip()
        clip = PipeClip((Feed(frames.tobytes()), out), SIZE, np.dtype(np.uint16))  # type: ignore[arg-type]
        events = list(compensate_clip(calibration, clip, FrameSettings(strength=0.0)))
        assert [e.done for e in events] == [0, 1, 2, 3]
        found = np.frombuffer(out.content, np.uint16).reshape(frames.shape)
        assert np.abs(found.astype(int) - frames).max() <= 1
        message = _latency(clip)
        assert message.startswith("3 frames; latency median ")
        assert all(f" {word} " in message for word in ("95 % within", "longest"))

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["-", "out.exr"], "IN is - and OUT is out.exr; either both are -"),
            (["-", "-"], "give --edge and --pixels"),
            (["-", "-", "--edge", "9000000", "--pixels", "rgb24"], "--edge is 9000000 px"),
            (
                ["-", "-", "--edge", "1", "--pixels", "rgb24"],
                "--edge is 1 px; it must be that of a frame, from 2 to 16384",
            ),
            (["-", "-", "--edge", "8", "--pixels", "yuv420p"], "must be one of rgb24"),
            (["-", "-", "--edge", "8", "--pixels", "rgb24", "--json"], "cannot be used on a pipe"),
            (["a.exr", "b.exr", "--edge", "8"], "--edge and --pixels are for pipes"),
        ],
    )
    def test_refusals(
        self, arguments: list[str], words: str, calibration: Calibration, tmp_path: Path
    ) -> None:
        save_calibration(calibration, tmp_path / "kept")
        assert words in refused("compensate", tmp_path / "kept", *arguments)


class TestAboveOne:
    @pytest.mark.parametrize("dtype", [np.float16, np.float32])
    def test_pixels_are_counted(self, dtype: type) -> None:
        light = np.full((4, 4, 3), 1.0, dtype)
        light[0, 0], light[1, 1, 2], light[2, 2] = 1.01, 7, -3
        assert count_above_one("sky", light) == 2

    def test_integers_have_none(self) -> None:
        assert count_above_one("sky", np.full((4, 4, 3), 255, np.uint8)) == 0

    @pytest.mark.parametrize("dtype", [np.float16, np.float32])
    @pytest.mark.parametrize("bad", [np.nan, -np.nan, np.inf, -np.inf])
    def test_what_is_no_light_is_refused_by_name(self, dtype: type, bad: float) -> None:
        light = np.zeros((4, 4, 3), dtype)
        light[1, 2, 0] = bad
        with pytest.raises(FileFormatError, match="frame 3: 1 values are NaN or infinite"):
            count_above_one("frame 3", light)


class TestFirstPixel:
    """Nothing that costs time stands on the way to it; `make bench` takes the time."""

    SLOW = frozenset(
        """
        av colour cv2 jinja2 matplotlib numba numpy.random procam.estimate rich.console scipy serial
        """.split()
    )

    def test_it_imports_nothing_it_does_not_need(
        self, calibration: Calibration, tmp_path: Path
    ) -> None:
        save_calibration(calibration, tmp_path / "kept")
        size = 2 * calibration.maps.size
        pipe = ["-", "-", "--pixels", "rgb24", "--edge", f"{size}"]
        code = (
            f"import sys; sys.argv = ['procam', 'compensate', {str(tmp_path / 'kept')!r}, *{pipe}]\n"
            "from procam.interfaces.cli.main import main\n"
            "try: main()\nfinally: print('LOADED', *sys.modules, file=sys.stderr)"
        )
        sent = np.random.default_rng(1).integers(0, 256, (size, size, 3), np.uint8).tobytes()
        ran = subprocess.run(
            [sys.executable, "-c", code], input=sent, capture_output=True, check=True
        )
        assert len(ran.stdout) == len(sent)
        loaded = set(ran.stderr.decode().partition("LOADED")[2].split())
        assert "procam.compensate.compensator" in loaded
        assert not self.SLOW & loaded

    def test_the_first_frame_is_read_while_a_calibration_is(self) -> None:
        started = threading.Event()

        class Signalling(Feed):
            def readinto(self, view: memoryview, /) -> int:
                started.set()
                return super().readinto(view)

        frames = np.random.default_rng(4).integers(0, 256, (2, SIZE, SIZE, 3), np.uint8)
        clip = PipeClip((Signalling(frames.tobytes()), Drip()), SIZE, np.dtype(np.uint8))  # type: ignore[arg-type]
        assert started.wait(PATIENCE_S)
        pieces = [job() for job in islice(clip.reads(), 3)]
        assert pieces[2] is None
        for number, frame in enumerate(frames):
            piece = pieces[number]
            assert piece is not None and piece.number == number
            np.testing.assert_array_equal(piece.rgb, frame)

    def test_it_is_not_kept(self) -> None:
        some = np.zeros((3, SIZE, SIZE, 3), np.uint8)
        clip = PipeClip((Feed(some.tobytes()), Drip()), SIZE, np.dtype(np.uint8))  # type: ignore[arg-type]
        kept = []

        def work(piece: ClipFrame) -> Callable[[], int]:
            kept.append(weakref.ref(piece.rgb))
            return lambda: piece.number

        with clip:
            for number in each_frame(clip, work):
                gc.collect()
                assert number == 0 or kept[0]() is None

    def test_its_errors_come_where_it_is_asked_for(self, calibration: Calibration) -> None:
        clip = PipeClip((Feed(bytes(50)), Drip()), SIZE, np.dtype(np.uint8))  # type: ignore[arg-type]
        with pytest.raises(
            FileFormatError, match="stdin ended after 50 of the 1728 bytes of frame 0"
        ):
            list(compensate_clip(calibration, clip, FrameSettings()))

    def test_it_comes_before_the_calibration_is_there(
        self, calibration: Calibration, tmp_path: Path
    ) -> None:
        """A frame that no pipe holds is taken while the calibration is waited for."""
        save_calibration(calibration, tmp_path / "kept")
        (tmp_path / "kept").rename(tmp_path / "later")
        code = (
            "import time; from pathlib import Path; import procam.interfaces.cli._pipe as frames\n"
            "load = frames.load_dome\n"
            "def late(path):\n"
            f"    until = time.monotonic() + {PATIENCE_S}\n"
            "    while not path.exists() and time.monotonic() < until: time.sleep(0.01)\n"
            "    return load(path)\n"
            "frames.load_dome = late\n"
            "from procam.interfaces.cli.main import main; main()"
        )
        sent = bytes(300 * 300 * 3)
        with _compensating(code, tmp_path / "kept", 300) as child:
            assert child.stdin is not None and child.stdout is not None
            child.stdin.write(sent)
            child.stdin.close()
            (tmp_path / "later").rename(tmp_path / "kept")
            assert len(child.stdout.read()) == len(sent)

    def test_a_calibration_that_is_not_there_is_reported_though_no_frame_comes(
        self, tmp_path: Path
    ) -> None:
        with _compensating(MAIN, tmp_path / "none", 64) as child:
            assert child.stderr is not None
            said = child.stderr.read().decode().splitlines()
            assert len(said) == 1 and "has no calibration.json" in said[0]
            assert child.wait(PATIENCE_S) == 2

    @pytest.mark.parametrize("frames", [0, 1])
    def test_an_interrupt_while_a_frame_is_waited_for(
        self, calibration: Calibration, tmp_path: Path, frames: int
    ) -> None:
        save_calibration(calibration, tmp_path / "kept")
        with _compensating(f"{HEARD}; {MAIN}", tmp_path / "kept", 64) as child:
            assert child.stdin is not None and child.stdout is not None
            child.stdin.write(bytes(frames * 64 * 64 * 3 + 100))
            child.stdin.flush()
            child.stdout.read(frames * 64 * 64 * 3)
            _require_one_line_of_interrupt(child)

    def test_an_interrupt_while_nobody_takes_a_frame(
        self, calibration: Calibration, tmp_path: Path
    ) -> None:
        save_calibration(calibration, tmp_path / "kept")
        with _compensating(f"{HEARD}; {MAIN}", tmp_path / "kept", 1024) as child:
            assert child.stdin is not None and child.stdout is not None
            threading.Thread(target=_sent, args=(child.stdin, bytes(4 * 1024 * 1024 * 3))).start()
            child.stdout.read(10)
            _require_one_line_of_interrupt(child)

    @pytest.mark.parametrize(("descriptor", "name"), [(0, "IN"), (1, "OUT")])
    def test_a_pipe_that_is_closed_is_named(
        self, calibration: Calibration, tmp_path: Path, descriptor: int, name: str
    ) -> None:
        save_calibration(calibration, tmp_path / "kept")
        with _compensating(
            f"import os; os.close({descriptor}); {MAIN}", tmp_path / "kept", 64
        ) as child:
            assert child.stderr is not None
            said = child.stderr.read().decode()
            assert child.wait(PATIENCE_S) == 2
            assert said.startswith(
                f"procam: {name}: - was given, but no pipe or file is open at {descriptor}"
            )

    def test_a_pipe_holds_a_frame_at_most(self) -> None:
        source, sink = os.pipe()
        try:
            before = fcntl.fcntl(sink, fcntl.F_GETPIPE_SZ)
            widen_pipe(sink, 100)
            assert fcntl.fcntl(sink, fcntl.F_GETPIPE_SZ) == before
            widen_pipe(sink, 2**18)
            assert fcntl.fcntl(sink, fcntl.F_GETPIPE_SZ) == 2**18
            widen_pipe(sink, 2**30)
            assert fcntl.fcntl(sink, fcntl.F_GETPIPE_SZ) == 2**20
        finally:
            os.close(source)
            os.close(sink)


HEARD = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # in any shell
MAIN = "from procam.interfaces.cli.main import main; main()"


def _require_one_line_of_interrupt(child: "subprocess.Popen[bytes]") -> None:
    assert child.stderr is not None
    time.sleep(1.5)  # until it waits
    child.send_signal(signal.SIGINT)
    assert child.wait(PATIENCE_S) == 130
    said = child.stderr.read().decode().strip().splitlines()
    assert len(said) == 1 and said[0].startswith("procam: stopped")


def _sent(pipe: IO[bytes], content: bytes) -> None:
    with suppress(BrokenPipeError):
        pipe.write(content)


def _compensating(code: str, calibration: Path, size: int) -> "subprocess.Popen[bytes]":
    pipe = ["-", "-", "--pixels", "rgb24", "--edge", f"{size}"]
    every = subprocess.PIPE
    command = [sys.executable, "-c", code, "compensate", str(calibration), *pipe]
    return subprocess.Popen(command, stdin=every, stdout=every, stderr=every)

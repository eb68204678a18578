"""A session returns the frames it stored, and refuses all others."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.session import Session
from procam.model.frame import CameraSettings, Frame
from procam.model.plan import Plan, Shot

SIZE = (40, 30)
WHITE = Shot("south-0000", "south", "patterns/south/0000.png", "white", (0.1,))
CODE = Shot(
    "south-0001",
    "south",
    "patterns/south/0001.png",
    "code",
    (0.1, 0.25),
    "mono",
    {"axis": "x", "bit": 3, "inverse": 1},
)


def _frame(seed: int, pixel_format: str = "rgb", size: tuple[int, int] = SIZE) -> Frame:
    shape = (size[1], size[0], 3) if pixel_format == "rgb" else (size[1], size[0])
    counts = np.random.default_rng(seed).integers(0, 65536, shape).astype(np.uint16)
    return Frame(counts, CameraSettings(0.1, pixel_format), 10.0 + seed, 10.5 + seed)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path / "0001")


@pytest.fixture
def stored(session: Session) -> Session:
    session.store("zenith", WHITE, 0.1, _frame(1))
    session.store("zenith", CODE, 0.25, _frame(2, "mono"))
    return session


def _file(session: Session, name: str) -> Path:
    return session.directory / "captures" / "zenith" / name


def _plan_with(twice: bool = False, **changed: object) -> str:
    shot = {"id": "a", "projector": "p", "pattern": "p/a.png", "purpose": "white"}
    shot |= {"exposures_s": [1]} | changed
    return json.dumps({"schema": 1, "shots": [shot] * (1 + twice)})


class TestPlan:
    def test_comes_back(self, session: Session) -> None:
        plan = Plan((Shot("dark", "", "", "dark", (0.1, 5.0)), WHITE, CODE))
        patterns = {
            WHITE.pattern: np.full((4, 6, 1), 255, np.uint8),
            CODE.pattern: np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3),
        }
        session.write_plan(plan, patterns)
        assert session.read_plan() == plan
        np.testing.assert_array_equal(session.pattern(WHITE), np.ones((4, 6, 3)))
        drive = session.pattern(CODE)
        np.testing.assert_array_equal(np.rint(drive * 255), patterns[CODE.pattern])

    def test_none(self, session: Session) -> None:
        with pytest.raises(
            FileFormatError, match=r"plan\.json: no such file.*procam session capture"
        ):
            session.read_plan()

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ('{"schema": 1, "shots": [', "damaged JSON"),
            ("[]", "holds a JSON list; it must be an object"),
            ('{"schema": 7, "shots": []}', "has schema 7"),
            ('{"schema": 1}', "shots"),
            (
                '{"schema": 1, "shots": [{"id": "a"}]}',
                "shot 0 is damaged (projector: field required)",
            ),
            (_plan_with(bogus=2), "shot 0 is damaged (bogus: extra inputs are not permitted)"),
            (
                _plan_with(id="../../x"),
                "shot 0 is damaged (id: '../../x' is no name that procam gives",
            ),
            (_plan_with(pattern="patterns/../../x.png"), "shot 0 is damaged (pattern: '"),
            (
                _plan_with(exposures_s=[0]),
                "shot 0 is damaged (exposures_s.0: input should be greater",
            ),
            (_plan_with(twice=True), "two shots are called a; restore"),
            ('{"schema": 1, "shots": ["a"]}', "shot 0 is damaged"),
            ("[" * 100000, "damaged JSON"),
        ],
    )
    def test_damaged(self, session: Session, text: str, message: str) -> None:
        session.directory.mkdir()
        (session.directory / "plan.json").write_text(text)
        with pytest.raises(FileFormatError) as caught:
            session.read_plan()
        assert str(caught.value).startswith(str(session.directory / "plan.json"))
        assert message in str(caught.value) and "\n" not in str(caught.value)


class TestRoundTrip:
    @pytest.mark.parametrize(("shot", "exposure_s", "seed"), [(WHITE, 0.1, 1), (CODE, 0.25, 2)])
    def test_load_gives_what_was_stored(
        self, stored: Session, shot: Shot, exposure_s: float, seed: int
    ) -> None:
        frame = stored.load("zenith", shot, exposure_s, SIZE)
        expected = _frame(seed, "rgb" if shot is WHITE else "mono")
        np.testing.assert_array_equal(frame.counts, expected.counts)
        assert frame.counts.dtype == np.uint16
        assert frame.settings == expected.settings
        assert (frame.started_s, frame.ended_s) == (expected.started_s, expected.ended_s)

    def test_another_exposure_than_planned_is_kept(self, session: Session) -> None:
        session.write_plan(Plan((WHITE,)), {WHITE.pattern: np.zeros((4, 6, 1), np.uint8)})
        frame = replace(_frame(1), settings=CameraSettings(0.08))
        session.store("zenith", WHITE, 0.1, frame)
        again = Session(session.directory)
        assert again.load("zenith", WHITE, 0.1, SIZE).settings.exposure_s == 0.08

    def test_stored_lists_the_frames_on_disk(self, stored: Session) -> None:
        assert set(stored.stored("zenith")) == {("south-0000", 0.1), ("south-0001", 0.25)}
        assert stored.stored("other") == {}

    def test_an_incomplete_index_line_affects_its_own_frame_only(self, stored: Session) -> None:
        index = _file(stored, "index.jsonl")
        index.write_bytes(index.read_bytes()[:-3])
        assert set(stored.stored("zenith")) == {("south-0000", 0.1)}
        stored.store("zenith", CODE, 0.25, _frame(2, "mono"))
        assert set(stored.stored("zenith")) == {("south-0000", 0.1), ("south-0001", 0.25)}

    def test_a_shot_taken_again_replaces_the_first(self, stored: Session) -> None:
        stored.store("zenith", WHITE, 0.1, _frame(9))
        found = stored.load("zenith", WHITE, 0.1, SIZE)
        np.testing.assert_array_equal(found.counts, _frame(9).counts)

    def test_the_gain_is_stored(self, session: Session) -> None:
        settings = CameraSettings(0.1, "rgb", gain=2.5)
        frame = _frame(1)
        session.store("zenith", WHITE, 0.1, Frame(frame.counts, settings, 1.0, 2.0))
        assert session.load("zenith", WHITE, 0.1, SIZE).settings == settings


class TestIndexInMemory:
    def test_the_file_is_read_once(self, stored: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        opened = Session(stored.directory)
        opened.stored("zenith")
        monkeypatch.setattr("procam.files.atomic.read_lines", None)
        opened.store("zenith", CODE, 0.1, _frame(3))
        assert len(opened.stored("zenith")) == 3
        np.testing.assert_array_equal(
            opened.load("zenith", CODE, 0.1, SIZE).counts, _frame(3).counts
        )

    def test_lines_appended_by_another_process_are_seen(self, stored: Session) -> None:
        other = Session(stored.directory)
        assert len(other.stored("zenith")) == 2
        stored.store("zenith", CODE, 0.1, _frame(3))
        assert len(other.stored("zenith")) == 3
        other.store("zenith", WHITE, 0.5, _frame(4))
        assert len(stored.stored("zenith")) == 4


class TestDamage:
    """Each damage has its own message."""

    def _message(self, session: Session, shot: Shot = WHITE, exposure_s: float = 0.1) -> str:
        with pytest.raises(FileFormatError) as caught:
            session.load("zenith", shot, exposure_s, SIZE)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    def test_never_captured(self, stored: Session) -> None:
        message = self._message(stored, CODE, 0.1)
        assert message.startswith(str(_file(stored, "x").parent))
        assert (
            "shot south-0001 at 0.1 s was not captured" in message
            and "procam session capture" in message
        )

    def test_file_gone(self, stored: Session) -> None:
        _file(stored, "south-0000@0.1.tif").unlink()
        message = self._message(stored)
        assert "shot south-0000 at 0.1 s was not captured" in message
        assert "takes only what is missing" in message

    @pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
    def test_truncated(self, stored: Session, share: float) -> None:
        path = _file(stored, "south-0000@0.1.tif")
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        message = self._message(stored)
        assert message.startswith(f"{path} is ")
        assert "truncated" in message or "not a readable image" in message

    def test_swapped_with_another_shot(self, stored: Session) -> None:
        stored.store("zenith", CODE, 0.1, _frame(3))
        white, code = _file(stored, "south-0000@0.1.tif"), _file(stored, "south-0001@0.1.tif")
        shutil.move(white, white.with_suffix(".x"))
        shutil.move(code, white)
        shutil.move(white.with_suffix(".x"), code)
        for path, shot in ((white, WHITE), (code, CODE)):
            message = self._message(stored, shot)
            assert message.startswith(f"{path} differs from the frame captured for shot {shot.id}")
            assert "swapped" in message and "capture again" in message

    def test_of_another_size(self, stored: Session) -> None:
        stored.store("zenith", WHITE, 0.1, _frame(1, size=(30, 40)))
        message = self._message(stored)
        assert message.startswith(f"{_file(stored, 'south-0000@0.1.tif')} has 30x40 px, ")
        assert "40x30" in message and "camera's size" in message

    def test_index_line_damaged(self, stored: Session) -> None:
        index = _file(stored, "index.jsonl")
        lines = index.read_text().splitlines()
        index.write_text("\n".join(["{broken", lines[1], ""]))
        message = self._message(stored)
        assert message.startswith(f"{index} is damaged JSON")

    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [
            ("file", "../other.tif", "line 1 is damaged (file: '../other.tif' is no name"),
            ("exposure_s", [1], "line 1 is damaged (exposure_s: input should be a valid number"),
            ("gain", None, "line 1 is damaged (gain: input should be a valid number"),
            ("started_s", "x", "line 1 is damaged (started_s: input should be a valid number"),
        ],
    )
    def test_index_line_of_other_types(
        self, stored: Session, key: str, value: object, message: str
    ) -> None:
        index = _file(stored, "index.jsonl")
        lines = [json.loads(line) for line in index.read_text().splitlines()]
        lines[0][key] = value
        index.write_text("".join(json.dumps(line) + "\n" for line in lines))
        found = self._message(stored)
        assert found.startswith(f"{index}: {message}") and "capture again" in found

    def test_index_names_a_digest_per_frame(self, stored: Session) -> None:
        """Of the counts as 16-bit numbers, the lowest byte first, row by row."""
        lines = _file(stored, "index.jsonl").read_text().splitlines()
        counts = (_frame(1).counts, _frame(2, "mono").counts)
        for line, pixels in zip(lines, counts, strict=True):
            expected = hashlib.sha256(pixels.astype("<u2").tobytes()).hexdigest()
            assert json.loads(line)["sha256"] == expected

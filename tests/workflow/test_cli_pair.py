"""`procam pair`: folders of published rendered photographs to both lenses and the pose between them."""

import json
import shutil
import threading
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import Ran, procam

from procam.errors import InputError
from procam.estimate.boards.planar_pair import PairView, fit_planar_pair
from procam.files.images.pixels import write_image
from procam.interfaces.cli import pair as command
from procam.interfaces.cli._boards import make_board
from procam.interfaces.cli._output import Output
from studies import boards as study
from studies import foreign_boards as foreign

LENS = foreign.PrismLens(np.array([905.0, 903, 650, 510, -0.1, 0.02, 0, 0, 0]), np.zeros(4))
SESSIONS = ("s00", "s03", "s05", "s11", "s15", "s17")
USED = ("s00", "s05", "s11")
BITS, EDGE = 10, 800
TURN_DEG = np.degrees([0.24285, 0.12374, 0.01512])  # Blender's own numbers, as is f 800 and c 399.5
SHIFT_M = np.array([-0.12403, 0.23891, -0.13242])
BOARD = ("--squares", "16x16", "--square-mm", "18.5", "--size", "800x800", "--code", "gray")


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder per session, in the order of `procam decode`; crops are put back in their frame."""
    folder = tmp_path_factory.mktemp("poses")
    halves = range(0, 4 * BITS, 2 * BITS)
    order = [half + plane for plane in range(2 * BITS) for half in halves] + [
        4 * BITS,
        4 * BITS + 1,
    ]
    path = resources.files("calib_data") / "captures" / "gsoup_six_sessions.npz"
    with path.open("rb") as file, np.load(file) as data:
        for name in USED:
            images, (x, y) = data[name], data["offsets"][SESSIONS.index(name)]
            for number, image in enumerate(images[order]):
                frame = np.zeros((EDGE, EDGE), np.uint8)
                frame[y : y + image.shape[0], x : x + image.shape[1]] = image
                write_image(folder / name / f"{number:02d}.png", frame)
    return folder


@pytest.fixture(scope="module")
def solved(poses: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Ran, str, Path]:
    """The pair of all poses and of a wall that the camera sees pixel by pixel; what it says; its file."""
    folder = tmp_path_factory.mktemp("pair")
    (folder / "poses").mkdir()
    for name in USED:
        (folder / "poses" / name).symlink_to(poses / name)
    wall = folder / "poses" / "wall"
    assert procam("patterns", "--size", "800x800", "--code", "gray", "--out", wall).code == 0
    out, said, say = folder / "pair.toml", list[str](), Output.say

    def heard(output: Output, text: str) -> None:
        said.append(text)
        say(output, text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Output, "say", heard)
        ran = procam("pair", folder / "poses", *BOARD, "--out", out, "--json")
    return ran, "\n".join(said), out


class TestSolves:
    def test_a_published_pair(self, solved: tuple[Ran, str, Path]) -> None:
        ran, _, out = solved
        assert ran.code == 0, ran.err
        document = json.loads(ran.out)
        parameters = document["parameters"]
        for name, truth, margin in (("fx", 800, 2), ("fy", 800, 2), ("cx", 399.5, 1.5)):
            for device in ("camera", "projector"):
                entry = parameters[f"{device}.{name}"]
                assert abs(entry["value"] - truth) < margin
                assert 0 < entry["sigma"] < margin
        turn = [parameters[f"turn_{axis}_deg"]["value"] for axis in "xyz"]
        np.testing.assert_allclose(turn, TURN_DEG, atol=0.05)
        np.testing.assert_allclose(document["translation_m"], SHIFT_M, atol=1e-3)
        assert document["poses"] == list(USED)
        assert document["figures"]["projector_rms"]["pass"]
        for device in ("camera", "projector"):
            figures = document["figures"]
            left_out, fitted = figures[f"{device}_held_out_rms"], figures[f"{device}_rms"]
            assert fitted["value"] < left_out["value"] < 0.25
        table = tomllib.loads(out.read_text())
        np.testing.assert_allclose(table["camera"]["f"], 800, atol=2)
        pose = table["projector_from_camera"]
        np.testing.assert_allclose(pose["rotation"], document["rotation"], atol=1e-8)
        assert np.linalg.det(pose["rotation"]) == pytest.approx(1, abs=1e-6)

    def test_stray_folders_are_skipped_before_any_work(
        self, poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for name in USED[:3]:
            (tmp_path / "poses").mkdir(exist_ok=True)
            (tmp_path / "poses" / name).symlink_to(poses / name)
        (tmp_path / "poses" / "notes").mkdir()
        (tmp_path / "poses" / "a try").mkdir()
        shutil.copy(poses / "s00" / "00.png", tmp_path / "poses" / "a try")
        decoded: list[str] = []

        def decode(place: Path, *_: object) -> None:
            decoded.append(place.name)
            raise InputError(f"{place}: stopped")

        monkeypatch.setattr(command, "decode_folder", decode)
        ran = procam("pair", tmp_path / "poses", *BOARD, "--out", tmp_path / "p.toml")
        assert (ran.code, "stopped" in ran.err) == (2, True)
        assert set(decoded) <= set(USED)
        text = "a try: 1 photographs, and the code gray needs 42; this is no pose, skipped"
        assert text in ran.out
        assert "notes: 0 photographs, and the code gray needs 42" in ran.out

    def test_poses_are_decoded_side_by_side(
        self, poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Two poses wait for each other; one after the other they would never meet."""
        monkeypatch.setattr(command, "WORKERS", 2)
        meeting = threading.Barrier(2, timeout=20)

        def decode(place: Path, *_: object) -> None:
            if place.name in USED[:2]:
                meeting.wait()
            raise InputError(f"{place}: met")

        monkeypatch.setattr(command, "decode_folder", decode)
        ran = procam("pair", poses, *BOARD, "--out", tmp_path / "p.toml")
        assert "s00: met" in ran.complaint

    def test_a_pose_without_a_board_is_left_out(self, solved: tuple[Ran, str, Path]) -> None:
        ran, said, out = solved
        assert ran.code == 0, ran.err
        assert "wall: no board is found that the projector lights; left out" in said
        # Blender's lenses have no distortion, and its board is flat
        assert "camera.k3" not in said
        assert "not solved for" in out.read_text()


def test_dropped_corners_are_named_by_pose_and_place(capsys: pytest.CaptureFixture[str]) -> None:
    """A board with one edge bent up sharply in two poses: only its corners there are dropped."""
    rng = np.random.default_rng(3)
    flat = foreign.flat_board()
    views: list[PairView] = []
    while len(views) < 8:
        rotation, shift = foreign.draw_pose(rng)
        points = flat.copy()
        if len(views) in (2, 5):
            points[flat[:, 0] > 0.155, 2] += 0.004
        points = points @ rotation.T + shift
        seen = [
            foreign.photograph(rng, lens, place, size)
            for lens, place, size in (
                (LENS, points, foreign.SIZE),
                (LENS, points @ study.TURN.T + study.SHIFT_M, foreign.PANEL),
            )
        ]
        if foreign.enough(seen):
            shown = np.isfinite(seen[0][:, 0])
            views.append(PairView(f"pose{len(views)}", flat[shown], *(s[shown] for s in seen)))
    fit = fit_planar_pair(views, foreign.SIZE, foreign.PANEL)
    command._print_dropped(fit, make_board("14x10", 13.5), Output(as_json=False))
    said = capsys.readouterr().out
    assert "pose2: the corner in column 13, row " in said
    assert " px off at (" in said
    assert "of the camera; dropped" in said
    assert "dropped corners are from one edge: the board is curled; glue it to a flat plate" in said


class TestRefuses:
    def refused(self, folder: Path, out: Path, *more: object) -> str:
        ran = procam("pair", folder, *(more or BOARD), "--out", out)
        assert ran.code == 2, ran
        assert not out.exists()
        return ran.complaint

    def test_folders_and_options(self, tmp_path: Path) -> None:
        out = tmp_path / "p.toml"
        assert "there are no folders in it" in self.refused(tmp_path, out)
        assert "no such folder" in self.refused(tmp_path / "gone", out)
        assert "--size: 'big' is not" in self.refused(tmp_path, out, *BOARD[:4], "--size", "big")
        assert "--square-mm is nan" in self.refused(
            tmp_path, out, *BOARD[:2], "--square-mm", "nan", *BOARD[4:]
        )
        assert "must end in .toml" in self.refused(tmp_path, tmp_path / "p.json")

    def test_too_few_poses_with_the_board(self, poses: Path, tmp_path: Path) -> None:
        out, pose = tmp_path / "p.toml", tmp_path / "poses" / "s00"
        pose.parent.mkdir()
        pose.symlink_to(poses / "s00")
        ran = procam("pair", pose.parent, "--squares", "17x16", *BOARD[2:], "--out", out, "--json")
        assert (ran.code, out.exists()) == (2, False)
        assert "a board of 17x16 squares is found in 0 of 1 (none in s00)" in ran.complaint

    def test_a_wrong_number_of_photographs_names_the_pose(
        self, poses: Path, tmp_path: Path
    ) -> None:
        pose = tmp_path / "poses" / "first"
        pose.mkdir(parents=True)
        shutil.copy(poses / "s00" / "00.png", pose)
        where = tmp_path / "poses", tmp_path / "p.toml"
        assert "first: there are 1 pictures, and the code gray" in self.refused(*where)
        for number in range(1, 42):
            shutil.copy(poses / "s00" / "00.png", pose / f"{number:02d}.png")
        assert "first: pictures: all 42 are alike" in self.refused(*where)

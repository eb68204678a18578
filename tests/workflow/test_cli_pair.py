"""`procam lens pair`: folders of published rendered photographs to both lenses and the pose between them."""

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
from procam.files.venue.load import create_venue
from procam.interfaces.cli._output import Output
from procam.interfaces.cli.lens import pair as command
from procam.model.quality import Goal
from studies import boards as study
from studies import foreign_boards as foreign

LENS = foreign.PrismLens(np.array([905.0, 903, 650, 510, -0.1, 0.02, 0, 0, 0]), np.zeros(4))
SESSIONS = ("s00", "s03", "s05", "s11", "s15", "s17")
USED = ("s00", "s05", "s11")
BITS, EDGE = 10, 800
TURN_DEG = np.degrees([0.24285, 0.12374, 0.01512])  # Blender's own numbers, as is f 800 and c 399.5
SHIFT_M = np.array([-0.12403, 0.23891, -0.13242])
BOARD = ("--squares", "16x16", "--square-mm", "18.5", "--size", "800x800", "--code", "gray")


def solve(photos: Path, *more: object) -> Ran:
    return procam("lens", "pair", "--photos", photos, *more)


def into(venue: Path) -> tuple[object, ...]:
    return "--into", venue, "--camera", "side"


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
    """The pair of all poses and of a wall that the camera sees pixel by pixel; what it says; its venue."""
    folder = tmp_path_factory.mktemp("pair")
    (folder / "poses").mkdir()
    for name in USED:
        (folder / "poses" / name).symlink_to(poses / name)
    wall = folder / "poses" / "wall"
    assert procam("lens", "patterns", wall, "--size", "800x800", "--code", "gray").code == 0
    venue, said, say = create_venue(folder / "venue", "by-hand"), list[str](), Output.say

    def heard(output: Output, text: str) -> None:
        said.append(text)
        say(output, text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Output, "say", heard)
        ran = solve(folder / "poses", *BOARD, *into(venue), "--json")
    return ran, "\n".join(said), venue


class TestSolves:
    def test_a_published_pair(self, solved: tuple[Ran, str, Path]) -> None:
        ran, _, venue = solved
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
        assert np.linalg.det(document["rotation"]) == pytest.approx(1, abs=1e-6)
        text = (venue / "venue.toml").read_text()
        camera = tomllib.loads(text)["cameras"]["side"]
        values = [parameters[f"camera.{name}"]["value"] for name in ("fx", "fy", "cx", "cy")]
        np.testing.assert_allclose([*camera["f"], *camera["c"]], values, atol=1e-4)
        assert (camera["size"], camera["k"]) == ([EDGE, EDGE], [0.0] * 5)
        # Blender's lenses have no distortion
        assert "k = [0.0, 0.0, 0.0, 0.0, 0.0]  # +- 0, not solved for\n" in text

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
        ran = solve(tmp_path / "poses", *BOARD)
        assert (ran.code, "stopped" in ran.err) == (2, True)
        assert set(decoded) <= set(USED)
        text = "a try: 1 photographs, and the code gray needs 42; this is no pose, skipped"
        assert text in ran.out
        assert "notes: 0 photographs, and the code gray needs 42" in ran.out

    def test_poses_are_decoded_side_by_side(
        self, poses: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Two poses wait for each other; one after the other they would never meet."""
        monkeypatch.setattr(command, "WORKERS", 2)
        meeting = threading.Barrier(2, timeout=20)

        def decode(place: Path, *_: object) -> None:
            if place.name in USED[:2]:
                meeting.wait()
            raise InputError(f"{place}: met")

        monkeypatch.setattr(command, "decode_folder", decode)
        assert "s00: met" in solve(poses, *BOARD).complaint

    def test_a_pose_without_a_board_is_left_out(self, solved: tuple[Ran, str, Path]) -> None:
        _, said, _ = solved
        assert "wall: no board is found that the projector lights; left out" in said
        assert "camera.k3" not in said


def test_dropped_corners_are_named_and_a_bad_fit_is_not_given_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    venue = create_venue(tmp_path / "venue", "by-hand")
    before = (venue / "venue.toml").read_text()
    monkeypatch.setattr(command, "_poses", lambda *_: ([], []))
    monkeypatch.setattr(command, "_views", lambda *_: (views, foreign.SIZE, []))
    monkeypatch.setattr(command, "fit_planar_pair", lambda *_: fit)
    board = ("--squares", "14x10", "--square-mm", "13.5", "--size", "1280x800", *into(venue))
    ran = solve(tmp_path, *board)
    assert (ran.code, "venue.toml written: [cameras.side]" in ran.out) == (0, True), ran
    (venue / "venue.toml").write_text(before)
    monkeypatch.setattr(command, "WORST_RMS", Goal("<=", 0.001))
    ran, said = solve(tmp_path, *board), ran.out
    assert (ran.code, "camera is not given on: it fits badly" in ran.out) == (1, True), ran
    assert (venue / "venue.toml").read_text() == before
    assert "pose2: the corner in column 13, row " in said
    assert " px off at (" in said
    assert "of the camera; dropped" in said
    assert "dropped corners are from one edge: the board is curled; glue it to a flat plate" in said


class TestRefuses:
    @pytest.fixture
    def venue(self, tmp_path: Path) -> Path:
        return create_venue(tmp_path / "venue", "by-hand")

    def refused(self, folder: Path, venue: Path, *more: object) -> str:
        before = (venue / "venue.toml").read_text()
        where = () if "--camera" in more else into(venue)
        ran = solve(folder, *BOARD, *more, *where)
        assert ran.code == 2, ran
        assert (venue / "venue.toml").read_text() == before
        return ran.complaint

    def test_folders_and_options(self, tmp_path: Path, venue: Path) -> None:
        (tmp_path / "none").mkdir()
        assert "there are no folders in it" in self.refused(tmp_path / "none", venue)
        assert "no such folder" in self.refused(tmp_path / "gone", venue)
        for options, message in (
            (("--size", "big"), "--size: 'big' is not"),
            (("--square-mm", "nan"), "--square-mm is nan"),
            (("--camera", "side"), "--into and --camera: the venue and one of its cameras go"),
            (("--camera", "b", "--into", venue), "--camera 'b' is not in "),
        ):
            assert message in self.refused(tmp_path, venue, *options)

    def test_too_few_poses_with_the_board(self, poses: Path, tmp_path: Path, venue: Path) -> None:
        pose = tmp_path / "poses" / "s00"
        pose.parent.mkdir()
        pose.symlink_to(poses / "s00")
        complaint = self.refused(pose.parent, venue, "--squares", "17x16", "--json")
        assert "a board of 17x16 squares is found in 0 of 1 (none in s00)" in complaint

    def test_a_wrong_number_of_photographs_names_the_pose(
        self, poses: Path, tmp_path: Path, venue: Path
    ) -> None:
        pose = tmp_path / "poses" / "first"
        pose.mkdir(parents=True)
        shutil.copy(poses / "s00" / "00.png", pose)
        where = pose.parent, venue
        assert "first: there are 1 pictures, and the code gray" in self.refused(*where)
        for number in range(1, 42):
            shutil.copy(poses / "s00" / "00.png", pose / f"{number:02d}.png")
        assert "first: pictures: all 42 are alike" in self.refused(*where)

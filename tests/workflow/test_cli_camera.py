"""`procam lens board`: from photographs of a board to the keys of a camera in venue.toml."""

import json
import re
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from tiny_venue import Ran, procam

from procam.files.images.pixels import write_image
from procam.files.venue.load import create_venue
from procam.interfaces.cli.lens import board as command
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.pose import Pose, rotation_matrix

SIZE = (640, 480)
SQUARES, SQUARE_M = (10, 7), 0.02
MIDDLE = np.array([(SQUARES[0] - 2) / 2, (SQUARES[1] - 2) / 2, 0.0]) * SQUARE_M
LENS = Lens(
    "brown", np.full(2, 560.0), np.array([327.3, 233.8]), np.array([-0.2, 0.06, 4e-4, -3e-4, 0.0])
)
FISHEYE = Lens(
    "kannala-brandt", np.full(2, 250.0), np.array([322.0, 236.4]), np.array([0.02, -0.006, 0, 0])
)
FINER = 2  # rays per pixel and axis
BOARD = ("--squares", "10x7", "--square-mm", "20")


def checkers() -> np.ndarray:
    """20 texels per square, with a white margin of one square."""
    rows, columns = np.indices((SQUARES[1] * 20, SQUARES[0] * 20)) // 20
    return np.pad(np.where((rows + columns) % 2, 220, 30), 20, constant_values=220)


def charuco() -> np.ndarray:
    name = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard(SQUARES, SQUARE_M, 0.7 * SQUARE_M, name)
    texture = board.generateImage((SQUARES[0] * 20, SQUARES[1] * 20), marginSize=0)
    return np.pad(30 + 0.75 * texture, 20, constant_values=220)


def photograph(texture: np.ndarray, pose: Pose, rays: np.ndarray, seed: int) -> np.ndarray:
    """The board, its first inner corner at the origin, before a grey wall; sensor noise and blur."""
    back = pose.inverse()
    towards = back.rotate(rays)
    depth = -back.translation[2] / towards[..., 2]
    place = back.translation[:2] + depth[..., None] * towards[..., :2]
    texel = ((place / SQUARE_M + 2) * 20).astype(np.float32) - 0.5
    texel[(depth <= 0) | ~np.isfinite(depth)] = -1e3
    seen = cv2.remap(
        texture.astype(np.float32), texel, None, cv2.INTER_LINEAR, borderValue=(120.0,) * 4
    )
    small = cv2.GaussianBlur(cv2.resize(seen, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    noise = np.random.default_rng(seed).normal(0, 1.5, small.shape)
    return np.clip(np.rint(small + noise), 0, 255).astype(np.uint8)


def sub_pixel_rays(lens: Lens) -> np.ndarray:
    x, y = (np.arange(n * FINER) / FINER - 0.5 + 0.5 / FINER for n in SIZE)
    return unproject(np.stack(np.meshgrid(x, y), axis=-1), lens)


def poses(number: int, tilt: float = 0.4, distance: float = 0.3) -> list[Pose]:
    rng = np.random.default_rng(7)
    found = []
    for _ in range(number):
        turn = rotation_matrix(rng.normal(0, tilt, 3) * [1, 1, 0.3])
        place = np.array([*rng.uniform(-0.06, 0.06, 2), distance * rng.uniform(0.9, 1.2)])
        found.append(Pose(turn, place - turn @ MIDDLE))
    return found


def write_all(folder: Path, texture: np.ndarray, lens: Lens, places: list[Pose]) -> Path:
    folder.mkdir()
    rays = sub_pixel_rays(lens)
    for i, pose in enumerate(places):
        write_image(folder / f"{i:02d}.png", photograph(texture, pose, rays, i))
    return folder


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve photographs, and one without a board."""
    folder = write_all(tmp_path_factory.mktemp("board") / "photos", checkers(), LENS, poses(12))
    write_image(folder / "wall.png", np.full((SIZE[1], SIZE[0]), 120, np.uint8))
    return folder


def rim_miss(table: dict, truth: Lens) -> float:
    """Largest miss of the lens of a [cameras.NAME] half way out to the corners [px]."""
    found = Lens(table["model"], *(np.array(table[key]) for key in "fck"))
    turn = np.linspace(0, 2 * np.pi, 40)
    pixels = truth.centre + 200 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    back = project(unproject(pixels, found), truth)
    return float(np.linalg.norm(back - pixels - np.mean(back - pixels, axis=0), axis=1).max())


@pytest.fixture
def venue(tmp_path: Path) -> Path:
    return create_venue(tmp_path / "venue", "by-hand")


def solve(photos: Path, *more: object, into: Path | None = None) -> Ran:
    where = ("--into", into, "--camera", "side") if into else ()
    return procam("lens", "board", "--photos", photos, *BOARD, *where, *more)


class TestSolves:
    def test_brown(self, photos: Path, venue: Path) -> None:
        """Keys and their standard errors are replaced, and the owner's comments stay."""
        path = venue / "venue.toml"
        before = path.read_text()
        text = before.replace("\nf = [4200.0, 4200.0]", "\nf = [900.0, 900.0]  # +- 7, 7 px")
        text = text.replace("0.0, 0.0, 0.0, 0.0, 0.0]", "0.0, 0.0, 0.0, 0.0, 0.0] # mine")
        path.write_text(text)
        ran = solve(photos, into=venue)
        assert ran.code == 0, ran.err
        assert "wall.png: no board of 10x7 squares found; left out" in ran.out
        assert "held_out_rms" in ran.out
        pairs = zip(text.splitlines(), path.read_text().splitlines(), strict=True)
        size, f, c, k = (new for old, new in pairs if old != new)
        assert size == "size = [640, 480]"
        assert re.fullmatch(r"f = \[.*\]  # \+- 0[.\d]+, 0[.\d]+ px", f)
        assert re.fullmatch(r"c = \[.*\]  # \+- 0[.\d]+, 0[.\d]+ px; \(0, 0\) is the .*", c)
        assert re.fullmatch(r"k = \[.*\] # \+- .* -- mine", k)
        table = tomllib.loads(path.read_text())["cameras"]["side"]
        assert table["model"] == "brown"
        np.testing.assert_allclose(table["f"], LENS.focal, rtol=0.003)
        assert rim_miss(table, LENS) < 0.3

    def test_json_is_complete(self, photos: Path) -> None:
        document = json.loads(solve(photos, "--json").out)
        assert document["no_board"] == [str(photos / "wall.png")]
        assert len(document["views"]) == 12
        assert document["figures"]["rms"]["value"] < 0.2
        assert document["figures"]["held_out_rms"]["value"] < 0.2
        for name, true in zip(("fx", "fy", "cx", "cy"), (560, 560, 327.3, 233.8), strict=True):
            entry = document["parameters"][name]
            # errors of the corner finder repeat; the sigmas allow for that
            assert abs(entry["value"] - true) < 3 * entry["sigma"], (name, entry)
        assert document["better_model"] is None

    def test_fisheye(self, tmp_path: Path) -> None:
        """Without a venue the lines are printed."""
        places = poses(6, tilt=0.5, distance=0.16)
        photos = write_all(tmp_path / "photos", checkers(), FISHEYE, places)
        ran = solve(photos, "--model", "kannala-brandt")
        assert ran.code == 0, ran.out + ran.err
        *lines, note = ran.out.splitlines()[-6:]
        assert note.startswith("for venue.toml: give --into VENUE and --camera NAME, or copy")
        assert all("# +- " in line for line in lines[2:])
        table = tomllib.loads("\n".join(lines))
        assert (table["model"], table["size"]) == ("kannala-brandt", [640, 480])
        assert rim_miss(table, FISHEYE) < 0.3

    def test_charuco_in_parts(self, tmp_path: Path) -> None:
        """The visible parts of boards beyond the picture's edge are used."""
        photos = write_all(tmp_path / "photos", charuco(), LENS, poses(6, distance=0.2))
        charuco_board = ("--board", "charuco", "--marker-mm", "14", "--dictionary", "DICT_5X5_100")
        ran = solve(photos, *charuco_board, "--json")
        assert ran.code == 0, ran.err
        document = json.loads(ran.out)
        counts = [view["corners"] for view in document["views"].values()]
        assert min(counts) < 54 >= max(counts)
        assert abs(document["parameters"]["fx"]["value"] - 560) < 3

    def test_a_lens_of_another_kind_fails_the_check(self, tmp_path: Path, venue: Path) -> None:
        """A fisheye with the Brown model fits badly: exit 1, and the venue stays as it is."""
        photos = write_all(
            tmp_path / "photos", checkers(), FISHEYE, poses(10, tilt=0.5, distance=0.11)
        )
        before = (venue / "venue.toml").read_text()
        ran = solve(photos, into=venue)
        assert ran.code == 1, ran.out + ran.err
        assert "FAIL" in ran.out
        assert "kannala-brandt fits this lens better than brown: RMS 0." in ran.out
        assert "run again with --model kannala-brandt" in ran.out
        assert "the lens is not given on: it fits badly" in ran.out
        assert (venue / "venue.toml").read_text() == before


class TestRefuses:
    """One clear line, and exit code 2; the venue stays as it is."""

    def refused(self, venue: Path, photos: Path, *arguments: object) -> str:
        before = (venue / "venue.toml").read_text()
        where = () if "--camera" in arguments else ("--into", venue, "--camera", "side")
        ran = procam("lens", "board", "--photos", photos, *BOARD, *arguments, *where)
        assert ran.code == 2, ran.out
        assert ran.err.count("\n") == 1
        assert (venue / "venue.toml").read_text() == before
        return ran.err

    def linked(self, folder: Path, *files: Path) -> Path:
        """A folder with some photographs."""
        folder.mkdir()
        for path in files:
            (folder / path.name).symlink_to(path)
        return folder

    def test_a_wrong_number_of_squares(self, photos: Path, tmp_path: Path, venue: Path) -> None:
        three = self.linked(tmp_path / "three", *photos.glob("0[0-2].png"))
        complaint = self.refused(venue, three, "--squares", "9x6")
        assert "a board of 9x6 squares is found in 0 of 3" in complaint
        assert "00.png shows one of 10x7, so try --squares 10x7" in complaint

    def test_too_few_photographs(self, photos: Path, tmp_path: Path, venue: Path) -> None:
        few = (photos / f"{name}.png" for name in ("00", "01", "wall"))
        complaint = self.refused(venue, self.linked(tmp_path / "few", *few))
        assert "in 2 of 3 (none in wall.png), and at least 3 are needed" in complaint

    @pytest.mark.parametrize(
        ("options", "complaint"),
        [
            ("--squares ten", "--squares: 'ten' is not of the form COLUMNSxROWS"),
            ("--square-mm nan", "--square-mm is nan; it must lie between 0.01"),
            ("--square-mm inf", "--square-mm is inf; it must lie between 0.01"),
            ("--square-mm -20", "--square-mm is -20; it must lie between 0.01"),
            ("--model equidistant", "--model 'equidistant' is unknown; choose brown or"),
            ("--board circles", "--board 'circles' is unknown; choose checkerboard or"),
            ("--board charuco", "markers of 0 mm do not fit into squares of 20 mm"),
        ],
    )
    def test_options(self, photos: Path, venue: Path, options: str, complaint: str) -> None:
        assert complaint in self.refused(venue, photos, *options.split())

    def test_photographs_that_are_not_there(self, tmp_path: Path, venue: Path) -> None:
        assert "no such file" in self.refused(venue, tmp_path / "gone.png")
        (tmp_path / "empty").mkdir()
        assert "there are no photographs here" in self.refused(venue, tmp_path / "empty")

    def test_where_the_lens_cannot_go_is_refused_before_the_fit(
        self, photos: Path, venue: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(command, "_find_boards", pytest.fail)
        together = "--into and --camera: the venue and one of its cameras go together"
        for where, message in (
            (("--camera", "side"), together),
            (("--into", venue, "--camera", ""), together),
            (("--into", venue, "--camera", "b"), "venue.toml; choose one of zenith, side"),
            (("--into", photos, "--camera", "side"), "venue.toml: no such file"),
        ):
            assert message in self.refused(venue, photos, *where)

"""`procam lens response`, `glare` and `vignetting`, and photographs whose response is solved at ingest."""

import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from picture_files import write_with_header
from scipy.ndimage import gaussian_filter
from tiny_venue import CAMERA, Ran, make_venue, procam, refused
from venue_texts import edit, mistakes

from procam.files.images.layers import write_channels
from procam.files.images.photos import load_response
from procam.files.images.pixels import write_image
from procam.files.session import Session
from procam.files.venue.load import template_text
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.workflows.capture.decoded import DECODED_BITS
from simulators.scene import SceneSize

Array = np.ndarray
SECONDS = (1 / 64, 1 / 16, 1 / 4, 1.0)
EXPOSURES = "1/64, 1/16, 0.25, 1"
SIZE, MIDDLE, FOCAL = 160, 79.5, 60.0
BLACK = 200.0
ROWS, COLUMNS = np.indices((SIZE, SIZE))
RADIUS = np.hypot(ROWS - MIDDLE, COLUMNS - MIDDLE)
V1 = -0.15
RESPONSE, GLARE, VIGNETTING = (
    ("lens", name, "--photos") for name in ("response", "glare", "vignetting")
)
ROW = r"vignetting = \[.*\]  # \+- [^#]*; seen to 76 degrees off the axis"


def scene() -> Array:
    rng = np.random.default_rng(3)
    shade = gaussian_filter(rng.normal(size=(120, 180)), 10)
    return 2.6 * np.exp(-6.5 * (1 - (shade - shade.min()) / np.ptp(shade)))


def shoot(light: Array, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    noisy = light + 0.004 * np.sqrt(light) * rng.normal(size=light.shape)
    return np.rint(255 * srgb_encode(np.clip(noisy, 0, 1))).astype(np.uint8)


@pytest.fixture(scope="module")
def shots() -> list[Array]:
    return [shoot(scene() * exposure, k) for k, exposure in enumerate(SECONDS)]


@pytest.fixture
def brackets(shots: list[Array], tmp_path: Path) -> Path:
    """Photographs without headers."""
    folder = tmp_path / "brackets"
    folder.mkdir()
    for k, pixels in enumerate(shots):
        write_image(folder / f"{k}.png", pixels)
    return folder


def put_headers(folder: Path, shots: list[Array]) -> None:
    for k, (pixels, exposure) in enumerate(zip(shots, SECONDS, strict=True)):
        write_with_header(folder / f"{k}.png", pixels, ExposureTime=exposure, FNumber=8.0)


@pytest.fixture
def venue(tmp_path: Path) -> Path:
    """A venue of two cameras; pictures of `zenith` are small."""
    text = template_text("by-hand")
    for old, new in (
        ("size = [4000, 4000]", f"size = [{SIZE}, {SIZE}]"),
        ("f = [1160.0, 1160.0]", f"f = [{FOCAL}, {FOCAL}]"),
        ("c = [1999.5, 1999.5]", f"c = [{MIDDLE}, {MIDDLE}]"),
        # without the owner's comments, which stay, and without a key that has none
        (re.search("vignetting = .*", text)[0], f"vignetting = [{V1}]"),
        ("glare_sigma = 0.01\n", ""),
        ("\n[cameras.side]", "\n# The other one.\n[cameras.side]"),
    ):
        text = edit(old, new, text)
    (tmp_path / "venue.toml").write_text(text, "utf-8")
    return tmp_path


def toml_of(venue: Path, camera: str = "zenith") -> tuple[str, dict]:
    """The text of venue.toml, and the keys of a camera in it."""
    text = (venue / "venue.toml").read_text("utf-8")
    return text, tomllib.loads(text)["cameras"][camera]


def where(venue: Path, camera: str = "zenith") -> tuple[object, ...]:
    return "--into", venue, "--camera", camera


class TestResponse:
    def test_with_given_exposures(self, brackets: Path, venue: Path) -> None:
        before, _ = toml_of(venue, "side")
        ran = procam(*RESPONSE, brackets, "--exposures", EXPOSURES, *where(venue, "side"))
        assert (ran.code, ran.err) == (0, "")
        assert f"{venue / 'venue.toml'} written: [cameras.side]" in ran.out
        after, table = toml_of(venue, "side")
        head, found, rest = before.rpartition('response = "linear"')
        assert found and after == f'{head}response = "side-response.csv"{rest}'
        response = load_response(table["response"], venue)
        assert response is not None
        levels, light = response
        np.testing.assert_allclose(levels, np.arange(256) / 255, rtol=1e-15)
        assert np.sqrt(np.mean((light - srgb_decode(levels)) ** 2)) < 0.005

    def test_with_headers_and_json(self, brackets: Path, shots: list[Array], venue: Path) -> None:
        put_headers(brackets, shots)
        (venue / "zenith-response.csv").write_text("of another day")
        document = json.loads(procam(*RESPONSE, brackets, *where(venue), "--json").out)
        assert document["out"] == str(venue / "zenith-response-2.csv")
        assert document["residual"] < 0.005 and document["largest_sigma"] < 0.01
        np.testing.assert_allclose(document["exposures_s"], SECONDS, rtol=0.01)
        assert toml_of(venue)[1]["response"] == "zenith-response-2.csv"
        levels, light = load_response("zenith-response-2.csv", venue) or ((), ())
        np.testing.assert_array_equal(document["light"], light)
        np.testing.assert_array_equal(document["levels"], levels)
        assert (venue / "zenith-response.csv").read_text() == "of another day"

    def test_refusals(self, brackets: Path, shots: list[Array], venue: Path) -> None:
        before, _ = toml_of(venue)
        command = (*RESPONSE, brackets, *where(venue), "--exposures")
        assert "--exposures: 'fast' is no exposure" in refused(*command, "1,fast,3,4")
        assert "--exposures: '1/0' is no exposure" in refused(*command, "1/0,1,2,3")
        assert "3 exposures were given for 4 photographs; give one for each" in refused(
            *command, "1,2,3"
        )
        assert "0.png has no exposure in its header" in refused(*command[:-1])
        message = refused(*command, "1,1/4,1/16,1/64")
        assert f"{brackets} (0.png, 1.png, 2.png, 3.png): brackets: photographs 4 and 3" in message
        assert "no such folder" in refused(*RESPONSE, venue / "gone", *where(venue))
        assert "--camera 'b' is not in" in refused(*RESPONSE, brackets, *where(venue, "b"))
        assert "no such file" in refused(*RESPONSE, brackets, *where(brackets))
        put_headers(brackets, shots)
        write_with_header(brackets / "1.png", shots[1], ExposureTime=0.06, FNumber=11.0)
        assert "differ in aperture f/ (0.png 8.0, 1.png 11.0" in refused(*command, EXPOSURES)
        write_image(brackets / "1.png", shots[1].astype(np.uint16))
        assert "differ in bits (0.png 8, 1.png 16" in refused(*command, EXPOSURES)
        (brackets / "1.png").write_bytes(b"no picture")
        assert "1.png is not a readable image" in refused(*command, EXPOSURES)
        assert toml_of(venue)[0] == before and not [*venue.glob("*.csv")]


class TestVenue:
    """What venue.toml may say of brackets."""

    @pytest.mark.parametrize(
        ("new", "message"),
        [
            ('response = "solve"', "cameras.zenith.brackets is missing: response"),
            ('response = "linear"\nbrackets = "b"', "cameras.zenith.brackets is for response"),
            (
                'response = "solve"\nbrackets = "b"',
                "cameras.zenith.brackets: {}/b: no such folder; photographs",
            ),
        ],
    )
    def test_mistakes(self, tmp_path: Path, new: str, message: str) -> None:
        (line,) = mistakes(tmp_path, edit('response = "linear"', new))
        assert line.startswith(f"{tmp_path / 'venue.toml'}: {message.format(tmp_path)}")


class TestIngest:
    @pytest.fixture
    def session(self, tmp_path: Path) -> Path:
        size = SceneSize(projectors=1, projector_size=(160, 100), camera_size=(180, 120), rays=64)
        make_venue(tmp_path, size=size)
        ran = procam("session", "plan", tmp_path, tmp_path / "pictures", "--json")
        return Path(json.loads(ran.out)["session"])

    def ingest(self, session: Path, pixels: Array, shot: str) -> Ran:
        photos = session.parents[1] / "photos"
        shutil.rmtree(photos, ignore_errors=True)
        photos.mkdir()
        write_image(photos / "a.png", np.repeat(pixels[..., None], 3, axis=2))
        index = photos / "index.csv"
        index.write_text(f"a.png,{shot}\n")
        command = (
            "session",
            "add",
            session,
            "--camera",
            CAMERA,
            "--photos",
            photos,
            "--index",
            index,
        )
        return procam(*command)

    def test_solves_once_and_keeps_it(
        self, session: Path, brackets: Path, shots: list[Array]
    ) -> None:
        venue, kept = session.parents[1], session / "captures" / CAMERA / "response.csv"
        first, second = (shot.id for shot in Session(session).read_plan().shots[1:3])
        assert (
            "has 8 bits, and its response is not known"
            in self.ingest(session, shots[3], first).complaint
        )
        toml = venue / "venue.toml"
        solve = 'response = "solve"\nbrackets = "brackets"'
        toml.write_text(toml.read_text().replace('response = "linear"', solve))
        ran = self.ingest(session, shots[3], first)
        assert (ran.code, "0.png has no exposure in its header" in ran.complaint) == (2, True)
        assert not kept.exists()
        put_headers(brackets, shots)
        (brackets / "0.nef").write_bytes(b"raw")
        ran = self.ingest(session, shots[3], first)
        assert (ran.code, "1 photographs stored" in ran.out) == (0, True), ran
        assert f"response of camera {CAMERA}: 1 raw files (0.nef ...) lie beside" in ran.out
        assert f"{kept}: response solved from the photographs in brackets" in ran.out
        stored, entry = kept.read_bytes(), Session(session).read_plan().shots[1]
        camera = Session(session).load(CAMERA, entry, entry.exposures_s[0], (180, 120))
        sensor = tomllib.loads(toml.read_text())["cameras"][CAMERA]
        black, full = sensor["black_level"], 2**DECODED_BITS - 1
        light = (camera.counts[..., 0] - black) / (full - black)
        np.testing.assert_allclose(light, srgb_decode(shots[3] / 255), atol=0.01)
        for path in brackets.glob("*.png"):
            path.unlink()
        ran = self.ingest(session, shots[2], second)
        assert (ran.code, f"{kept}: this response, solved before, is used" in ran.out) == (0, True)
        assert kept.read_bytes() == stored


def darkened(light: Array, black: float = BLACK) -> Array:
    """Counts behind an equidistant fisheye that darkens to its rim."""
    counts = black + 45000 * light * (1 + V1 * (RADIUS / FOCAL) ** 2)
    return np.rint(counts + np.random.default_rng(4).normal(0, 5, light.shape)).astype(np.uint16)


def trapped(x: int, y: int, glare: float) -> Array:
    paper = (0.8 + 0.1 * np.sin(COLUMNS / 20)) * (np.hypot(COLUMNS - x, ROWS - y) > 12)
    circle = RADIUS <= SIZE / 2
    return (1 - glare) * paper + glare * paper[circle].mean()


class TestGlare:
    def test_keys_of_the_venue(self, venue: Path) -> None:
        """Nothing else changes: a new key stands below the last one, and its owner's comments stay."""
        (venue / "desk").mkdir()
        for name, (x, y) in (("a", (80, 70)), ("b", (50, 90))):
            write_image(venue / "desk" / f"{name}.tif", darkened(trapped(x, y, 0.012)))
        write_image(venue / "cap.tif", darkened(np.zeros((SIZE, SIZE))))
        before, _ = toml_of(venue)
        traps = ("--trap", "80,70,8", "--trap", "50,90,8", "--dark", venue / "cap.tif")
        ran = procam(*GLARE, venue / "desk", *traps, *where(venue))
        assert (ran.code, ran.err) == (0, "")
        assert "The hole's radius is 5.0% of the picture" in ran.out
        after, table = toml_of(venue)
        assert table["black_level"] == pytest.approx(BLACK, abs=0.5)
        assert table["glare"] == pytest.approx(0.012, abs=1e-4)
        assert table["glare_sigma"] == pytest.approx(5e-4, rel=0.1)
        for old, new in (
            ("black_level = 0.0 ", f"black_level = {table['black_level']} "),
            ("glare = 0.0 ", f"glare = {table['glare']} "),
            ("\n\n# The other", f"\nglare_sigma = {table['glare_sigma']}\n\n# The other"),
        ):
            before = before.replace(old, new, 1)
        assert re.sub(r"# \+- .* -- ", "# ", after) == before
        assert after.count("# +- ") == 2
        ran = procam(*GLARE, venue / "desk", *traps, *where(venue), "--json")
        document = json.loads(ran.out)
        assert len(document["glare"]["each"]) == 2 and document["black_level"]["sigma"] < 2
        assert toml_of(venue)[0] == after

    def test_merged_exposures(self, venue: Path) -> None:
        light = trapped(80, 70, 0.012) * (1 + V1 * (RADIUS / FOCAL) ** 2)
        (venue / "merged").mkdir()
        write_channels(venue / "merged" / "a.exr", dict.fromkeys("RGB", 3e5 * light))
        assert procam(*GLARE, venue / "merged", "--trap", "80,70,8", *where(venue)).code == 0
        assert toml_of(venue)[1]["glare"] == 0.012

    def test_refusals(self, venue: Path) -> None:
        write_image(venue / "a.tif", darkened(trapped(80, 70, 0.012)))
        write_image(venue / "eight.png", np.full((SIZE, SIZE), 90, np.uint8))
        write_image(venue / "small.tif", np.full((40, 50), 900, np.uint16))
        (venue / "empty").mkdir()
        before, _ = toml_of(venue)

        def of(photo: str = "a.tif", trap: str = "80,70,8", camera: str = "zenith", **more) -> str:
            rest = [x for key, value in more.items() for x in (f"--{key}", value)]
            return refused(*GLARE, venue / photo, "--trap", trap, *where(venue, camera), *rest)

        assert "eight.png: 8 bits are too coarse" in of("eight.png")
        assert "small.tif: the photograph has 50x40 px" in of("small.tif")
        assert "gone.tif: no such file" in of("gone.tif")
        assert "empty: there are no photographs here" in of("empty")
        assert "--camera 'b' is not in venue.toml; choose one of zenith, side" in of(camera="b")
        for trap in ("80,70", "80,x,8", "80,70,-8", "nan,70,8"):
            assert f"--trap {trap!r} is not X,Y,RADIUS" in of(trap=trap)
        traps = ("--trap", "80,70,8") * 3
        message = refused(*GLARE, venue / "a.tif", *traps, *where(venue))
        assert "--trap is given 3 times for 1 photographs; give it once for all" in message
        assert "--trap-sigma is 2; it must be a share" in of(**{"trap-sigma": "2"})
        assert "the trap has 11" in of(trap="40,40,8")
        assert "dark: the photograph has up to" in of(dark=venue / "a.tif")
        assert toml_of(venue)[0] == before


class TestVignetting:
    def test_its_key(self, venue: Path) -> None:
        """The standard errors of a second run replace those of the first."""
        paper = 0.8 * (1 + 0.1 * (COLUMNS - MIDDLE) / MIDDLE)
        (venue / "flat").mkdir()
        for turn in range(4):
            write_image(venue / "flat" / f"{turn}.tif", darkened(np.rot90(paper, turn), 0.0))
        rows = []
        for tint in (1.0, 0.5):
            write_image(venue / "flat" / "0.tif", darkened(tint * paper, 0.0))
            before, _ = toml_of(venue)
            ran = procam(*VIGNETTING, venue / "flat", *where(venue))
            assert (ran.code, ran.err) == (0, "")
            after, table = toml_of(venue)
            np.testing.assert_allclose(table["vignetting"], [V1, 0.0], atol=2e-3)
            (row,) = set(after.splitlines()) - set(before.splitlines())
            assert re.fullmatch(ROW, row) and row in ran.out
            assert len(after.splitlines()) == len(before.splitlines())
            rows.append(row)
        assert len(set(rows)) == 2
        document = json.loads(procam(*VIGNETTING, venue / "flat", *where(venue), "--json").out)
        assert document["uneven"] < 0.001 and document["reach_deg"] == pytest.approx(76, abs=1)

    def test_refuses_one_photograph_of_uneven_light(self, venue: Path) -> None:
        paper = 0.8 * (1 + 0.2 * (COLUMNS - MIDDLE) / MIDDLE)
        write_image(venue / "flat.tif", darkened(paper, 0.0))
        message = refused(*VIGNETTING, venue / "flat.tif", *where(venue))
        assert "round the axis, more than 3%" in message

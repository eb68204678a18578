"""Show time: a player with a track's numbers and its shader shows what `procam compensate` writes."""

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lossless_movies import SRGB, write_lossless
from picture_files import write_wide_gamut
from player import Player, open_gl
from tiny_venue import procam, refused

from procam.compensate.compensator import Compensator
from procam.compensate.fields import Fields
from procam.files.calibration import save_calibration
from procam.files.images.pixels import read_image, write_image
from procam.kernels.frame import reference as reference_frame
from procam.kernels.frame.coding import Coding
from procam.maths.codes.dither import threshold_tile
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.maths.light.scatter_kernel import basis
from procam.model.calibration import Calibration
from procam.model.mask import Mask
from procam.model.transport import Measured, ScatterKernel
from procam.model.venue_state import VenueState

SIZE = 160
FRAMES = 120
SCENE = 15  # frames from one cut to the next
MAP = 96


def furnish(calibration: Calibration) -> Calibration:
    """A floor and seats, a matched white, a band that is left as it is, and a venue with lamps on."""
    rng = np.random.default_rng(7)
    bend = np.diag([1.0, 0.03, 0.06, 0.05, 0.02, 0.01, 0.03, 0.02, 0.01])
    bend += np.triu(rng.normal(0, 0.005, bend.shape), 1) * 2
    matrix = np.stack([(bend + bend.T) / 2] * 3) * np.array([1.0, 1.01, 0.99])[:, None, None]
    kernel = ScatterKernel(2, matrix, np.tile([1.0, 0.02, 0.01, *6 * [0.0]], (3, 1)))
    covered = np.zeros((MAP, MAP), bool)
    covered[25:40, 45:55] = True
    falloff = np.broadcast_to(np.linspace(0.8, 1, MAP, dtype=np.float32), (MAP, MAP)).copy()
    maps = replace(
        calibration.maps, kernel=kernel, protected=Mask("screen", covered), falloff=falloff
    )
    lamps = np.full((MAP, MAP, 3), 0.004, np.float32) * np.array([1, 0.8, 0.5], np.float32)
    state = VenueState(
        "full", Measured(np.full(3, 0.4), np.full(3, 0.01)), np.array([1.1, 1.12, 1.15]), lamps
    )
    return replace(calibration, maps=maps, states={"full": state})


@cache
def scene_picture(scene: int, size: int) -> np.ndarray:
    """Waves, bright or dark, with a black and a white disc: (N, N, 3) uint8."""
    rng = np.random.default_rng(scene)
    y, x = np.mgrid[:size, :size] / size
    waves = [np.sin(f * x + g * y + h) for f, g, h in rng.uniform(1, 12, (3, 3))]
    picture = (0.5 + 0.5 * np.stack(waves, axis=-1)) * rng.choice([0.15, 0.5, 1.0])
    picture[(x - 0.5) ** 2 + (y - 0.3) ** 2 < 0.02] = 0
    picture[(x - 0.3) ** 2 + (y - 0.6) ** 2 < 0.01 * rng.uniform()] = 1
    return np.rint(picture * 255).astype(np.uint8)


def clip_frame(index: int) -> np.ndarray:
    """Frame of a clip that pans by 2 px a frame, and cuts."""
    return np.roll(scene_picture(index // SCENE, SIZE), 2 * index, axis=1)


@pytest.fixture(scope="module")
def gl() -> Any:
    return open_gl()


@pytest.fixture(scope="module")
def furnished(calibration: Calibration) -> Calibration:
    return furnish(calibration)


class Track:
    """A track that `procam export` has made."""

    def __init__(
        self, folder: Path, calibration: Calibration, frames: dict[str, np.ndarray]
    ) -> None:
        self.calibration, self.out = folder / "0001", folder / "track"
        self.show = folder / "show"
        if not self.calibration.exists():
            save_calibration(calibration, self.calibration)
        for name, pixels in frames.items():
            write_image(self.show / name, pixels)

    def make(self, *options: str) -> dict[str, Any]:
        ran = procam("export", self.calibration, "shader", self.show, self.out, *options, "--json")
        assert (ran.code, ran.err) == (0, "")
        document = json.loads(ran.out)
        assert isinstance(document, dict)
        return document


@pytest.fixture(scope="module")
def clip(furnished: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Track:
    """Frames in a furnished dome with its lamps on, numbered from 1001."""
    frames = {f"sky.{1001 + i}.tif": clip_frame(i) for i in range(FRAMES)}
    track = Track(tmp_path_factory.mktemp("clip"), furnished, frames)
    track.make("--state", "full")
    return track


@pytest.fixture(scope="module")
def player(gl: Any, clip: Track) -> Player:
    return Player(gl, clip.out)


def codes_apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.abs(first.astype(int) - second)


class TestClip:
    def test_every_frame_is_that_of_compensate_within_a_code_value(
        self, player: Player, clip: Track, tmp_path: Path
    ) -> None:
        ran = procam("compensate", clip.calibration, clip.show, tmp_path, "--state", "full")
        assert (ran.code, ran.err) == (0, "")
        differing, changed = [], []
        for i in range(FRAMES):
            frame = clip_frame(i)
            compensated = read_image(tmp_path / f"sky.{1001 + i}.tif")
            apart = codes_apart(player.play(frame, 1001 + i), compensated)
            assert apart.max() <= 1, i
            differing.append((apart > 0).mean())
            changed.append(codes_apart(compensated, frame).max())
        assert np.mean(differing) < 0.01  # so much of a code value the two may be apart
        assert min(changed) > 15

    def test_at_a_cut_the_row_of_the_frame_before_will_not_do(self, player: Player) -> None:
        cuts = range(SCENE, FRAMES, SCENE)
        wrong = [
            codes_apart(player.play(f, 1001 + i), player.play(f, 1000 + i)).max()
            for i in cuts
            for f in [clip_frame(i)]
        ]
        assert np.median(wrong) > 3

    def test_strength_goes_from_the_content_to_the_full_result_one_way(
        self, player: Player
    ) -> None:
        frame = clip_frame(5)
        shown = [player.play(frame, 1006, s).astype(int) for s in np.linspace(0, 1, 9)]
        np.testing.assert_array_equal(shown[0], frame)
        np.testing.assert_array_equal(shown[-1], player.play(frame, 1006))
        steps = np.diff(shown, axis=0)
        sign = np.sign(shown[-1] - shown[0])
        assert (steps * sign >= 0).all() and not steps[:, sign == 0].any()
        half = (shown[0] + shown[-1]) / 2
        assert np.abs(shown[4] - half).max() <= 1

    def test_strength_is_that_of_compensate(self, player: Player, furnished: Calibration) -> None:
        frame = clip_frame(80)
        partly = Compensator(furnished, SIZE, state="full", strength=0.4).frame(frame)
        assert codes_apart(player.play(frame, 1081, 0.4), partly).max() <= 1

    def test_protected_places_stay_and_unlit_ones_are_black(
        self, player: Player, furnished: Calibration
    ) -> None:
        frame = clip_frame(100)
        shown = player.play(frame, 1101)
        kept = Compensator(furnished, SIZE).fields.protected
        assert kept is not None and kept.any()
        np.testing.assert_array_equal(shown[kept], frame[kept])
        direction, inside = master_directions(SIZE)
        unlit = ~inside | (direction[..., 2] < np.sin(np.radians(6.0)))
        assert not shown[unlit & ~kept].any()


class TestLive:
    def test_a_cut_is_right_after_four_rounds(
        self, gl: Any, clip: Track, player: Player, furnished: Calibration
    ) -> None:
        live = Player(gl, clip.out)
        for i in range(SCENE - 1, FRAMES, SCENE):
            live.play_live(clip_frame(i), 8)
            if i + 1 < FRAMES:
                shown = live.play_live(clip_frame(i + 1), 4)
                assert codes_apart(shown, player.play(clip_frame(i + 1), 1002 + i)).max() <= 1, i

    def test_a_still_settles_on_numbers_that_agree_with_their_light(
        self, gl: Any, clip: Track, furnished: Calibration
    ) -> None:
        live, frame = Player(gl, clip.out), clip_frame(150)
        live.play_live(frame, 12)
        found = live.live_numbers()
        fields = Fields.of(furnished, SIZE, "full")
        coding = Coding(srgb_decode, srgb_encode, threshold_tile(), top=1.0)
        light = reference_frame.scattered_light(fields.shown, found.astype(float), None)
        assert fields.protected is not None
        direction, inside = master_directions(SIZE)
        weight = np.where(inside, master_solid_angles(SIZE), 0)
        terms = reference_frame.monomials(np.moveaxis(direction, -1, 0), 9)
        moments = np.zeros((3, 9))
        for rows, wanted, least, most in reference_frame.frame_parts(
            fields.shown, frame, light, coding
        ):
            covered = reference_frame.interpolated(fields.shown, fields.shown.coverage, rows)
            kept = fields.protected[rows]
            wanted[kept] = coding.decoded(frame[rows])[kept]
            sent = np.clip(wanted, least, most) * (weight[rows] * covered)[..., None]
            moments += np.einsum("rnc,krn->ck", sent, terms[:, rows])
        expected = fields.coefficients_of(moments)
        np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())


def short_track(
    folder: Path, calibration: Calibration, frames: list[np.ndarray], *options: str
) -> Track:
    """A track of a few pictures: 8 and 16 bits as TIFF, floats as EXR."""
    suffix = "exr" if frames[0].dtype.kind == "f" else "tif"
    made = Track(folder, calibration, {f"{i:03d}.{suffix}": f for i, f in enumerate(frames)})
    made.make(*options)
    return made


class TestOtherShows:
    @pytest.mark.parametrize("size", [75, 96, 200])
    def test_any_size_on_a_bare_sphere(
        self, gl: Any, calibration: Calibration, tmp_path: Path, size: int
    ) -> None:
        frames = [scene_picture(scene, size) for scene in (1, 2)]
        track = short_track(tmp_path, calibration, frames)
        header = (track.out / "track.csv").read_text().splitlines()[0]
        assert header == "frame,1.R,1.G,1.B"
        player, compensator = Player(gl, track.out), Compensator(calibration, size)
        for i, frame in enumerate(frames):
            assert codes_apart(player.play(frame, i), compensator.frame(frame)).max() <= 1

    @pytest.mark.parametrize(
        ("option", "value", "setting"),
        [
            ("--transfer", "bt1886", "transfer_name"),
            ("--transfer", "gamma2.2", "transfer_name"),
            ("--transfer", "linear", "transfer_name"),
            ("--method", "subtract", "method"),
            ("--white", "keep", "white"),
        ],
    )
    def test_other_settings(
        self,
        gl: Any,
        furnished: Calibration,
        tmp_path: Path,
        option: str,
        value: str,
        setting: str,
    ) -> None:
        frame = scene_picture(3, MAP)
        track = short_track(tmp_path, furnished, [frame], option, value)
        expected = Compensator(furnished, MAP, **{setting: value}).frame(frame)  # type: ignore[arg-type]
        assert codes_apart(Player(gl, track.out).play(frame, 0), expected).max() <= 1
        usual = Compensator(furnished, MAP).frame(frame)
        assert codes_apart(usual, expected).max() > 3

    def test_what_is_seen_of_linear_light_is_the_content(
        self, gl: Any, furnished: Calibration, tmp_path: Path
    ) -> None:
        """Bounced light is added up pair by pair of pixels, from the calibration alone."""
        content = (scene_picture(3, MAP) / 255.0).astype(np.float32)
        track = short_track(tmp_path, furnished, [content])
        direct = Player(gl, track.out).play(content, 0).astype(float)
        maps, (direction, inside) = furnished.maps, master_directions(MAP)
        assert maps.protected is not None and maps.falloff is not None
        lit = inside & (maps.coverage > 0)
        free = lit & ~maps.protected.covered
        shown = np.clip(direct, maps.lo, maps.hi)
        phi = basis(direction[lit], maps.kernel.degree)
        solid = (master_solid_angles(MAP) * maps.coverage)[lit]
        for c in range(3):
            paint = maps.scatter_per_flux[lit][:, c] / (phi @ maps.kernel.profile[c])
            bounced = np.zeros((MAP, MAP))
            bounced[lit] = paint * (
                phi @ (maps.kernel.matrix[c] @ (phi.T @ (solid * shown[lit][:, c])))
            )
            inner = free & (direct[..., c] > maps.lo[..., c] + 1e-4)
            inner &= direct[..., c] < maps.hi[..., c] - 1e-4
            assert inner.sum() > 0.5 * free.sum()
            target = content[..., c] * maps.falloff
            np.testing.assert_allclose((direct[..., c] + bounced)[inner], target[inner], atol=1e-5)


class TestFolder:
    def test_says_what_it_is_for(self, clip: Track) -> None:
        document = json.loads((clip.out / "track.json").read_text())
        assert document["schema"] == 1
        assert document["size"] == SIZE and document["field_size"] == MAP
        assert (document["method"], document["state"]) == ("exact", "full")
        assert (document["white"], document["transfer"]) == ("summed", "srgb")
        assert document["frames"] == {"count": FRAMES, "first": 1001, "last": 1000 + FRAMES}
        assert len(document["calibration"]["sha256"]) == 64
        assert len(document["numbers"]["columns"]) == 27
        table = (clip.out / "track.csv").read_text().splitlines()
        assert len(table) == FRAMES + 1
        assert table[0].split(",")[1:] == document["numbers"]["columns"]
        for entry in document["textures"].values():
            assert (clip.out / entry["file"]).is_file()
        assert "## Uniforms" in (clip.out / "README.txt").read_text()

    def test_the_hash_is_that_of_all_the_calibration(
        self, calibration: Calibration, tmp_path: Path
    ) -> None:
        track = short_track(tmp_path, calibration, [scene_picture(1, MAP)])
        shutil.copytree(track.calibration, tmp_path / "copy")
        shutil.copytree(track.calibration, tmp_path / "other")
        path = tmp_path / "other" / "calibration.json"
        path.write_text(path.read_text().replace('"session": "0001"', '"session": "0009"'))
        hashes = []
        for name in ("0001", "copy", "other"):
            ran = procam(
                "export", tmp_path / name, "shader", track.show, tmp_path / f"of-{name}", "--json"
            )
            hashes.append(json.loads(ran.out)["calibration"]["sha256"])
        assert hashes[0] == hashes[1] != hashes[2]

    def test_a_movie_gives_the_numbers_of_its_frames(
        self, furnished: Calibration, tmp_path: Path
    ) -> None:
        frames = [scene_picture(scene, MAP) for scene in (1, 2, 3)]
        track = short_track(tmp_path, furnished, frames)
        movie = write_lossless(tmp_path / "show.mkv", frames, transfer=SRGB)
        ran = procam("export", track.calibration, "shader", movie, tmp_path / "of-movie")
        assert (ran.code, ran.err) == (0, "")
        assert "3 frames of 96 px, 27 coefficients each" in ran.out
        message = (tmp_path / "of-movie" / "track.csv").read_text()
        assert message == (track.out / "track.csv").read_text()

    def test_a_profile_that_the_player_does_not_read_is_named(
        self, calibration: Calibration, tmp_path: Path
    ) -> None:
        track = short_track(tmp_path, calibration, [scene_picture(1, MAP)])
        wide = write_wide_gamut(tmp_path / "wide.exr", MAP)
        ran = procam("export", track.calibration, "shader", wide, tmp_path / "of-wide")
        assert ran.code == 0
        assert "has the colour profile Rec.2020; its colours were converted" in ran.err
        assert "The player must convert them too" in ran.err

    def test_one_picture(self, calibration: Calibration, tmp_path: Path) -> None:
        track = short_track(tmp_path, calibration, [scene_picture(1, MAP)])
        ran = procam(
            "export", track.calibration, "shader", track.show / "000.tif", tmp_path / "one"
        )
        assert (ran.code, ran.err) == (0, "")
        assert (tmp_path / "one" / "track.csv").read_text().splitlines()[1].startswith("0,")


@pytest.fixture(scope="module")
def track(calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Track:
    """Of two pictures, for a bare sphere."""
    frames = [scene_picture(1, MAP)] * 2
    return short_track(tmp_path_factory.mktemp("track"), calibration, frames)


class TestRefusals:
    def refused(self, track: Track, out: Path, *options: str) -> str:
        ran = procam("export", track.calibration, "shader", track.show, out, *options)
        assert ran.code == 2
        assert out == track.out or not out.exists()
        assert not list(out.parent.glob(".*tmp*"))
        return ran.complaint

    def test_an_existing_folder(self, track: Track) -> None:
        message = self.refused(track, track.out)
        assert "give the name of a new folder" in message

    @pytest.mark.parametrize("method", ["least-squares", "magic"])
    def test_a_method_that_needs_more(self, track: Track, tmp_path: Path, method: str) -> None:
        message = self.refused(track, tmp_path / "out", "--method", method)
        assert f"--method: no track for '{method}'; choose exact or subtract" in message

    def test_an_unknown_transfer_function(self, track: Track, tmp_path: Path) -> None:
        message = self.refused(track, tmp_path / "out", "--transfer", "vivid")
        assert "'vivid'" in message and "srgb" in message

    def test_frames_that_are_not_alike(
        self, calibration: Calibration, track: Track, tmp_path: Path
    ) -> None:
        frame = scene_picture(1, MAP)
        other = Track(tmp_path, calibration, {"0.tif": frame})
        for odd, found in (
            (scene_picture(1, 75), "75 px of uint8 in srgb"),
            (frame.astype(np.uint16), "96 px of uint16 in srgb"),
        ):
            write_image(other.show / "1.tif", odd)
            message = self.refused(other, tmp_path / "out")
            assert f"1.tif: {found}, but the first frame has 96 px of uint8 in srgb" in message

    def test_a_movie_that_does_not_say_its_transfer_function(
        self, track: Track, tmp_path: Path
    ) -> None:
        movie = write_lossless(tmp_path / "show.mkv", [scene_picture(1, MAP)])
        assert "no transfer function that procam knows" in refused(
            "export", track.calibration, "shader", movie, tmp_path / "out"
        )
        ran = procam(
            "export", track.calibration, "shader", movie, tmp_path / "out", "--transfer", "srgb"
        )
        assert ran.code == 0

"""The check of light that was sent, against closed forms, a dense operator and mistakes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from furnished_domes import furnished

from procam.compensate import light_check
from procam.compensate.compensator import Compensator
from procam.compensate.light_check import LightCheck, LightError
from procam.errors import ShapeError
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.sphere import master_solid_angles
from procam.maths.light.transfer import transfer
from procam.model.calibration import Calibration
from procam.model.mask import Mask
from procam.model.transport import Measured
from procam.model.venue_state import VenueState

SIZE = 96
FLOAT = 1e-5  # of white: maps and pictures in single precision


def sky(size: int, kind: type = np.float32) -> np.ndarray:
    """Noise over a gradient with a black and a white patch."""
    rng = np.random.default_rng(4)
    picture = rng.uniform(0.3, 0.6, (size, size, 3)) * np.linspace(0.5, 1, size)[:, None]
    picture[: size // 3, : size // 2], picture[-size // 3 :, : size // 2] = 0, 1
    peak = 1 if np.dtype(kind).kind == "f" else np.iinfo(kind).max
    return (picture * peak).astype(kind)


def checked(
    calibration: Calibration, content: np.ndarray, sent: np.ndarray, name: str, **settings: str
) -> LightError:
    gain = Compensator(calibration, len(content), **settings).fields.shown.gain  # type: ignore[arg-type]
    check = LightCheck(calibration, len(content), settings.get("state"), gain)
    peak = 1 if content.dtype.kind == "f" else np.iinfo(content.dtype).max
    light = transfer(name).decode(check.sampled(content) / float(peak))
    return check.of(np.asarray(light), check.sampled(sent), transfer(name))


@pytest.fixture(params=[False, True], ids=["one scalar", "degree 2"])
def known(request: pytest.FixtureRequest, calibration: Calibration) -> Calibration:
    return furnished(calibration, 2) if request.param else calibration


class TestSolvedPictures:
    def test_floats_are_exact(self, known: Calibration) -> None:
        content = sky(SIZE)
        found = checked(known, content, Compensator(known, SIZE).frame(content), "linear")
        assert found.white < FLOAT
        assert np.isnan(found.codes) and found.sigma == 0

    @pytest.mark.parametrize("size", [SIZE, 3 * SIZE])
    def test_another_canvas(self, known: Calibration, size: int) -> None:
        wide = known.on(Canvas(3.6, 0.7))
        content = sky(size)
        found = checked(wide, content, Compensator(wide, size).frame(content), "linear")
        assert found.white < 2 * FLOAT  # positions of nodes are in single precision, too

    @pytest.mark.parametrize("kind", [np.uint8, np.uint16])
    def test_codes_are_within_one(self, known: Calibration, kind: type) -> None:
        content = sky(SIZE, kind)
        found = checked(known, content, Compensator(known, SIZE).frame(content), "srgb")
        assert 0.4 < found.codes < 1.1
        assert found.white < 3.0 * found.codes / np.iinfo(kind).max  # sRGB's slope is 2.3 at most

    def test_a_larger_picture_is_sampled(
        self, known: Calibration, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The mistake of a sample is what its standard error states."""
        monkeypatch.setattr(light_check, "CELLS", 64)
        content = sky(3 * SIZE)
        found = checked(known, content, Compensator(known, len(content)).frame(content), "linear")
        assert 0 < found.sigma < 2e-3
        assert found.white < 4 * found.sigma + FLOAT

    def test_room_light_protection_and_keep(self, known: Calibration) -> None:
        ambient = np.full((SIZE, SIZE, 3), 0.01, np.float32)
        ratio = np.array([0.8, 0.9, 0.7])
        state = VenueState("full", Measured(ratio, ratio), ratio, ambient)
        covered = np.zeros((SIZE, SIZE), bool)
        covered[40:60, 40:60] = True
        maps = replace(known.maps, protected=Mask("screen", covered))
        known = replace(known, maps=maps, states={"full": state})
        settings = {"state": "full", "white": "keep"}
        content = 0.5 * sky(SIZE)
        sent = Compensator(known, SIZE, **settings).frame(content)  # type: ignore[arg-type]
        assert checked(known, content, sent, "linear", **settings).white < FLOAT
        assert checked(known, content, sent, "linear", white="keep").white > 1e-3

    def test_where_limits_hold_everywhere_nothing_is_compared(self, known: Calibration) -> None:
        black = np.zeros((SIZE, SIZE, 3), np.float32)
        assert np.isnan(checked(known, black, black, "linear").white)


class TestMistakes:
    """Each is seen: the check is independent of what it checks."""

    def test_scattered_light_agrees_with_a_sum_over_pixels(self, calibration: Calibration) -> None:
        """Grey that is sent as it is asked for is too bright by u times its flux."""
        maps, grey = calibration.maps, np.full((SIZE, SIZE, 3), 0.5, np.float32)
        area = master_solid_angles(SIZE) * maps.coverage
        excess = 0.5 * area.sum() * maps.scatter_per_flux[maps.coverage == 1]
        found = checked(calibration, grey, grey, "linear").white
        assert found == pytest.approx(float(excess.max()), rel=1e-6)

    @pytest.mark.parametrize("method", ["subtract", "none"])
    def test_simpler_methods_are_off(self, known: Calibration, method: str) -> None:
        content = sky(SIZE)
        sent = Compensator(known, SIZE, method).frame(content)
        assert checked(known, content, sent, "linear").white > 1e-3

    @pytest.mark.parametrize("name", ["gamma2.2", "linear"])
    def test_another_encoding(self, known: Calibration, name: str) -> None:
        content = sky(SIZE, np.uint8)
        sent = Compensator(known, SIZE).frame(content)
        check = LightCheck(known, SIZE, None, None)
        light = np.asarray(transfer("srgb").decode(check.sampled(content) / 255.0))
        assert check.of(light, check.sampled(sent), transfer(name)).codes > 2

    def test_another_depth(self, known: Calibration) -> None:
        """8-bit codes put into 16 bits without scaling are nearly black; shifted, 1 of 257 too dark."""
        content = sky(SIZE, np.uint16)
        sent = Compensator(known, SIZE).frame(content)
        for wrong in (sent >> 8, (sent >> 8) << 8):
            assert checked(known, content, wrong, "srgb").codes > 100

    def test_rows_that_are_missing(self, known: Calibration) -> None:
        content = sky(SIZE)
        sent = np.array(Compensator(known, SIZE).frame(content))
        sent[SIZE // 2 :] = 0
        assert checked(known, content, sent, "linear").white > 0.1
        with pytest.raises(ShapeError, match="picture has shape"):
            checked(known, content, sent[: SIZE // 2], "linear")


def test_pixels_of_the_sample_stand_for_all(calibration: Calibration) -> None:
    """Every cell has one pixel of its own, and together they weigh as much as the picture."""
    for size in (50, 512, 700):
        place, counts = light_check._sample(size)
        assert counts.sum() == size**2
        flat = place[0] * size + place[1]
        assert len(np.unique(flat)) == flat.size
        edges = np.arange(len(counts) + 1) * size // len(counts)
        assert (edges[:-1, None] <= place[0]).all() and (place[0] < edges[1:, None]).all()
        assert (edges[:-1] <= place[1]).all() and (place[1] < edges[1:]).all()


@pytest.mark.parametrize("canvas", [STANDARD, Canvas(3.8, -0.7)])
def test_directions_are_those_of_the_canvas(canvas: Canvas) -> None:
    place = np.indices((SIZE, SIZE)).reshape(2, -1)
    direction, area = light_check._directions(place, SIZE, canvas)
    expected, inside = canvas.directions(SIZE)
    np.testing.assert_allclose(
        direction.reshape(SIZE, SIZE, 3)[inside], expected[inside], atol=1e-12
    )
    np.testing.assert_allclose(area.reshape(SIZE, SIZE), canvas.weights(SIZE), atol=1e-15)


def test_the_standard_error_covers(
    make_calibration: Callable[..., Calibration], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of sums over 32 x 32 cells of noise, with other pixels each time, to within a fifth."""
    monkeypatch.setattr(light_check, "CELLS", 32)
    calibration = make_calibration(size=SIZE)
    content = np.random.default_rng(1).random((SIZE, SIZE, 3))
    sums, errors = [], []
    for seed in range(60):
        monkeypatch.setattr(light_check, "SEED", seed)
        check = LightCheck(calibration, SIZE, None, None)
        each = check._weight * check.sampled(content)
        sums.append(each.sum(axis=0))
        errors.append(check._standard_error(each))
    ratio = np.std(sums, axis=0) / np.mean(errors, axis=0)
    assert (0.75 < ratio).all() and (ratio < 1.2).all()

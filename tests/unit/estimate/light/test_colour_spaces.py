"""Colour spaces and differences against published numbers, which colour-science did not make here."""

import numpy as np
import pytest
from hand_meter import P3

from procam.errors import InputError, OutOfModelRange
from procam.estimate.light.colour_spaces import (
    colour_difference,
    colour_temperature,
    content_from_rgb,
    unshown_saturation,
    xyy_from_xyz,
)

# W3C, CSS Color Module Level 4, from x 0.3127, y 0.3290
SRGB = np.array(
    [
        [0.4123908, 0.3575843, 0.1804808],
        [0.2126390, 0.7151687, 0.0721923],
        [0.0193308, 0.1191948, 0.9505322],
    ]
)
# Lindbloom, sRGB adapted to D50 by Bradford, from a D65 that differs by ROUNDED_WHITE
ROUNDED_WHITE = 2.4e-4
SRGB_D50 = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
D50 = np.array([0.96422, 1.0, 0.82521])
# P3-D65 to Rec.709, as many publish it; columns are P3's primaries
REC709_FROM_P3 = np.array(
    [
        [1.2249402, -0.2249402, 0.0],
        [-0.0420570, 1.0420570, 0.0],
        [-0.0196376, -0.0786360, 1.0982736],
    ]
)
DIGITS = 1e-6  # seven digits, inverted
# CIE 1931 x, y of illuminants, and their CCT [K]
ILLUMINANTS = {
    "A": ((0.44757, 0.40745), 2856),
    "D50": ((0.34567, 0.35850), 5003),
    "D65": ((0.31271, 0.32902), 6504),
    "E": ((1 / 3, 1 / 3), 5455),
}
# Sharma, Wu and Dalal 2005, doi:10.1002/col.20070, table 1: rows 1, 4, 7, 13, 17, 18, 25 and 33
SHARMA = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, -0.0010, 2.4900), (50.0, 0.0009, -2.4900), 4.8045),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (61.0, -5.0, 29.0), 22.8977),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((6.7747, -0.2908, -2.4247), (5.8714, -0.0985, -2.2286), 0.6377),
]


def xyz(x: float, y: float, luminance: float = 1.0) -> np.ndarray:
    return luminance / y * np.array([x, y, 1 - x - y])


def from_lab(lab: tuple[float, float, float], white: np.ndarray) -> np.ndarray:
    """CIE 15:2004, eq. 8.3 backwards."""
    level = (lab[0] + 16) / 116
    f = np.array([level + lab[1] / 500, level, level - lab[2] / 200])
    return white * np.where(f > 24 / 116, f**3, (f - 16 / 116) * 108 / 841)


class TestColours:
    def test_chromaticity(self) -> None:
        """White of sRGB: x 0.3127, y 0.3290 (IEC 61966-2-1)."""
        found = xyy_from_xyz(80 * SRGB.sum(axis=1))
        assert found == pytest.approx([0.3127, 0.3290, 80.0], abs=5e-5)

    @pytest.mark.parametrize("pair", SHARMA, ids=[f"{p[2]}" for p in SHARMA])
    @pytest.mark.parametrize("luminance", [1.0, 48.0])
    def test_differences_of_sharma(self, pair: tuple, luminance: float) -> None:
        white = luminance * xyz(0.31271, 0.32902)
        first, second = (from_lab(lab, white) for lab in pair[:2])
        assert colour_difference(first, second, white) == pytest.approx(pair[2], abs=6e-5)
        assert colour_difference(second, first, white) == pytest.approx(pair[2], abs=6e-5)

    @pytest.mark.parametrize("name", ILLUMINANTS)
    def test_temperature(self, name: str) -> None:
        (x, y), kelvin = ILLUMINANTS[name]
        found, duv = colour_temperature(7 * xyz(x, y))
        assert found == pytest.approx(kelvin, abs=3)
        assert abs(duv) < 0.005

    def test_green_has_no_temperature(self) -> None:
        kelvin, duv = colour_temperature(xyz(0.3, 0.6))
        assert np.isnan(kelvin)
        assert duv > 0.05


class TestSpaces:
    @pytest.mark.parametrize("white", ["native", "D65"])
    @pytest.mark.parametrize("space", ["sRGB", "Rec.709"])
    def test_a_dome_of_these_primaries(self, space: str, white: str) -> None:
        found = content_from_rgb(space, 12 * SRGB, white)
        assert found == pytest.approx(np.eye(3), abs=DIGITS)

    @pytest.mark.parametrize("white", ["native", "D65"])
    def test_p3_on_a_dome_of_rec709(self, white: str) -> None:
        found = content_from_rgb("P3-D65", 12 * SRGB, white)
        assert found == pytest.approx(REC709_FROM_P3, abs=DIGITS)

    def test_native_white_adapts(self) -> None:
        """A dome whose white is D50 shows sRGB as Bradford adapts it."""
        dome = 9 * P3 @ np.diag(np.linalg.solve(P3, D50))
        found = content_from_rgb("sRGB", dome)
        assert found.sum(axis=1) == pytest.approx(np.ones(3))
        assert dome @ found / 9 == pytest.approx(SRGB_D50, abs=ROUNDED_WHITE)

    def test_d65_on_a_dome_of_another_white(self) -> None:
        """No colour changes, and its white is as bright as one channel allows."""
        dome = 9 * P3 @ np.diag(np.linalg.solve(P3, D50))
        found = content_from_rgb("sRGB", dome, "D65")
        assert found.sum(axis=1).max() == pytest.approx(1)
        shown = dome @ found
        assert shown / shown[1].sum() == pytest.approx(SRGB, abs=DIGITS)

    def test_unknown_names(self) -> None:
        for space, white in (("AdobeRGB", "native"), ("sRGB", "D50")):
            with pytest.raises(InputError) as caught:
                content_from_rgb(space, P3, white)  # type: ignore[arg-type]
            assert str(caught.value) == (
                f"colour space {space!r} with white {white!r} is unknown; choose one of sRGB, Rec.709, "
                "P3-D65, Rec.2020 with white native or D65"
            )

    def test_a_dome_that_cannot_mix_d65(self) -> None:
        reddish = P3 @ np.array([[1.0, 0.8, 0.8], [0.0, 0.2, 0.0], [0.0, 0.0, 0.2]])
        with pytest.raises(OutOfModelRange) as caught:
            content_from_rgb("sRGB", reddish, "D65")
        assert str(caught.value) == (
            "sRGB: the dome's primaries cannot mix D65; use its native white"
        )


class TestGamut:
    def test_outside(self) -> None:
        """P3 red on Rec.709: from grey 0.2290 down to green -0.0421; P3 green: from 0.6917 to red -0.2249."""
        matrix = content_from_rgb("P3-D65", SRGB)
        found = unshown_saturation(matrix, SRGB)
        red, green = 0.0420570 / (0.2289746 + 0.0420570), 0.2249402 / (0.6917385 + 0.2249402)
        assert found[:2] == pytest.approx([red, green], abs=DIGITS)
        assert found[2] == pytest.approx(0, abs=DIGITS)

    def test_what_is_left_lies_on_the_edge(self) -> None:
        matrix = content_from_rgb("Rec.2020", SRGB)
        for primary, unshown in enumerate(unshown_saturation(matrix, SRGB)):
            luminance = SRGB[1] @ matrix[:, primary]
            grey = luminance * np.ones(3) / SRGB[1].sum()
            edge = grey + (1 - unshown) * (matrix[:, primary] - grey)
            assert edge.min() == pytest.approx(0, abs=1e-9)
            assert SRGB[1] @ edge == pytest.approx(luminance)


def test_numpy_prints_as_before() -> None:
    """colour-science changes that when it is imported."""
    colour_temperature(np.array([0.95, 1.0, 1.09]))
    assert str(np.array([0.5])) == "[0.5]"

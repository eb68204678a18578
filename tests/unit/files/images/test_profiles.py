"""Colour profiles of pictures, made here by hand, against colour-science's conversions."""

import re
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from picture_files import spec_of, write_spec_as_is, write_with_header

from procam.errors import FileFormatError, InputError
from procam.files.images.profiles import NAMED
from procam.files.images.stills import read_picture, read_still, write_still
from procam.maths.colour_science import colour_science
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.workflows.playout.frame import FrameSettings, named_transfer
from procam.workflows.playout.sources import read_clip_frame

SPACES = {"Rec.2020": "ITU-R BT.2020", "Adobe RGB": "Adobe RGB (1998)", "Display P3": "Display P3"}
SPACES |= {"ACES AP0": "ACES2065-1", "ACES AP1": "ACEScg", "DCI-P3": "DCI-P3"}
MATRIX = 2e-3  # of white: rounded primaries and white points
CODE = 1.01  # the result is rounded to codes
SRGB_PARA = (3, (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))


def reference(light: np.ndarray, space: str) -> np.ndarray:
    """Linear light of a space as linear Rec.709, by colour-science."""
    colour = colour_science()
    adapted = {"chromatic_adaptation_transform": "Bradford"}
    return np.asarray(colour.RGB_to_RGB(light, SPACES[space], "sRGB", **adapted))


def fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(v * 65536) for v in values))


def para(kind: int, values: tuple[float, ...]) -> bytes:
    return b"para" + bytes(4) + struct.pack(">HH", kind, 0) + fixed(*values)


def curv(*values: int) -> bytes:
    return b"curv" + bytes(4) + struct.pack(f">I{len(values)}H", len(values), *values)


def icc(space: str, curve: bytes, name: str = "A space", kind: bytes = b"RGB ") -> bytes:
    """A matrix profile of ICC.1, whose colorants are under D50."""
    colour = colour_science()
    known = colour.RGB_COLOURSPACES[SPACES.get(space, space)]
    d50 = np.array([0.9642, 1, 0.8249])
    white = colour.xy_to_XYZ(known.whitepoint)
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(white, d50, "Bradford")
    columns = (adapt @ known.matrix_RGB_to_XYZ).T
    text = name.encode("utf-16-be")
    tags = {
        b"desc": b"mluc" + bytes(4) + struct.pack(">II4sII", 1, 12, b"enUS", len(text), 28) + text
    }
    for letter, column in zip((b"r", b"g", b"b"), columns, strict=True):
        tags[letter + b"XYZ"] = b"XYZ " + bytes(4) + fixed(*column)
        tags[letter + b"TRC"] = curve
    table, body, start = b"", b"", 132 + 12 * len(tags)
    for tag, data in tags.items():
        table += struct.pack(">4sII", tag, start + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(
        ">I12s4s4s12s4s88s", start + len(body), b"", kind, b"XYZ ", b"", b"acsp", b""
    )
    return head + struct.pack(">I", len(tags)) + table + body


def png(path: Path, codes: np.ndarray, *chunks: tuple[bytes, bytes]) -> Path:
    """A PNG (H, W, 3) of 8 bits with the given chunks, written by hand."""
    height, width, _ = codes.shape
    rows = b"".join(b"\0" + row.tobytes() for row in codes)
    whole = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        *chunks,
        (b"IDAT", zlib.compress(rows)),
        (b"IEND", b""),
    ]
    parts = [
        struct.pack(">I", len(b)) + t + b + struct.pack(">I", zlib.crc32(t + b)) for t, b in whole
    ]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


def iccp(data: bytes) -> tuple[bytes, bytes]:
    return b"iCCP", b"name\0\0" + zlib.compress(data)


def chrm(space: str) -> tuple[bytes, bytes]:
    points = np.array(NAMED[space])
    white_first = np.rint(1e5 * np.concatenate([points[6:], points[:6]])).astype(int)
    return b"cHRM", struct.pack(">8I", *white_first)


def tiff(path: Path, codes: np.ndarray, profile: bytes) -> Path:
    spec = spec_of(codes)
    data = np.frombuffer(profile, np.uint8)
    spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(data)}]"), data)
    return write_spec_as_is(path, codes, spec)


@pytest.fixture
def codes() -> np.ndarray:
    """Greys with a tint, and a green that is outside of sRGB in every wider space."""
    rng = np.random.default_rng(3)
    found = rng.uniform(40, 210, (8, 8, 1)) + rng.uniform(0, 40, (8, 8, 3))
    found[0, 0] = 0, 250, 0
    return found.astype(np.uint8)


def expected(codes: np.ndarray, space: str, decode: object = srgb_decode) -> np.ndarray:
    light = decode(codes / np.iinfo(codes.dtype).max)  # type: ignore[operator]
    return np.asarray(
        srgb_encode(np.clip(reference(light, space), 0, 1)) * np.iinfo(codes.dtype).max
    )


class TestContent:
    def test_a_profile_counts_where_a_picture_is_read_as_light(
        self, codes: np.ndarray, tmp_path: Path
    ) -> None:
        light, note = read_picture(
            png(tmp_path / "a.png", codes, iccp(icc("Display P3", para(*SRGB_PARA))))
        )
        inside = reference(srgb_decode(codes / 255), "Display P3").clip(0, 1)
        np.testing.assert_allclose(light, inside, atol=0.01)
        assert "a.png has the colour profile A space; its colours were converted" in note

    def test_an_unknown_transfer_function_is_refused(
        self, codes: np.ndarray, tmp_path: Path
    ) -> None:
        path = png(tmp_path / "a.png", codes, (b"gAMA", struct.pack(">I", 55556)))
        with pytest.raises(FileFormatError, match=r"function g18.*, which procam does not know"):
            read_picture(path)


class TestHonoured:
    @pytest.mark.parametrize("space", ["Display P3", "Adobe RGB", "Rec.2020"])
    @pytest.mark.parametrize("kind", [np.uint8, np.uint16])
    def test_icc_of_tiff(self, space: str, kind: type, codes: np.ndarray, tmp_path: Path) -> None:
        wide = codes.astype(kind) * (257 if kind is np.uint16 else 1)
        still = read_still(tiff(tmp_path / "a.tif", wide, icc(space, para(*SRGB_PARA), space)))
        assert (still.converted, still.transfer, still.rgb.dtype) == (True, "srgb", kind)
        assert f"has the colour profile {space}; its colours were converted" in still.note
        apart = np.abs(still.rgb - expected(wide, space)).max() / (257 if kind is np.uint16 else 1)
        assert apart < CODE
        assert np.abs(still.rgb.astype(int) - wide).max() > (3 if kind is np.uint8 else 800)

    @pytest.mark.parametrize(
        ("curve", "decode"),
        [
            (curv(), lambda x: x),
            (curv(round(2.2 * 256)), lambda x: x ** (round(2.2 * 256) / 256)),
            (curv(0, 16384, 65535), lambda x: np.interp(x, [0, 0.5, 1], [0, 16384 / 65535, 1])),
            (para(0, (1.8,)), lambda x: x**1.8),
            (para(1, (2.0, 0.9, 0.1)), lambda x: (0.9 * x + 0.1) ** 2),
            (para(2, (2.0, 0.8, 0.1, 0.02)), lambda x: (0.8 * x + 0.1) ** 2 + 0.02),
            (para(*SRGB_PARA), srgb_decode),
            (
                para(4, (2.0, 0.9, 0.1, 0.5, 0.3, 0.01, 0.02)),
                lambda x: np.where(x >= 0.3, (0.9 * x + 0.1) ** 2 + 0.01, 0.5 * x + 0.02),
            ),
        ],
    )
    def test_curves(self, curve: bytes, decode: object, codes: np.ndarray, tmp_path: Path) -> None:
        still = read_still(png(tmp_path / "a.png", codes, iccp(icc("Adobe RGB", curve))))
        assert still.converted
        assert np.abs(still.rgb - expected(codes, "Adobe RGB", decode)).max() < CODE

    @pytest.mark.parametrize("space", ["Display P3", "Rec.2020"])
    def test_chunks_of_png(self, space: str, codes: np.ndarray, tmp_path: Path) -> None:
        code = {"Display P3": 12, "Rec.2020": 9}[space]
        for chunk in (chrm(space), (b"cICP", bytes([code, 13, 0, 1]))):
            still = read_still(png(tmp_path / "a.png", codes, chunk))
            assert f"profile {space};" in still.note
            assert np.abs(still.rgb - expected(codes, space)).max() < CODE

    def test_a_gamma_beside_primaries_is_kept(self, codes: np.ndarray, tmp_path: Path) -> None:
        chunks = (b"gAMA", struct.pack(">I", 45455)), chrm("Adobe RGB")
        still = read_still(png(tmp_path / "a.png", codes, *chunks))
        assert still.transfer == "gamma2.2"
        light = reference((codes / 255) ** 2.2, "Adobe RGB")
        assert np.abs(still.rgb - 255 * np.clip(light, 0, 1) ** (1 / 2.2)).max() < CODE

    @pytest.mark.parametrize("space", ["Rec.2020", "Display P3", "ACES AP0", "ACES AP1", "DCI-P3"])
    def test_chromaticities_of_exr(self, space: str, tmp_path: Path) -> None:
        light = np.random.default_rng(1).uniform(0, 2, (6, 6, 3)).astype(np.float32)
        still = read_still(
            write_with_header(tmp_path / "a.exr", light, chromaticities=tuple(NAMED[space]))
        )
        assert (still.converted, still.transfer) == (True, "linear")
        assert f"profile {space};" in still.note
        np.testing.assert_allclose(still.rgb, reference(light, space), atol=2 * MATRIX)
        white = read_still(
            write_with_header(
                tmp_path / "w.exr", np.ones_like(light), chromaticities=tuple(NAMED[space])
            )
        ).rgb
        np.testing.assert_allclose(white, 1, atol=1e-5)

    def test_what_is_written_of_it_has_no_profile(self, codes: np.ndarray, tmp_path: Path) -> None:
        """Or it would be converted twice."""
        wide = tiff(tmp_path / "a.tif", codes, icc("Rec.2020", para(*SRGB_PARA)))
        light = np.full((4, 4, 3), 0.5, np.float32)
        for source in (
            wide,
            write_with_header(tmp_path / "a.exr", light, chromaticities=tuple(NAMED["ACES AP1"])),
        ):
            still = read_still(source)
            out = source.with_stem("b")
            write_still(out, still.rgb, still, str(still.transfer))
            again = read_still(out)
            assert (again.note, again.converted) == ("", False)
            np.testing.assert_array_equal(again.rgb, still.rgb)


class TestNoted:
    def test_what_cannot_be_converted_is_named_and_kept(
        self, codes: np.ndarray, tmp_path: Path
    ) -> None:
        table = icc("Rec.2020", curv(), "Press").replace(b"gXYZ\0", b"gABC\0")
        cmyk, cut = icc("Rec.2020", curv(), "Press", b"CMYK"), icc("Rec.2020", curv())[:200]
        for profile in (table, cmyk, cut):
            still = read_still(tiff(tmp_path / "a.tif", codes, profile))
            named = "that is damaged" if profile is cut else "Press"
            assert f"has the colour profile {named}, which procam cannot convert" in still.note
            assert not still.converted
            np.testing.assert_array_equal(still.rgb, codes)
        still = read_still(png(tmp_path / "a.png", codes, (b"cICP", bytes([22, 13, 0, 1]))))
        assert "profile of primaries 22, which procam cannot convert" in still.note

    @pytest.mark.parametrize(
        "data",
        [
            bytes(32),  # all zero
            chrm("Rec.2020")[1] + bytes(4),
            struct.pack(">8I", 31270, 0, 64000, 33000, 30000, 60000, 15000, 6000),  # white y 0
            struct.pack(">8I", 31270, 32900, 64000, 33000, 40000, 33000, 15000, 33000),  # on a line
            struct.pack(
                ">8I", 70000, 25000, 64000, 33000, 30000, 60000, 15000, 6000
            ),  # white outside
        ],
    )
    def test_primaries_that_make_no_colours_change_nothing(
        self, data: bytes, codes: np.ndarray, tmp_path: Path
    ) -> None:
        """They sent black, and said that it was converted."""
        still = read_still(png(tmp_path / "a.png", codes, (b"cHRM", data)))
        assert "the colour profile that is damaged, which procam cannot convert" in still.note
        assert not still.converted
        np.testing.assert_array_equal(still.rgb, codes)

    @pytest.mark.parametrize("count", [0, 1, 7, 9, 16])
    def test_chromaticities_of_another_length(self, count: int, tmp_path: Path) -> None:
        light = np.full((4, 4, 3), 0.5, np.float32)
        values = {0: "wide", 1: 0.3}.get(count, (0.3,) * count)
        still = read_still(write_with_header(tmp_path / "a.exr", light, chromaticities=values))
        assert not still.converted and "cannot convert" in still.note
        np.testing.assert_array_equal(still.rgb, light)

    @pytest.mark.parametrize(
        "curve",
        [
            curv(0),  # an exponent of 0: all white
            curv(65535, 0),  # falls
            para(0, (-2.0,)),
            para(0, (float(2**14),)),
            para(3, (2.4, 1.0, 0.0, 9.0, 1.0)),
            b"curv" + bytes(4) + b"\xff" * 4,
            b"",
        ],
    )
    def test_a_curve_that_leads_not_from_dark_to_light(
        self, curve: bytes, codes: np.ndarray, tmp_path: Path
    ) -> None:
        still = read_still(tiff(tmp_path / "a.tif", codes, icc("Rec.2020", curve)))
        assert not still.converted and "cannot convert" in still.note
        np.testing.assert_array_equal(still.rgb, codes)

    def test_columns_of_zeros(self, codes: np.ndarray, tmp_path: Path) -> None:
        whole = icc("Rec.2020", para(*SRGB_PARA))
        start = whole.rindex(b"XYZ \0\0\0\0") + 8
        for data in (bytes(12), fixed(30000, 30000, 30000)):
            broken = whole[:start] + data + whole[start + 12 :]
            still = read_still(tiff(tmp_path / "a.tif", codes, broken))
            assert not still.converted and "cannot convert" in still.note
        for match in list(re.finditer(rb"XYZ \0\0\0\0", whole))[-3:]:
            grey = fixed(*(np.array([0.9642, 1, 0.8249]) / 3))  # white is right, colours are gone
            whole = whole[: match.end()] + grey + whole[match.end() + 12 :]
        still = read_still(tiff(tmp_path / "a.tif", codes, whole))
        assert not still.converted and "cannot convert" in still.note

    def test_a_long_name_is_cut(self, codes: np.ndarray, tmp_path: Path) -> None:
        still = read_still(
            tiff(tmp_path / "a.tif", codes, icc("Rec.2020", para(*SRGB_PARA), "x" * 9000))
        )
        assert still.converted and len(still.note) < 400

    @pytest.mark.parametrize("name", ["a.png", "a.tif"])
    def test_srgb_needs_no_word(self, name: str, codes: np.ndarray, tmp_path: Path) -> None:
        profile = icc("sRGB", para(*SRGB_PARA), "sRGB IEC61966-2.1")
        chunks = iccp(profile), (b"sRGB", b"\0"), chrm("Rec.709")
        for chunk in chunks:
            path = png(tmp_path / "a.png", codes, chunk)
            if name == "a.tif":
                path = tiff(tmp_path / name, codes, profile)
            still = read_still(path)
            assert (still.note, still.converted) == ("", False)
            np.testing.assert_array_equal(still.rgb, codes)

    def test_srgbs_chunk_overrides_primaries(self, codes: np.ndarray, tmp_path: Path) -> None:
        for order in ((chrm("Rec.2020"), (b"sRGB", b"\0")), ((b"sRGB", b"\0"), chrm("Rec.2020"))):
            assert read_still(png(tmp_path / "a.png", codes, *order)).note == ""

    def test_transfer_contradicts_it(self, codes: np.ndarray, tmp_path: Path) -> None:
        frame = read_clip_frame(png(tmp_path / "a.png", codes, chrm("Rec.2020")))
        assert named_transfer(frame, FrameSettings(transfer="srgb")) == "srgb"
        with pytest.raises(InputError, match="its colour profile was converted to srgb"):
            named_transfer(frame, FrameSettings(transfer="gamma2.2"))

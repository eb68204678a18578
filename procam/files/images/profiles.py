"""Colour profiles that pictures carry: ICC matrix profiles, PNG's cICP and cHRM, EXR's chromaticities.

procam takes content as sRGB (integers) or as linear light of Rec.709's primaries (floats). `converted`
gives that of pictures whose profile states something else, and a sentence that names the profile.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import OpenImageIO as oiio

from procam.arrays import AnyArray, Array, FloatArray
from procam.maths.light.curves import srgb_decode
from procam.maths.light.transfer import Transfer, transfer

Curve = Callable[[FloatArray], FloatArray]
SAME = 5e-3  # of white: profiles of sRGB differ by so much in rounding
D65 = (0.3127, 0.329)
# x, y of red, green, blue, white (Rec. ITU-R BT.709-6)
REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, *D65)
NAMED = {
    "Rec.709": REC709,
    "Rec.2020": (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, *D65),  # Rec. ITU-R BT.2020-2
    "Display P3": (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, *D65),  # SMPTE EG 432-1
    "DCI-P3": (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.314, 0.351),  # SMPTE RP 431-2
    "Adobe RGB": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *D65),  # Adobe RGB (1998)
    "ACES AP0": (0.7347, 0.2653, 0, 1, 0.0001, -0.077, 0.32168, 0.33767),  # SMPTE ST 2065-1
    "ACES AP1": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767),  # AMPAS S-2014-004
}
OF_CODE = {1: "Rec.709", 9: "Rec.2020", 11: "DCI-P3", 12: "Display P3"}  # of Rec. ITU-T H.273
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)  # cone responses of XYZ, as ICC.1:2022 annex E adapts white
D50 = np.array([0.9642, 1.0, 0.8249])  # XYZ of white in ICC profiles
PARAMETERS = (1, 3, 4, 5, 7)  # that types of ICC's formulas have
STATEMENTS = ("ICCProfile", "CICP", "chromaticities")
DAMAGED = "that is damaged"
WHITE_OFF = 0.1  # of white's X, Y and Z in a profile; that of ICC is D50
MOST_CONDITION = 50.0  # of a matrix to Rec.709; ACES AP0's is 3.1, primaries on a line have more
MEAN = 0.1, 0.9  # light of a ramp; exponents of 9 and 1/9
LEAST_RISE = 0.5  # from code 0 to full, of light that content uses
OVERSHOOT = 0.1  # of curves that leave 0..1
MOST_DIP = 0.05  # from one code to the next; where a formula's two parts meet they are rounded
MOST_NAME = 80  # letters
CHRM_BYTES = 32


@dataclass(frozen=True, slots=True)
class Profile:
    """What a picture's colours mean.

    Attributes
    ----------
    name : for people. matrix : (3, 3) to linear Rec.709; None if it cannot be converted.
    curves : from values 0..1 of red, green and blue to linear light; () for the header's function.
    """

    name: str
    matrix: Array | None
    curves: tuple[Curve, ...] = ()

    def is_assumed(self) -> bool:
        """Whether it is what procam takes content for anyway."""
        if self.matrix is None:
            return False
        ramp = np.linspace(0, 1, 64)
        apart = [np.abs(curve(ramp) - srgb_decode(ramp)).max() for curve in self.curves]
        return bool(max([np.abs(self.matrix - np.eye(3)).max(), *apart]) < SAME)


def converted(
    path: Path, rgb: AnyArray, spec: oiio.ImageSpec, named: str | None
) -> tuple[AnyArray, str, bool]:
    """Colours (H, W, 3) as procam takes them, a sentence about their profile, and whether it was honoured.

    `named` is the header's transfer function, which a profile without curves keeps. The header `spec`
    loses a profile that was honoured.
    """
    profile = stated_profile(path, spec)
    if profile is None or profile.is_assumed():
        return rgb, "", False
    if profile.matrix is None or (not profile.curves and named is None):
        return rgb, _unread(path, profile), False
    for name in STATEMENTS:
        spec.erase_attribute(name)
    whole = rgb.dtype.kind != "f"
    if profile.curves:
        spec.attribute("oiio:ColorSpace", "srgb_rec709_scene" if whole else "lin_rec709_scene")
    known = transfer(("srgb" if whole else "linear") if profile.curves or named is None else named)
    return _rec709(rgb, profile, known), _honoured(path, profile), True


def _honoured(path: Path, profile: Profile) -> str:
    return (
        f"{path} has the colour profile {profile.name}; its colours were converted to the primaries of "
        "sRGB, and those outside are clipped. Remove the profile to send the values as they are"
    )


def _unread(path: Path, profile: Profile) -> str:
    return (
        f"{path} has the colour profile {profile.name}, which procam cannot convert; its colours were "
        "taken as sRGB. Convert it to sRGB in the program that made it"
    )


def stated_profile(path: Path, spec: oiio.ImageSpec) -> Profile | None:
    """The profile that a picture's header states; None for none."""
    try:
        with np.errstate(all="ignore"):  # infinite and NaN are refused below
            return _stated(path, spec)
    except (
        ArithmeticError,
        LookupError,
        TypeError,
        ValueError,
        struct.error,
        np.linalg.LinAlgError,
    ):
        return Profile(DAMAGED, None)


def _stated(path: Path, spec: oiio.ImageSpec) -> Profile | None:
    icc = spec.getattribute("ICCProfile")
    if icc is not None:
        return _icc(np.asarray(icc, np.uint8).tobytes())
    code, points = spec.getattribute("CICP"), spec.getattribute("chromaticities")
    if code is not None:
        name = OF_CODE.get(int(code[0]))
        return Profile(name or f"of primaries {code[0]}", _to_rec709(NAMED[name]) if name else None)
    if points is None and path.suffix == ".png":
        points = _png_points(path)
    return None if points is None else _of_points(tuple(map(float, points)))


def _of_points(points: tuple[float, ...]) -> Profile:
    """Primaries and white by x, y; damaged where they are no four points that make colours."""
    return Profile(_name(points), _usable(_to_rec709(points)))


def _usable(matrix: Array) -> Array:
    """The matrix to linear Rec.709 of a profile that shows colours, white as white.

    Raises
    ------
    ValueError
        White is none, or the primaries lie on a line: pictures would become black, or one colour.
    """
    white = np.abs(matrix.sum(axis=1) - 1).max()
    if not white <= WHITE_OFF or not np.linalg.cond(matrix) <= MOST_CONDITION:
        raise ValueError("its primaries and white make no colours")
    return matrix


def _rec709(rgb: AnyArray, profile: Profile, known: Transfer) -> AnyArray:
    """Values (H, W, 3) of the same type, encoded by `known`, for Rec.709's primaries."""
    top = None if rgb.dtype.kind == "f" else int(np.iinfo(rgb.dtype).max)
    curves = profile.curves or 3 * (known.decode,)
    if top is None:
        light = np.stack([curve(rgb[..., c]) for c, curve in enumerate(curves)], axis=-1)
    else:
        tables = [curve(np.arange(top + 1) / top).astype(np.float32) for curve in curves]
        light = np.stack([t[rgb[..., c]] for c, t in enumerate(tables)], axis=-1)
    assert profile.matrix is not None
    moved = light.astype(np.float32) @ profile.matrix.T.astype(np.float32)
    if top is None:
        return np.asarray(known.encode(moved), rgb.dtype)
    return np.rint(known.encode(np.clip(moved, 0, 1)) * np.float32(top)).astype(rgb.dtype)


def _to_rec709(points: tuple[float, ...]) -> Array:
    return np.asarray(np.linalg.solve(_to_d50(REC709), _to_d50(points)))


def _to_d50(points: tuple[float, ...]) -> Array:
    """(3, 3) to XYZ under D50 from x, y of red, green, blue and white."""
    x, y = np.reshape(points, (4, 2)).T.astype(float)
    xyz = np.stack([x, y, 1 - x - y])  # of sum 1
    share = np.linalg.solve(xyz[:, :3], xyz[:, 3])
    if not y[3] > 0 or not (share > 0).all():
        raise ValueError("its white is no mixture of its primaries")
    primaries, white = xyz[:, :3] * share / y[3], xyz[:, 3] / y[3]
    gain = (BRADFORD @ D50) / (BRADFORD @ white)
    return np.asarray(np.linalg.inv(BRADFORD) @ (gain[:, None] * BRADFORD) @ primaries)


def _name(points: tuple[float, ...]) -> str:
    near = (n for n, known in NAMED.items() if np.abs(np.subtract(points, known)).max() < 2e-3)
    return next(near, "with primaries of its own")


def _icc(data: bytes) -> Profile:
    """A profile of ICC.1:2022: its matrix and curves, if it has them."""
    tags = _icc_tags(data)
    name = _icc_name(tags.get(b"desc", b"")) or "ICC"
    if data[16:20] != b"RGB " or not {b"rXYZ", b"gXYZ", b"bXYZ"} <= tags.keys():
        return Profile(name, None)
    columns = [_fixed(tags[c + b"XYZ"][8:20]) for c in (b"r", b"g", b"b")]
    matrix = np.asarray(np.linalg.solve(_to_d50(REC709), np.transpose(columns)), float)
    curves = tuple(_rising(_curve(tags[c + b"TRC"])) for c in (b"r", b"g", b"b"))
    return Profile(name, _usable(matrix), curves)


def _icc_tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    rows = (struct.unpack_from(">4sII", data, 132 + 12 * k) for k in range(min(count, 100)))
    return {name: data[start : start + size] for name, start, size in rows}


def _icc_name(tag: bytes) -> str:
    if tag[:4] == b"desc":
        (length,) = struct.unpack_from(">I", tag, 8)
        return _short(tag[12 : 12 + length].decode("latin-1"))
    if tag[:4] == b"mluc":
        length, start = struct.unpack_from(">II", tag, 20)
        return _short(tag[start : start + length].decode("utf-16-be", "replace"))
    return ""


def _short(name: str) -> str:
    return name.strip("\0 ")[:MOST_NAME]


def _fixed(data: bytes) -> Array:
    """Numbers with 16 bits after the point."""
    return np.frombuffer(data, ">i4") / 65536


def _curve(tag: bytes) -> Curve:
    """A curve of type `curv` (a table, or an exponent) or `para` (a formula)."""
    if tag[:4] == b"para":
        (kind,) = struct.unpack_from(">H", tag, 8)
        return _formula(*_fixed(tag[12 : 12 + 4 * PARAMETERS[kind]]).tolist())
    (count,) = struct.unpack_from(">I", tag, 8)
    table = np.frombuffer(tag, ">u2", count, 12) / 65535
    if count < 2:
        return _formula(65535 / 256 * table[0] if count else 1.0)
    return lambda values: np.interp(values, np.linspace(0, 1, count), table)


def _rising(curve: Curve) -> Curve:
    """The curve; ValueError of one that leads not from dark to light."""
    light = curve(np.linspace(0, 1, 256))
    inside = (light >= -OVERSHOOT) & (light <= 1 + OVERSHOOT)
    usual = MEAN[0] < light.mean() < MEAN[1] and light[-1] - light[0] >= LEAST_RISE
    if not inside.all() or not usual or np.diff(light).min() < -MOST_DIP:
        raise ValueError("its curve does not lead from dark to light")
    return curve


def _formula(g: float, a: float = 1, b: float = 0, *more: float) -> Curve:
    """(a x + b)^g + e from d on, c x + f below: types 0 to 4 of ICC's `para`."""
    c, d, e, f = {
        0: (0.0, -b / a, 0.0, 0.0),
        1: (0.0, -b / a, *2 * more),
        2: (*more, 0.0, 0.0),
        4: more,
    }[len(more)]
    return lambda x: np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)


def _png_points(path: Path) -> tuple[float, ...] | None:
    """A PNG's cHRM chunk, which OpenImageIO does not give, unless sRGB's chunk overrides it."""
    points: tuple[float, ...] | None = None
    with path.open("rb") as file:
        for name, length in _png_chunks(file):
            if name in (b"sRGB", b"IDAT"):
                return points if name == b"IDAT" else None
            if name == b"cHRM":
                data = file.read(CHRM_BYTES) if length == CHRM_BYTES else b""
                white, primaries = np.split(np.frombuffer(data, ">u4") / 1e5, [2])
                points = (*primaries, *white)
    return None


def _png_chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Name and length of each chunk of a PNG, whose data is to be read next."""
    start = 8
    while len(head := file.read(8) if file.seek(start) else b"") == 8:
        length, name = struct.unpack(">I4s", head)
        yield name, length
        start += length + 12

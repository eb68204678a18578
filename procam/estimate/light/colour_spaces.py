"""Named colour spaces, chromatic adaptation and colour differences, by colour-science."""

from typing import Literal

import numpy as np

from procam.arrays import Array
from procam.errors import InputError, OutOfModelRange
from procam.maths.colour_science import colour_science

White = Literal["native", "D65"]
# their names in colour-science; all have the white D65
SPACES = {
    "sRGB": "ITU-R BT.709",
    "Rec.709": "ITU-R BT.709",
    "P3-D65": "P3-D65",
    "Rec.2020": "ITU-R BT.2020",
}
MAX_DUV = 0.05  # beyond it a colour temperature is not defined (CIE 15)


def xyy_from_xyz(xyz: Array) -> Array:
    """Chromaticity and luminance x, y, Y (..., 3) of tristimulus values (..., 3)."""
    colour = colour_science()
    return np.asarray(colour.XYZ_to_xyY(xyz), float)


def colour_difference(first: Array, second: Array, white: Array) -> Array:
    """CIEDE2000 (...) between tristimulus values (..., 3), seen against a white (3,) in the same unit."""
    colour = colour_science()
    illuminant = xyy_from_xyz(white)[:2]
    one, other = (colour.XYZ_to_Lab(xyz / white[1], illuminant) for xyz in (first, second))
    return np.asarray(colour.delta_E(one, other, method="CIE 2000"), float)


def colour_temperature(xyz: Array) -> tuple[float, float]:
    """Correlated colour temperature [K] and Duv of a white (3,) by Ohno 2013; NaN K if Duv is large."""
    colour = colour_science()
    uv = colour.UCS_to_uv(colour.XYZ_to_UCS(xyz))
    kelvin, duv = (float(v) for v in colour.temperature.uv_to_CCT_Ohno2013(uv))
    return (kelvin if abs(duv) <= MAX_DUV else np.nan), duv


def content_from_rgb(space: str, xyz_from_content: Array, white: White = "native") -> Array:
    """(3, 3) from linear RGB of a named space to content channels.

    Parameters
    ----------
    space : one of SPACES.
    xyz_from_content : (3, 3) [cd/m2], as in `AbsoluteLight`.
    white : "native" maps the space's white to that of the dome and adapts the other colours to it
        (Bradford); "D65" keeps all colours, as bright as the dome can show them.

    Returns
    -------
    Columns are the space's primaries. Negative entries are out of the dome's gamut; see
    `unshown_saturation`.

    Raises
    ------
    InputError
        For an unknown space or white.
    OutOfModelRange
        If the dome cannot show D65 at all.
    """
    colour = colour_science()
    if space not in SPACES or white not in ("native", "D65"):
        raise InputError(
            f"colour space {space!r} with white {white!r} is unknown; choose one of {', '.join(SPACES)} "
            "with white native or D65"
        )
    named = colour.RGB_COLOURSPACES[SPACES[space]]
    xyz_from_rgb = colour.normalised_primary_matrix(named.primaries, named.whitepoint)
    native = xyz_from_content.sum(axis=1)
    if white == "native":
        adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(
            xyz_from_rgb.sum(axis=1), native / native[1], transform="Bradford"
        )
        return np.linalg.solve(xyz_from_content, native[1] * adapted @ xyz_from_rgb)
    matrix = np.linalg.solve(xyz_from_content, xyz_from_rgb)
    shown = matrix.sum(axis=1)
    if shown.min() < 0:
        raise OutOfModelRange(f"{space}: the dome's primaries cannot mix D65; use its native white")
    return np.asarray(matrix / shown.max())


def unshown_saturation(content_from_space: Array, xyz_from_content: Array) -> Array:
    """Share (3,) of the saturation of a space's R, G, B that the dome cannot show; 0 if it shows all.

    On the line from grey of the same luminance to the primary, the part beyond the point where the
    first content channel reaches 0.
    """
    luminance = xyz_from_content[1] @ content_from_space
    grey = np.outer(content_from_space.sum(axis=1), luminance / luminance.sum())
    reach = np.where(content_from_space < 0, grey / (grey - content_from_space), 1)
    return np.asarray(1 - reach.min(axis=0))

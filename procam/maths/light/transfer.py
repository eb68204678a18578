"""Transfer functions by name: encoded values to linear light and back."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from procam.arrays import FloatArray
from procam.errors import InputError
from procam.maths.light.curves import srgb_decode, srgb_encode


@dataclass(frozen=True, slots=True)
class Transfer:
    """A transfer function: `decode` encoded values 0..1 to linear light, `encode` it back."""

    name: str
    decode: Callable[[FloatArray], FloatArray]
    encode: Callable[[FloatArray], FloatArray]


def transfer(name: str) -> Transfer:
    """The transfer function of that name.

    srgb is IEC 61966-2-1; bt1886 is gamma 2.4, the display of BT.709 video by Rec. ITU-R BT.1886.

    >>> float(transfer("gamma2.2").encode(np.array(0.5)).round(4))
    0.7297
    """
    if name not in _TRANSFERS:
        raise InputError(
            f"transfer function {name!r} is unknown; choose the one that the content was made for: "
            f"{', '.join(_TRANSFERS)}"
        )
    return _TRANSFERS[name]


def _power(name: str, exponent: float) -> Transfer:
    return Transfer(
        name,
        lambda encoded: np.maximum(encoded, 0) ** exponent,
        lambda linear: np.maximum(linear, 0) ** (1 / exponent),
    )


_TRANSFERS: Mapping[str, Transfer] = MappingProxyType(
    {
        "srgb": Transfer("srgb", srgb_decode, srgb_encode),
        "linear": Transfer("linear", lambda encoded: encoded, lambda linear: linear),
        "gamma2.2": _power("gamma2.2", 2.2),
        "gamma2.4": _power("gamma2.4", 2.4),
        "gamma2.6": _power("gamma2.6", 2.6),
        "bt1886": _power("bt1886", 2.4),
    }
)
TRANSFER_NAMES = tuple(_TRANSFERS)

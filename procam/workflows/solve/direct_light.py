"""Measures a projector's direct light by a session's stripes, and checks that enough of it was decoded."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import BoolArray
from procam.errors import CalibrationError
from procam.estimate.camera.noise import NoiseLaw, noise_from_pairs
from procam.estimate.light.direct_light import DirectLight, find_direct_light
from procam.estimate.structured_light.limits import difference_sigma
from procam.model.correspondence import CorrespondenceMap
from procam.workflows.capture.session_images import Counts, SessionImages

SAMPLES = 200_000  # of which a noise law is fitted
LEAST_PIXELS = 200  # with direct light, of which a share is judged
# of the pixels with direct light, that must be decoded; without a mistake 0.85 or more, the rest at borders
LEAST_DECODED = 0.6


@dataclass(frozen=True, slots=True)
class Decoded:
    """What one camera sees of a projector: its pixels' `map`, and where it is lit at all, by stripes."""

    map: CorrespondenceMap
    direct: DirectLight


def stripe_light(
    images: SessionImages, name: str, white: Counts, black: Counts
) -> tuple[NoiseLaw, DirectLight]:
    """The camera's noise law, and where it sees direct light, from stripes of projector `name`.

    `white`, `black` : (H, W) its counts, exposed alike.
    """
    pairs, sensor = list(images.stripe_counts(name)), images.radiometer.camera.sensor
    some = np.flatnonzero(images.radiometer.seen)
    some = some[:: max(1, some.size // SAMPLES)]
    law = noise_from_pairs([np.ravel(c)[some] for c in (*pairs[0], *pairs[-1])], sensor)
    span = np.subtract(white, black, dtype=np.float32)
    sigma = difference_sigma(white, black, law, sensor)
    return law, find_direct_light(span, pairs, sigma)


def check_decoded(images: SessionImages, name: str, decoded: BoolArray, lit: BoolArray) -> None:
    """Refuse a projector of whose `lit` pixels (H, W) only a part is `decoded` (H, W).

    Raises
    ------
    CalibrationError
        With the shares, and what to do.
    """
    if lit.sum() < LEAST_PIXELS:
        return
    share = float(decoded[lit].mean())
    if share < LEAST_DECODED:
        camera = images.radiometer.camera
        seen = float(lit.sum() / images.radiometer.seen.sum())
        raise CalibrationError(
            f"projector {name} lights {seen:.0%} of what camera {camera.name} sees, but only {share:.0%} of "
            f"that can be decoded: it is too dark for this camera's noise and its {camera.sensor.bits} bits. "
            "Photograph with a longer exposure_s, raw or with more bits, and nothing in front of the picture"
        )

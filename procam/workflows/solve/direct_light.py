"""Measures a projector's direct light by a session's stripes, and checks that enough of it was decoded."""

from collections.abc import Iterator

import numpy as np

from procam.arrays import BoolArray
from procam.errors import CalibrationError
from procam.estimate.camera.noise import NoiseLaw, noise_from_pairs
from procam.estimate.light.direct_light import DirectLight, find_direct_light, stripe_contrast
from procam.estimate.structured_light.limits import difference_sigma
from procam.workflows.capture.session_images import Counts, SessionImages

SAMPLES = 200_000  # of which a noise law is fitted
LEAST_PIXELS = 200  # with direct light, of which a share is judged
# of the pixels with direct light, that must be decoded; without a mistake 0.85 or more, the rest at borders
LEAST_DECODED = 0.6


def stripe_light(
    images: SessionImages, name: str, white: Counts, black: Counts
) -> tuple[NoiseLaw, DirectLight]:
    """The camera's noise law, and where it sees direct light, from stripes of projector `name`.

    `white`, `black` : (H, W) its counts, exposed alike.
    """
    sensor, samples = images.radiometer.camera.sensor, list[Counts]()
    some = np.flatnonzero(images.radiometer.seen)
    some = some[:: max(1, some.size // SAMPLES)]

    def sampled() -> Iterator[tuple[Counts, Counts]]:
        for pair in images.stripe_counts(name):
            samples.extend(np.ravel(counts)[some] for counts in pair)
            yield pair

    span = np.subtract(white, black, dtype=np.float32)
    contrast = stripe_contrast(span, sampled())
    law = noise_from_pairs([*samples[:2], *samples[-2:]], sensor)
    return law, find_direct_light(span, contrast, difference_sigma(white, black, law, sensor))


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

"""What a session's stripes show of a projector's direct light, and whether enough of it was decoded."""

import numpy as np

from procam.arrays import BoolArray
from procam.errors import CalibrationError
from procam.estimate.camera.noise import NoiseLaw, noise_from_pairs
from procam.estimate.light.direct_light import DirectLight, find_direct_light
from procam.estimate.structured_light.limits import difference_sigma
from procam.workflows.capture.session_images import SessionImages

SAMPLES = 200_000  # of which a noise law is fitted
LEAST_PIXELS = 200  # with direct light, of which a share is judged
# of the pixels with direct light, that must be decoded; without a mistake .85 or more, the rest at borders
LEAST_DECODED = 0.6


def camera_noise(images: SessionImages, name: str) -> NoiseLaw:
    """The camera's noise law, from stripes of projector `name` along both axes."""
    first, *_, last = images.stripe_counts(name)
    some = np.flatnonzero(images.radiometer.seen)
    some = some[:: max(1, some.size // SAMPLES)]
    samples = [np.ravel(counts)[some] for counts in (*first, *last)]
    return noise_from_pairs(samples, images.radiometer.camera.sensor)


def direct_light(images: SessionImages, name: str, law: NoiseLaw) -> DirectLight:
    """Where the camera sees direct light of projector `name`."""
    white, black = images.white_and_black(name)
    sigma = difference_sigma(white, black, law, images.radiometer.camera.sensor)
    span = np.subtract(white, black, dtype=np.float32)
    return find_direct_light(span, images.stripe_counts(name), sigma)


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

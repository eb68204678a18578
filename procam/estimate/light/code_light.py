"""Checks that the sinusoids of a code have equal mean light, as the response predicts."""

from collections.abc import Mapping, Sequence

import numpy as np

from procam.arrays import Array, FloatArray, Image
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.projector_images import CameraSight, Picture, ProjectorImages
from procam.maths.warp import sample
from procam.model.photometry import ResponseCurve
from procam.model.plan import Shot
from procam.model.provenance import Note

ODD_LIGHT = 0.1  # relative; waves of different phase differ by a percent, a person takes some
WAVES = 6  # at least so many of a code, evenly picked, have their light predicted
# relative, of their median: 0.002 without a mistake; an unsharp mask of 1.0 makes 0.04 of waves of 16 px,
# and 0.005 of waves of 50 px, where it is harmless
NOT_PREDICTED = 0.01
GREEN = 1


def odd_waves(light: Mapping[int, float], shots: Sequence[Shot], name: str) -> list[Note]:
    """A note of a code's pictures that are brighter or darker than the others: fine waves have equal light.

    `light` are mean counts by number: white, black, planes.
    """
    planes = {str(s.id): light[int(s.detail["plane"])] - light[1] for s in shots}
    usual = float(np.median(list(planes.values())))
    ratios = {shot: value / usual for shot, value in planes.items()}
    odd = {shot: ratio for shot, ratio in ratios.items() if abs(ratio - 1) > ODD_LIGHT}
    if not odd:
        return []
    listed = ", ".join(f"{shot} ({ratio:.2f} times)" for shot, ratio in odd.items())
    text = (
        f"photographs of its waves show other light than the rest of them: {listed}. Their exposure times "
        "differ from the files', or stray light got in, so directions and what is lit may be wrong by more "
        "than is stated. Photograph again"
    )
    amount = sum(abs(ratio - 1) for ratio in odd.values()) / ODD_LIGHT
    return [Note("odd photographs", f"projector {name}", text, amount)]


def wave_notes(
    images: ProjectorImages, sight: CameraSight, found: ProjectorMeasurement
) -> list[Note]:
    """A note if the waves of a projector's code are not as bright as its response predicts.

    Waves are finer than the tiles from which the response is measured, so what a projector does to fine
    pictures alone, such as sharpening, makes a difference. The light of white is that of all stripes,
    as one photograph may be a percent off. `found` : direct and scattered light of white.
    """

    def shown(picture: Picture) -> Image:
        return _green_light(picture.drive()[..., 0], found.response, found.colour.mix)

    sound = found.light.lit & ~sight.unpatterned
    direct, scattered = (x[..., GREEN] for x in (found.light.direct, found.light.scattered))
    full, ratios = shown(images.white).mean(), list[float]()
    for picture in images.code[:: max(1, len(images.code) // WAVES)]:
        wave, light = shown(picture), picture.light()
        predicted = direct * sample(wave, sight.xy) + scattered * (wave.mean() / full)
        seen = (light[..., GREEN] if light.ndim == 3 else light) - sight.base[..., GREEN]
        both = sound & np.isfinite(predicted) & np.isfinite(seen)
        ratios.append(float(seen[both].sum() / predicted[both].sum()))
    ratio = float(np.median(ratios))
    if abs(ratio - 1) <= NOT_PREDICTED:
        return []
    text = (
        f"the waves of its code show {ratio:.2f} times the light that its response "
        "predicts: it or the player sharpens or scales the picture, or alters it in another way, so what is "
        "lit may be wrong by more than is stated. Switch off sharpness, detail and dynamic contrast, show "
        "pictures pixel by pixel in 8 bits, and photograph again"
    )
    amount = (ratio - 1) / NOT_PREDICTED
    return [Note("altered pictures", f"projector {images.name}", text, amount)]


def _green_light(drive: FloatArray, response: ResponseCurve, mix: Array) -> Image:
    """Green light (H, W) of grey drives (H, W), relative to that of white."""
    curve = response.values @ mix[GREEN]
    return np.asarray(np.interp(drive, response.levels, curve), np.float32)

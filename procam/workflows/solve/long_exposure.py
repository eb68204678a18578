"""Whether black's long exposure is what it says, by a dim picture photographed at both exposures."""

from dataclasses import replace

import numpy as np

from procam.estimate.camera.checks import exposure_ratio
from procam.workflows.capture.session_images import SessionImages

GREEN = 1
NOTED, CERTAIN = 0.02, 5.0  # departure from 1, and sigmas


def with_long_exposure(images: SessionImages) -> tuple[SessionImages, list[str]]:
    """The images, of which long ones count as long as they were really exposed, and a note if that matters.

    Where the plan has the picture and nobody photographed it, a note says what is not known then.
    """
    planned = [shot for shot in images.plan.shots if shot.purpose == "dim"]
    if planned and not images.checks("dim"):
        return images, [
            f"{planned[0].id}, the dim picture at the end, was not photographed: whether the camera moved "
            "between projectors, and how long black was exposed, is not checked"
        ]
    for shot in images.checks("dim"):
        if len(shot.exposures_s) == 1:
            continue
        dark = images.dark()
        short, long = (images.light(shot, i)[..., GREEN] - dark[i][..., GREEN] for i in range(2))
        seen = images.radiometer.seen
        ratio, sigma = exposure_ratio(*(np.where(seen, x, np.nan) for x in (short, long)))
        if abs(ratio - 1) > max(NOTED, CERTAIN * sigma):
            return replace(images, long_exposure=ratio), [
                f"camera {images.radiometer.camera.name}: photographs of {shot.exposures_s[1]:g} s were "
                f"exposed {ratio:.3g} times as long, by the light of {shot.id}; black counts as "
                "measured with that. Check the longest exposure that the camera can do, and [capture] "
                "black_exposure_s"
            ]
    return images, []

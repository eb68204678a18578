"""Settings of the perceptual methods."""

from dataclasses import dataclass

import numpy as np

from procam.errors import InputError


@dataclass(frozen=True, slots=True)
class Perceptual:
    """A perceptual method and its settings.

    Attributes
    ----------
    db : loss of the peak signal-to-noise ratio of luminance in PU21 units, against the exact solution,
        that is allowed for better contrast [dB]; at least 0.
    white_nits : luminance of light 1.0 on the dome [cd/m2].
    video : for frames of a movie, in their order: quick, and with little flicker.

    Raises
    ------
    InputError
        A loss below 0 or a white that is not above 0.
    """

    db: float = 0.0
    white_nits: float = 14.0
    video: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.db < np.inf:
            raise InputError(
                f"db: {self.db:g} is below 0 or no number; it is the loss against the exact solution, in "
                "dB, that is allowed for better contrast"
            )
        if not 0 < self.white_nits < np.inf:
            raise InputError(
                f"white_nits: {self.white_nits:g} is not above 0; it is the luminance of white on the "
                "dome, in cd/m2"
            )

    @property
    def name(self) -> str:
        """Of the method."""
        return "perceptual-video" if self.video else "perceptual"

    @property
    def allowed(self) -> float:
        """Factor of the squared error."""
        return float(10 ** (self.db / 10))


PERCEPTUAL = {found.name: found for found in (Perceptual(), Perceptual(video=True))}

"""What one camera photographed of one projector; each photograph is read when its light is asked for."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from procam.arrays import BoolArray, Image
from procam.estimate.light.picture_flux import PictureFlux


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture that a projector showed, and its photograph.

    Attributes
    ----------
    id, purpose : of its shot.
    drive : reads what was shown, (h, w, C) of the panel.
    light : reads the radiance (H, W) or (H, W, 3) of the photograph, anew at each call: it may be changed.
    """

    id: str
    purpose: str
    drive: Callable[[], Image]
    light: Callable[[], Image]


@dataclass(frozen=True, slots=True)
class StripePair:
    """Stripes of a bit of an axis, and their inverse."""

    axis: str
    bit: int
    pattern: Picture
    inverse: Picture

    def lights(self, base: Image) -> tuple[Image, Image]:
        """Radiance of both photographs less the base (H, W, 3)."""
        pattern, inverse = self.pattern.light(), self.inverse.light()
        pattern -= base
        inverse -= base
        return pattern, inverse


@dataclass(frozen=True, slots=True)
class ProjectorImages:
    """The pictures of projector `name` as `camera` photographed them, by purpose.

    Attributes
    ----------
    read_black : its black (H, W, 3), less the light of the room [rel].
    dim : the dim picture at the end of a session, if it is this projector's.
    step : radiance of a count of white.
    """

    name: str
    camera: str
    read_black: Callable[[], Image]
    white: Picture
    code: Sequence[Picture]
    stripes: Sequence[StripePair]
    primaries: Sequence[Picture]
    levels: Sequence[Picture]
    zones: Sequence[Picture]
    dim: Picture | None
    step: float

    def in_turn(self, every: int) -> Iterator[Picture]:
        """Pictures of all kinds that show more than one colour; of the code's only one of `every`."""
        yield from self.code[::every]
        for pair in self.stripes:
            yield from (pair.pattern, pair.inverse)
        yield from (*self.zones, *self.levels)


@dataclass(frozen=True, slots=True)
class CameraSight:
    """One projector as the main camera sees it.

    Attributes
    ----------
    xy : (H, W, 2) panel pixel, NaN where there is none. panel : its pixels on the raster that stripes
        and levels are drawn on, NaN also where they are hidden.
    lit : (H, W) sees the projector's picture. maybe_lit : (H, W) may see it, or see a pixel of it in part.
    unpatterned : (H, W) sees no pattern, because of a shot mark or a glint of the lens.
    unknown : (H, W) should see it, and is too dark to decide whether it does.
    white, base : (H, W, 3) white less the base; black and room light at white's exposure.
    flux : of pictures over that of white.
    shot_ids_share : share of the panel that its pictures' numbers take.
    """

    xy: Image
    panel: Image
    lit: BoolArray
    maybe_lit: BoolArray
    unpatterned: BoolArray
    unknown: BoolArray
    white: Image
    base: Image
    flux: PictureFlux
    shot_ids_share: float

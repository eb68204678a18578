"""Direct/global separation from stripe pictures.

Follows Nayar et al. 2006, doi:10.1145/1141911.1141977. A camera pixel inside a dark stripe, well clear
of its edges, and every pixel outside a projector's picture see scattered light alone. `Separation`
averages those samples over all pictures of a projector, each divided by the picture's flux relative to
full white, and subtracts the result from white: direct light remains.
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.light.edge_overshoot import EdgeOvershoot
from procam.estimate.light.picture_flux import PictureFlux
from procam.maths.codes.gray import is_bright, stripe_edge_distance
from procam.maths.warp import blur_within, grow

# distance from a stripe's edge beyond which it leaves no direct light: at least so much [projector px],
# so many sigmas of the measured blur, of which 3e-5 is left, and at most this share of half a stripe
CLEAR_PX, CLEAR_SIGMAS, CLEAR_SHARE = 3.0, 4.0, 0.75
NEVER_CLEAR = 2.0  # halves of stripes over which they are blurred: seen along a wall, none is dark
# sigma of the edges' blur [pixel extents], up to which scattered light is right to 0.5 % at any pixel;
# in focus it is 0.3 to 0.8
MAX_BLUR = 2.5
OVERSHOOT = 0.02  # of unsharpened edges it is below 0
LEAST_SHARE = 0.5  # of the direct light of white that is left when scattered light is taken away
GREEN = 1
LEAST = 1e-3  # share of white's scattered light, of which a picture says nothing
EDGE_REACH = 5.0  # how far from an edge its blur is measured [pixel extents]
MIN_SLOPE = 0.05  # of a projector's coordinate over a camera pixel [projector px]
EXTENT_BLUR_PX = 2.0  # Gaussian sigma; fills in for pixels beside a hole
HOLE_PX = 3  # widest gap between decoded pixels that counts as lit
CLEAR_CAMERA_PX = 6  # least distance from the border of a projector's picture
GLOBAL_BLUR_PX = 1.0  # Gaussian sigma of the smoothing of scattered light
FILL_BLURS_PX = 8.0, 64.0  # the same, where nothing was measured within reach of the narrower one
EXTEND_PX = 3.0  # Gaussian sigma of the continuation of direct light beyond the border


@dataclass(frozen=True, slots=True)
class SeparatedLight:
    """Direct and scattered light of one projector's full white, in camera radiance [full scale/s].

    Attributes
    ----------
    direct, scattered : (H, W, 3); `direct` fades to 0 over the border of the picture.
    flux : (3,) direct flux, sum of solid angle times direct [radiance sr].
    lit : (H, W) whether the pixel sees this projector's picture.
    """

    direct: Image
    scattered: Image
    flux: Array
    lit: BoolArray

    def extended(self) -> Image:
        """Direct light (H, W, 3), continued a few pixels beyond the border; not kept, to save memory."""
        inside = grow(self.lit, -1)
        beyond = blur_within(self.direct, inside, EXTEND_PX)
        return np.where(inside[..., None], self.direct, beyond)


class Separation:
    """Running direct/global separation of one projector; memory does not grow with its pictures.

    Parameters
    ----------
    white : (H, W, 3) white less black. projector_xy : (H, W, 2), NaN outside the panel.
    lit : (H, W) its picture's pixels. flux : of its pictures.
    maybe_lit : (H, W) others that may see its picture, so that scattered light is not measured there.

    Attributes
    ----------
    blur : largest blur of the stripes' edges so far, a standard deviation in pixel extents: the size
        of a camera and a projector pixel together (root of the sum of squares). Above `MAX_BLUR` the
        result is not usable.
    dark_weight : (H, W) statistical weight of the scattered light so far; 0 where it is interpolated.
    """

    def __init__(
        self,
        white: Image,
        projector_xy: Image,
        lit: BoolArray,
        flux: PictureFlux,
        maybe_lit: BoolArray | None = None,
    ) -> None:
        usable = np.isfinite(white).all(axis=-1)
        # pixels on an edge of the finest stripes do not decode, but they are lit
        lit = grow(grow(lit, HOLE_PX), -HOLE_PX)
        self._flux, on_screen = flux, flux.weight > 0
        self._xy = projector_xy
        self._extent = [_pixel_extent(projector_xy[..., i]) for i in range(2)]
        self._white, self.blur, self._edges = white, 0.0, EdgeOvershoot()
        self._inside = grow(lit & usable, -2)
        maybe = lit if maybe_lit is None else maybe_lit
        self._outside = on_screen & ~grow(lit, CLEAR_CAMERA_PX) & ~maybe
        self._sum, self._count = np.nan_to_num(white), np.ones(lit.shape, np.float32)
        self._shares = np.ones(lit.shape, np.float32)  # scattered light in the sum over white's
        self._dark_sum = np.where(self._outside[..., None], self._sum, 0)
        self.dark_weight = self._outside.astype(np.float32)

    @property
    def overshoot(self) -> float:
        """Largest share by which pixels were brighter with an edge beside them; what is sharpened is."""
        return self._edges.largest

    @property
    def clear_px(self) -> int:
        """Distance from the border of a lit part from which it leaves no direct light [camera px]."""
        extents = [np.median(x[self._inside]) if self._inside.any() else 1.0 for x in self._extent]
        # a coordinate changes by sqrt(extent^2 - 1) from one camera pixel to the next
        widest = max(e / np.sqrt(max(e**2 - 1, MIN_SLOPE**2)) for e in extents)
        return max(CLEAR_CAMERA_PX, int(np.ceil(CLEAR_SIGMAS * self.blur * widest)))

    def add_pair(
        self, axis: str, bit: int, pattern: Image, inverse: Image
    ) -> tuple[BoolArray, BoolArray]:
        """Add a stripe picture and its inverse, (H, W, 3), black subtracted.

        Returns where in the projector's picture (H, W) each of them shows scattered light alone.
        """
        which = 0 if axis == "x" else 1
        distance = stripe_edge_distance(self._xy[..., which], bit)
        extent = self._extent[which]
        # few edges, or only one side of one, read too little: the largest so far counts
        known = np.isfinite(pattern).all(axis=-1) & np.isfinite(inverse).all(axis=-1)
        usable = known & self._inside & np.isfinite(distance)
        measured = self._edge_blur((pattern, inverse), usable, distance, extent, 2.0**bit)
        self.blur = max(self.blur, np.nan_to_num(measured))
        bright = is_bright(np.rint(np.nan_to_num(self._xy[..., which])).astype(np.int32), bit)
        away_px = distance / np.sqrt(np.maximum(extent**2 - 1, MIN_SLOPE**2))
        shares = [self._flux.share(picture) for picture in (pattern, inverse)]
        surplus, both = ((shares[0] - shares[1])[..., GREEN], (shares[0] + shares[1])[..., GREEN])
        direct = self._direct_green(pattern, inverse, bright, surplus)
        self._edges.add(direct, away_px, self._inside)
        blurred = CLEAR_SIGMAS * self.blur * extent
        reach = np.maximum(CLEAR_PX, np.minimum(blurred, CLEAR_SHARE * 2.0**bit))
        with np.errstate(invalid="ignore"):
            near_edge = (distance <= reach) | (blurred > NEVER_CLEAR * 2.0**bit)
        # a media server draws edges as greys, which do not add up to white
        sound = ~near_edge & known
        for picture in (pattern, inverse):
            np.add(self._sum, picture, out=self._sum, where=sound[..., None])
        self._count += sound
        self._shares += sound * np.float32(both)
        clear = self._inside & sound & np.isfinite(self._xy[..., which])
        self._add_dark(pattern, (clear & ~bright) | self._outside, shares[0])
        self._add_dark(inverse, (clear & bright) | self._outside, shares[1])
        return clear & ~bright, clear & bright

    def _edge_blur(
        self,
        pictures: tuple[Image, Image],
        usable: BoolArray,
        distance: FloatArray,
        extent: FloatArray,
        half: float,
    ) -> float:
        """Standard deviation of the blur of a pair's stripe edges [pixel extents].

        It is that of the most blurred channel of the contrast between a pattern and its inverse
        (H, W, 3). An edge with a Gaussian blur takes sqrt(2/pi) standard deviations of full contrast
        away on each side. Full contrast is that of the inner half of the stripes, `half` of which
        measures so many projector pixels.
        """
        pattern, inverse = pictures
        reach = np.minimum(EDGE_REACH, half / 2 / extent)
        near, far = usable & (distance < reach * extent), usable & (distance >= half / 2)
        if not (near.any() and far.any()):
            return float("nan")
        share = [
            np.abs(pattern[part] - inverse[part]).sum(axis=0) / self._white[part].sum(axis=0)
            for part in (near, far)
        ]
        return float(np.sqrt(np.pi / 2) * reach[near].mean() * (1 - share[0] / share[1]).max())

    def _direct_green(
        self, pattern: Image, inverse: Image, bright: BoolArray, surplus: FloatArray
    ) -> FloatArray:
        """Direct green light (H, W) of white; scattered light of the pair differs by `surplus` of white's.

        NaN where its stripes hold most of the flux, so that the unevenness of scattered light outweighs it.
        """
        direct = pattern[..., GREEN] - inverse[..., GREEN] - surplus * self._white[..., GREEN]
        share = np.where(bright, 1 - surplus, -1 - surplus)
        share[np.abs(share) < LEAST_SHARE] = np.nan
        return np.asarray(direct / share, np.float32)

    def _add_dark(self, light: Image, dark: BoolArray, share: FloatArray) -> None:
        weight = share[..., GREEN] ** 2  # one weight for all channels, whose shares differ little
        dark = dark & (np.asarray(share).min(axis=-1) > LEAST)
        for channel in range(light.shape[-1]):
            total = self._dark_sum[..., channel]
            factor = np.float32(weight / np.maximum(share[..., channel], LEAST))
            np.add(total, factor * light[..., channel], out=total, where=dark)
        self.dark_weight += dark * np.float32(weight)

    def result(self) -> SeparatedLight:
        """Direct and scattered light from all pairs; none can be added after it, to save memory."""
        on_screen = self._flux.weight > 0
        known = (self.dark_weight > 0) & on_screen & np.isfinite(self._dark_sum).all(axis=-1)
        border = grow(self._inside, 2 + self.clear_px) & ~self._inside
        known &= ~border
        self._dark_sum /= np.maximum(self.dark_weight, np.float32(1e-12))[..., None]
        scattered = self._smoothed(known, on_screen)
        near = (border | self._inside) & on_screen
        direct = self._sum
        direct -= self._shares[..., None] * scattered
        direct /= self._count[..., None]
        direct[~near] = 0
        return SeparatedLight(direct, scattered, self._flux.total(direct), self._inside)

    def _smoothed(self, known: BoolArray, on_screen: BoolArray) -> Image:
        """Scattered light (H, W, 3) of white, filled in where it is not `known` (H, W)."""
        self._dark_sum /= self._flux.pattern
        scattered = np.zeros_like(self._dark_sum)
        for part in self._flux.parts():
            inside, missing = known & part, part
            for blur_px in (GLOBAL_BLUR_PX, *FILL_BLURS_PX):
                if missing.any():
                    found = blur_within(self._dark_sum, inside, blur_px)
                    np.copyto(scattered, found, where=missing[..., None])
                missing = part & on_screen & (scattered[..., GREEN] == 0)
        missing = on_screen & (
            scattered[..., GREEN] == 0
        )  # of parts that are seen along their edge alone
        if missing.any():
            found = blur_within(self._dark_sum, known, FILL_BLURS_PX[-1])
            np.copyto(scattered, found, where=missing[..., None])
        scattered *= self._flux.pattern
        return scattered


def _pixel_extent(coordinate: FloatArray) -> FloatArray:
    """Extent (H, W) of a camera and a projector pixel together along a coordinate [projector px]."""
    across = np.hypot(*np.gradient(coordinate))
    known = np.isfinite(across)
    return np.hypot(1, blur_within(np.nan_to_num(across), known, EXTENT_BLUR_PX))

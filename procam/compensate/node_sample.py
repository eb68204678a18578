"""A sample of the nodes of a frame model, for slopes and for the share of places at a limit."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, FloatArray, IndexArray, Map
from procam.kernels.frame import FrameModel
from procam.kernels.frame.reference import monomials

CHANNELS = 3
SAMPLE = 96  # nodes along an edge, at most


@dataclass(frozen=True, eq=False)
class NodeSample:
    """A sample of a model's nodes, and the pixels of the picture nearest to them.

    `node` (S,) indices along an edge, `pixel` (S,) of the picture; `weight` (S, S) [sr], `spread`
    (S, S, 3), `terms` (T, S, S).
    """

    node: IndexArray
    pixel: IndexArray
    weight: Array
    spread: Array
    terms: Array

    @classmethod
    def of(cls, model: FrameModel) -> "NodeSample":
        """Equally spaced nodes of a model; their weights add up to its solid angle."""
        step = -(-model.nodes // SAMPLE)
        node = np.arange(step // 2, model.nodes, step)
        pixel = ((node + 0.5) * model.size / model.nodes).astype(np.intp)
        grid = np.ix_(node, node)
        weight = model.solid_angle_sr[grid].astype(float)
        total = float(model.solid_angle_sr.sum(dtype=float)) * (model.size / model.nodes) ** 2
        terms = monomials(model.direction[:, node][:, :, node], model.terms)
        scale = total / max(float(weight.sum()), 1e-300)
        return cls(node, pixel, weight * scale, model.spread[grid].astype(float), terms)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of a boolean mask over the sample, per colour."""
        return (*self.weight.shape, CHANNELS)

    def of_picture(self, picture: AnyArray) -> AnyArray:
        """The sample's pixels (S, S, 3) of a picture (N, N, 3)."""
        return picture[np.ix_(self.pixel, self.pixel)]

    def free(self, model: FrameModel, content: FloatArray, light: Map, top: float) -> BoolArray:
        """Where (S, S, 3) no limit holds, for linear content (S, S, 3) less scattered light.

        White that is just reached is free: the solution subtracts more light.
        """
        grid = np.ix_(self.node, self.node)
        gain = 1 if model.gain is None else model.gain[grid][..., None]
        wanted = content * gain - light[grid]
        hi = top if model.hi is None else np.minimum(model.hi[grid], top)
        return np.asarray((wanted > model.lo[grid]) & (wanted <= hi))

    def products(self, where: BoolArray, power: int) -> Array:
        """(3, T, T): moments over `where` (S, S, 3) of the monomials, weighted with spread^power."""
        flat = self.terms.reshape(len(self.terms), -1)
        found = []
        for c in range(CHANNELS):
            weight = self.weight * where[..., c] * self.spread[..., c] ** power
            found.append((flat * weight.ravel()) @ flat.T)
        return np.array(found)

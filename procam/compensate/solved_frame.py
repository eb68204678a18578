"""A compensated frame, and how well it solves its equations."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from procam.arrays import AnyArray, Array, Image
from procam.compensate.equations import FrameEquations, Solution
from procam.errors import InputError
from procam.kernels.frame.api import frame_sums
from procam.kernels.frame.coding import Coding

if TYPE_CHECKING:
    from procam.compensate.perceptual.targets import Reached

DARKEST = 1e-5  # moments [rel sr] of a black frame: certificates are relative to no less
OPTIMAL = "exact", "least-squares"  # methods of the equations that have an optimum


@dataclass(frozen=True, slots=True)
class Certificate:
    """How well a compensated frame solves its equations, at full strength, by the solver's own sums.

    `procam.compensate.light_check` checks the values that were sent by a path of its own.

    Attributes
    ----------
    kkt : residual of the optimality conditions, relative to the moments of the light; NaN for methods
        without an optimum. Of a perceptual method: of (P) for the target that it chose.
    self_consistency : moments of the light sent less those assumed for the scattered light; relative.
    share_lo, share_hi : (3,) share of the lit solid angle where a limit holds.
    flux_in, flux_out : (3,) of the content under its white (of what a perceptual method chose instead), and
        of the light sent [rel sr].
    from_exact : how far a perceptual method went from the exact solution, 0, towards its optimum, 1; NaN
        for other methods.
    luminance_loss_db : its loss against the exact solution of what `Perceptual.db` bounds [dB], content
        brighter than the projectors counted as their brightest; 0 where it is the exact solution.
    """

    kkt: float
    self_consistency: float
    share_lo: Array
    share_hi: Array
    flux_in: Array
    flux_out: Array
    from_exact: float = float("nan")
    luminance_loss_db: float = float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class SolvedFrame:
    """A frame that `Compensator.solve` has solved.

    Attributes
    ----------
    sent : (N, N, 3) the light to send, encoded as the content is.
    coefficients : (3, 9) polynomial of its scattered light (`Fields.coefficients_of`).
    chosen : (N, N, 3) linear light that (P) was solved for instead of the content; None if it was not.
    certify : gives the certificate; None where the frame was written over its content.
    """

    sent: AnyArray
    coefficients: Array
    chosen: Image | None = None
    certify: Callable[[], Certificate] | None = field(default=None, repr=False)

    @property
    def certificate(self) -> Certificate:
        """Of this frame, as long as nobody changes its content; costs a few evaluations.

        Raises
        ------
        InputError
            The frame was written over its content.
        """
        if self.certify is None:
            raise InputError(
                "certificate: the frame was written over its content, which is needed to certify it; give "
                "solve() another array to write to"
            )
        return self.certify()


def certificate(
    equations: FrameEquations,
    content: AnyArray,
    coding: Coding,
    solution: Solution,
    reached: "Reached | None",
) -> Certificate:
    """How well a solution solves the equations; `reached` is what a perceptual method chose."""

    def sums(what: str) -> Array:
        return equations.sums(content, solution, what, coding)

    lit = float(equations.fields.gram[0, 0])
    sent = sums("light")
    missed = residual = sent - solution.moments
    if solution.pull is not None:
        residual = equations.residual(content, coding, solution)
    moments = max(np.abs(sent).max(), DARKEST)
    optimal = equations.method in OPTIMAL
    dark = np.zeros_like(equations.light(solution))
    return Certificate(
        float(np.abs(residual).max() / moments) if optimal else float("nan"),
        float(np.abs(missed).max() / moments),
        sums("at least")[:, 0] / lit,
        sums("at most")[:, 0] / lit,
        frame_sums(equations.model, content, dark, "content", coding)[:, 0],
        sent[:, 0],
        reached.share if reached else float("nan"),
        reached.loss_db if reached else float("nan"),
    )

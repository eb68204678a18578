"""How another program codes the columns and rows of a projector, and in which order it shows them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AxisDescription:
    """How columns or rows are coded: by phases of sinusoids, by Gray cells, or by both.

    Attributes
    ----------
    periods_px : of the sinusoids, in the order they are shown [px]; empty without sinusoids.
    shifts_rad : of the steps of every period; a pattern is 1/2 + 1/2 cos(2 pi x / period - shift).
    cell_px : columns or rows that share a Gray codeword; 0 without Gray patterns.
    inverses : whether every Gray pattern is also shown with black and white exchanged.
    """

    periods_px: tuple[float, ...] = ()
    shifts_rad: tuple[float, ...] = ()
    cell_px: int = 0
    inverses: bool = False


@dataclass(frozen=True, slots=True)
class CodeDescription:
    """A code of another program; `order` are the blocks of patterns as they are shown."""

    name: str
    columns: AxisDescription
    rows: AxisDescription
    order: tuple[str, ...] = ()

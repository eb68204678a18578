"""Reads the description of another program's structured-light code from a TOML file."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from procam.errors import InputError
from procam.files.toml import read_toml
from procam.model.code_description import AxisDescription, CodeDescription

Period = Annotated[FiniteFloat, Field(ge=2)]


class _Axis(BaseModel):
    """[columns] or [rows]."""

    model_config = ConfigDict(extra="forbid")
    periods_px: list[Period] = []
    steps: Annotated[int, Field(ge=3, le=32)] | None = None
    shifts_deg: list[FiniteFloat] = []
    gray_cell_px: Annotated[int, Field(ge=1, le=4096)] = 0
    inverses: bool = False


class _Code(BaseModel):
    model_config = ConfigDict(extra="forbid")
    columns: _Axis
    rows: _Axis
    order: list[str] = []


def load_code(path: Path) -> CodeDescription:
    """The code that a TOML file describes (docs/howto/foreign-codes.md).

    Raises
    ------
    InputError : no such file, no TOML, an unknown or missing key, or a value out of its bounds.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give the description of a code")
    try:
        table = _Code.model_validate(read_toml(path))
    except ValidationError as error:
        wrong = error.errors()[0]
        where = ".".join(str(part) for part in wrong["loc"])
        raise InputError(
            f"{path}: {where}: {wrong['msg'].lower()}; the keys are in docs/howto/foreign-codes.md"
        ) from error
    axes = (_axis(path, "columns", table.columns), _axis(path, "rows", table.rows))
    return CodeDescription(path.stem, *axes, tuple(table.order))


def _axis(path: Path, name: str, table: _Axis) -> AxisDescription:
    steps = bool(table.steps) + bool(table.shifts_deg)
    if not table.periods_px and not table.gray_cell_px:
        raise InputError(f"{path}: {name} needs periods_px, gray_cell_px, or both")
    if bool(table.periods_px) != bool(steps) or steps > 1:
        raise InputError(
            f"{path}: {name}: periods_px needs either steps or shifts_deg, and only with it"
        )
    if table.inverses and not table.gray_cell_px:
        raise InputError(f"{path}: {name}: inverses belong to Gray patterns; give gray_cell_px")
    count = table.steps or 0
    shifts = table.shifts_deg or [360 * step / count for step in range(count)]
    radians = tuple(float(np.radians(shift)) for shift in shifts)
    return AxisDescription(tuple(table.periods_px), radians, table.gray_cell_px, table.inverses)

"""The numbers of a venue's last closed loop, VENUE/loop/loop.json."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from procam.errors import FileFormatError
from procam.files.session_tables import first_finding, parse_object


class StoredLoop(BaseModel):
    """What `refine` has stored; `worse` and `unseen` are new since version 0.1.

    `session` is the one that the loop's calibration was solved from; residuals and noise are relative [rel].
    """

    model_config = ConfigDict(frozen=True)
    session: str | None = None
    residual: Annotated[list[FiniteFloat], Field(min_length=1)]
    noise_floor: FiniteFloat
    worse: str = ""
    unseen: tuple[FiniteFloat, FiniteFloat] | None = None


def read_loop(path: Path) -> StoredLoop | None:
    """The numbers of a loop; None if there was none.

    Raises
    ------
    FileFormatError
        The file is damaged.
    """
    if not path.is_file():
        return None
    document = parse_object(path, path.read_bytes())
    try:
        return StoredLoop.model_validate(document)
    except ValidationError as error:
        raise FileFormatError(
            f"{path} is damaged ({first_finding(error)}); delete it, and `procam refine` makes it again"
        ) from error

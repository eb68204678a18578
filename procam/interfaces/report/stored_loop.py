"""The numbers of a venue's last closed loop, VENUE/loop/loop.json."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from procam.files.session_tables import checked, parse_object


class StoredLoop(BaseModel):
    """What `refine` has stored; `worse` and `unseen` are new since version 0.1.

    `session` is the one that the loop's calibration was solved from; residuals, by iteration, and noise are
    relative [rel]. `unseen` has the residual before and after of a picture that it did not learn from.
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
    return checked(StoredLoop, document, path, "delete it, and `procam refine` makes it again")

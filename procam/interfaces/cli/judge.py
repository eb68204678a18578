"""`procam judge`: a calibration against the truth."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces import judge as judging
from procam.interfaces.cli._options import CalibrationArgument, Json
from procam.interfaces.cli._output import Output, as_dicts, exit_if_missed

EXAMPLE = "procam judge demo-run/calibrations/0001 demo-run/truth"


def judge(
    calibration: CalibrationArgument,
    truth: Annotated[Path, typer.Argument(help="The truth, in the same format.")],
    json: Json = False,
) -> None:
    """Compare a calibration with the truth; exit 1 if a figure misses its goal."""
    output = Output(json)
    figures = judging.judge(calibration, truth)
    output.table(figures)
    output.finish(as_dicts(figures))
    exit_if_missed(figures)

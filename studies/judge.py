"""`python -m studies.judge CALIBRATION TRUTH`: a calibration's figures; exit 1 if one misses its goal."""

import sys
from pathlib import Path

from procam.interfaces.cli._output import Output, exit_if_missed
from procam.interfaces.cli.main import main
from procam.interfaces.judge import judge


def run() -> None:
    figures = judge(*map(Path, sys.argv[1:3]))
    Output(as_json=False).table(figures)
    exit_if_missed(figures)


if __name__ == "__main__":
    main(run)

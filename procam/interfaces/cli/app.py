"""The command line's frame: the application, and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="procam",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Calibrate a projection dome with cameras, and take the light that bounces round it out "
    "of its pictures. Start with `procam demo`.",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of text.")]
SizeOption = Annotated[str, typer.Option(help="Projector size, such as 1280x800.")]
CodeOption = Annotated[str, typer.Option(help="micro-phase, gray or phase-heterodyne.")]
VenueArgument = Annotated[Path, typer.Argument(help="Venue folder with a venue.toml.")]
CalibrationArgument = Annotated[
    Path, typer.Argument(help="Calibration directory, such as VENUE/calibrations/0001.")
]

"""`procam track`: a folder from which a player compensates a show by itself."""

from pathlib import Path

from procam.interfaces.cli.output import Output
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.track import track_show


def run_track(
    calibration: Path, source: Path, out: Path, how: FrameSettings, output: Output
) -> None:
    """Write OUT for the show IN."""
    document = output.follow(track_show(calibration, source, out, how))
    output.say(
        f"{out} written: {document['frames']['count']} frames of {document['size']} px, "
        f"{len(document['numbers']['columns'])} numbers each; give the folder to the player, README.txt is "
        "for who programs it"
    )
    output.finish(document)

"""`procam venue prune`: the captures of old sessions deleted."""

from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.workflows.prune import prune_captures

EXAMPLE = "procam venue prune my-dome"


def prune(venue: VenueArgument, json: Json = False) -> None:
    """Delete captures that keep_sessions in venue.toml does not keep."""
    output, pruned = Output(json), prune_captures(load_venue(venue))
    gigabytes = sum(pruned.values()) / 1e9
    output.say(f"captures deleted: {', '.join(pruned) or 'nothing'}, {gigabytes:.2f} GB")
    output.finish({"sessions": list(pruned), "gigabytes": round(gigabytes, 4)})

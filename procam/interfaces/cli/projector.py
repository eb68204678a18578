"""`procam projector`: a projector's remote control."""

from typing import Annotated, Any

import typer

from procam.errors import InputError
from procam.files.history.record import recorded
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.workflows.venue_rig import open_projector_control

EXAMPLE = "procam projector my-dome north shutter closed"
ACTIONS = ("state", "on", "off", "input", "shutter", "hours")
SHUTTER = ("open", "closed")


def projector(
    venue: VenueArgument,
    name: Annotated[str, typer.Argument(metavar="ID", help="Projector's name in venue.toml.")],
    action: Annotated[str, typer.Argument(help="state, on, off, input, shutter or hours.")],
    value: Annotated[
        str, typer.Argument(help="open or closed for shutter; a source code for input.")
    ] = "",
    json: Json = False,
) -> None:
    """Query or control a projector over its serial remote control.

    No camera is needed, and nothing else of the venue but the projector.
    """
    loaded, output = load_venue(venue), Output(json)
    with recorded(venue, "projector"), open_projector_control(loaded, name) as control:
        document = _act(control, action, value)
    for key, shown in document.items():
        output.say(f"{key:>12}  {shown}")
    output.finish(document)


def _act(control: Any, action: str, value: str) -> dict[str, Any]:
    if action not in ACTIONS:
        raise InputError(f"action {action!r} is unknown; choose one of {', '.join(ACTIONS)}")
    if action in ("on", "off"):
        control.set_power(action == "on")
    elif action == "input":
        control.set_input(value)
    elif action == "shutter":
        if value not in SHUTTER:
            raise InputError(f"shutter {value!r} is unknown; choose {' or '.join(SHUTTER)}")
        control.set_shutter(value == "closed")
    state = control.state()
    if action == "hours":
        return {"lamp_hours": state.lamp_hours}
    return {
        "power": str(state.power),
        "shuttered": state.shuttered,
        "source": state.source,
        "lamp_hours": state.lamp_hours,
        "errors": list(state.errors),
    }

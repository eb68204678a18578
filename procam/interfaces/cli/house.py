"""`procam state`: the house with its audience and its own lamps, beside the calibrated one."""

from pathlib import Path

from procam.files import atomic
from procam.files.calibration import (
    latest_calibration,
    load_calibration,
    next_directory,
    save_calibration,
)
from procam.files.venue.load import load_venue
from procam.interfaces.cli.output import Output
from procam.model.venue_state import VenueState
from procam.workflows.audience import measure_state, with_state
from procam.workflows.venue_rig import open_rig


def run_state(directory: Path, name: str, ambient_only: bool, output: Output) -> None:
    """`procam state`."""
    venue = load_venue(directory)
    calibration = load_calibration(latest_calibration(directory))
    with atomic.locked(directory / "sessions"), open_rig(venue) as rig:
        data = output.follow(measure_state(rig, venue, calibration, name, ambient_only))
    state: VenueState = data["state"]
    out = next_directory(directory)
    save_calibration(with_state(calibration, state), out)
    low, high = state.feedback.interval()
    ambient = [float(v) for v in data["ambient"]]
    output.say(f"{out} written, with house state {name}")
    rows = zip("RGB", state.feedback.value, low, high, state.scatter_ratio, ambient, strict=True)
    for channel, m, least, most, ratio, light in rows:
        output.say(
            f"  {channel}  feedback {m:.4f} ({least:.4f} .. {most:.4f}), {ratio:.1%} of the "
            f"calibration's; the room's own light {light:.2%} of white"
        )
    output.finish(
        {
            "calibration": str(out),
            "state": name,
            "feedback": state.feedback.value.tolist(),
            "feedback_sigma": state.feedback.sigma.tolist(),
            "scatter_ratio": state.scatter_ratio.tolist(),
            "ambient": ambient,
        }
    )

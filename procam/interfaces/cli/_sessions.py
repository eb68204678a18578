"""What the commands share that refine a venue."""

from pathlib import Path

from procam.files.calibration import next_directory, save_calibration, use_calibration
from procam.interfaces.cli._output import Output
from procam.workflows.refine.refine import Refined

CONTENT_SIZE = 1024  # edge of the sample picture [px]


def keep_refined(directory: Path, kept: Path, refined: Refined, output: Output) -> Path:
    """Write the loop's calibration if it is better than the one at `kept`; returns the newest one."""
    if refined.worse:
        output.say(f"nothing written, {kept} stays newest: {refined.worse}")
        return kept
    if not refined.better:
        found = "no picture got better" if refined.corrections else "nothing to correct"
        output.say(f"{found}, {kept} stays newest")
        return kept
    out = next_directory(directory)
    save_calibration(refined.calibration, out)
    use_calibration(directory, out)
    output.say(f"{out} written")
    return out

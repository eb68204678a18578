"""Commands that work on a venue and its devices."""

from pathlib import Path
from typing import Any

import typer

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import (
    latest_calibration,
    load_calibration,
    next_directory,
    save_calibration,
)
from procam.files.session import Session
from procam.files.venue.load import BY_HAND, Venue, load_venue, template_text
from procam.interfaces.cli.dry_run import run_dry
from procam.interfaces.cli.output import Output
from procam.interfaces.judge import failed
from procam.workflows.capture import capture as capturing
from procam.workflows.refine.refine import Refined, refine
from procam.workflows.refine.shown import keep_loop, keep_pictures, read_square
from procam.workflows.sample_content import half_sky
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import open_rig

CONTENT_SIZE = 1024


def run_init(directory: Path, template: str, output: Output) -> None:
    """`procam init`."""
    text = template_text(template)
    path = directory / "venue.toml"
    if path.exists():
        raise InputError(f"{path}: got an existing file, expected none; choose another folder")
    atomic.write_text(path, text)
    by_hand = any(c.backend == BY_HAND for c in load_venue(directory).table.cameras.values())
    first = f"patterns {directory} --out PICTURES" if by_hand else f"capture {directory} --dry-run"
    output.say(f"{path} written; edit it, then run: procam {first}")
    output.finish({"venue": str(path)})


def run_capture(directory: Path, dry_run: bool, output: Output) -> None:
    """`procam capture`."""
    venue = load_venue(directory)
    if dry_run:
        run_dry(venue, output)
        return
    session = take(venue, output)
    output.say(f"captured; now run: procam solve {session.directory}")
    output.finish({"session": str(session.directory)})


def run_solve(directory: Path, output: Output) -> Path:
    """`procam solve`."""
    venue = load_venue(venue_of(directory))
    data = output.follow(solve(venue, Session(directory)))
    calibration = load_calibration(Path(data["calibration"]))
    output.say(f"{data['calibration']} written")
    output.table(calibration.quality)
    notes = output.notes(calibration)
    output.finish({"calibration": data["calibration"], "notes": notes})
    return Path(data["calibration"])


def run_calibrate(directory: Path, output: Output) -> None:
    """`procam calibrate`."""
    from procam.interfaces.report import write_report

    venue = load_venue(directory)
    session = take(venue, output)
    data = output.follow(solve(venue, session))
    calibration = load_calibration(Path(data["calibration"]))
    keep_pictures(directory, calibration, half_sky(CONTENT_SIZE))
    report = write_report(directory)
    output.say(f"{data['calibration']} and {report} written")
    document = {"calibration": data["calibration"], "report": str(report)}
    output.finish({**document, "notes": output.notes(calibration)})


def run_refine(directory: Path, picture: Path | None, output: Output) -> None:
    """`procam refine`; exit 1 if something got worse, and then the old calibration stays newest."""
    venue = load_venue(directory)
    kept = latest_calibration(directory)
    calibration = load_calibration(kept)
    content = read_square(picture) if picture else half_sky(CONTENT_SIZE)
    with open_rig(venue) as rig:
        rig.start()
        refined: Refined = output.follow(refine(rig, calibration, content))["refined"]
    keep_pictures(directory, calibration, content)
    keep_loop(directory, refined)
    figures = {n: f.as_dict() for n, f in refined.figures().items()}
    output.table(refined.figures())
    newest = keep_refined(directory, kept, refined, output)
    document = {"calibration": str(newest), "figures": figures}
    output.finish(document | ({"worse": refined.worse} if refined.worse else {}))
    if refined.worse or failed(refined.figures()):
        raise typer.Exit(1)


def keep_refined(directory: Path, kept: Path, refined: Refined, output: Output) -> Path:
    """Write what a loop made of the calibration `kept`, if it is better; the newest one then."""
    if refined.worse:
        output.say(f"nothing written, {kept} stays newest: {refined.worse}")
        return kept
    if not refined.corrections:
        output.say(f"nothing to correct, {kept} stays newest")
        return kept
    out = next_directory(directory)
    save_calibration(refined.calibration, out)
    output.say(f"{out} written")
    return out


def run_projector(directory: Path, name: str, action: str, value: str, output: Output) -> None:
    """`procam projector`."""
    venue = load_venue(directory)
    if name not in venue.table.projectors:
        raise InputError(
            f"projector: got {name!r}, expected one of {', '.join(venue.table.projectors)}"
        )
    rig = open_rig(venue)
    try:
        if name not in rig.controls:
            raise InputError(
                f"projector {name}: got no control table in venue.toml, expected "
                'control = { protocol = "escvp21", port = "/dev/ttyUSB0" }'
            )
        document = _tell(rig.controls[name], action, value)
    finally:
        rig.release()
    for key, shown in document.items():
        output.say(f"{key:>12}  {shown}")
    output.finish(document)


def take(venue: Venue, output: Output) -> Session:
    """Capture into the newest unfinished session, or a new one."""
    with atomic.locked(venue.directory / "sessions"), open_rig(venue) as rig:
        session = capturing.prepare_session(venue, open_session(venue))
        output.follow(capturing.capture(rig, venue, session))
    return session


def open_session(venue: Venue) -> Path:
    """The newest session if it is unfinished, else the next number."""
    folder = venue.directory / "sessions"
    known = sorted(p for p in folder.glob("[0-9]*") if p.is_dir())
    if known:
        session = Session(known[-1])
        if not (known[-1] / "plan.json").is_file():
            return known[-1]
        if capturing.missing_shots(session, session.read_plan(), list(venue.cameras)):
            return known[-1]
    return folder / f"{len(known) + 1:04d}"


def venue_of(session: Path) -> Path:
    """The venue folder of VENUE/sessions/ID."""
    folder = session.resolve().parent
    if folder.name != "sessions":
        raise InputError(f"session: got {session}, expected a folder such as VENUE/sessions/0001")
    return folder.parent


def _tell(control: Any, action: str, value: str) -> dict[str, Any]:
    if action in ("on", "off"):
        control.set_power(action == "on")
    elif action == "input":
        control.set_input(value)
    elif action == "shutter":
        if value not in ("open", "closed"):
            raise InputError(f"shutter: got {value!r}, expected open or closed")
        control.set_shutter(value == "closed")
    elif action not in ("state", "hours"):
        raise InputError(
            f"action: got {action!r}, expected state, on, off, input, shutter or hours"
        )
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

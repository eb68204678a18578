"""`procam doctor`: a check of all devices of a venue before a capture session."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from procam.errors import DeviceError, InputError
from procam.files.history.record import recorded
from procam.files.venue.load import Venue, load_venue
from procam.interfaces.cli._options import Json, ReplaceRound, VenueArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.interfaces.cli._rounds import ask_for_photographs, given_photographs
from procam.workflows.capture.decoded import with_decoded_bits
from procam.workflows.capture.ingest import named_camera
from procam.workflows.doctor.behaviour_by_hand import examine_behaviour_by_hand
from procam.workflows.doctor.doctor import examine
from procam.workflows.doctor.findings import Behaviour, Diagnosis, Finding
from procam.workflows.doctor.photographs import examine_photographs
from procam.workflows.photographs.open import (
    Given,
    hand_photographer,
    is_by_hand,
    refuse_mixed,
)
from procam.workflows.photographs.orders import PhotographsWanted
from procam.workflows.venue_rig import open_rig

EXAMPLE = "procam doctor my-dome --behaviour"
COLUMNS = (
    "projector  camera     peak  exposure_s  darkest SNR  bracket_s            lit    error px"
    "  gamma  halves"
)


def doctor(
    venue: VenueArgument,
    behaviour: Annotated[
        bool,
        typer.Option(
            "--behaviour",
            help="Also test each projector for settings that break calibration, such as dynamic "
            "black or white boost: 24 more photographs and two minutes each.",
        ),
    ] = False,
    photos: Annotated[
        Path | None,
        typer.Option(
            help="By hand: folder of test photographs of pictures of `procam session plan`: of each "
            "projector white, black and two stripes, and one of the dark. With --behaviour: those asked for."
        ),
    ] = None,
    replace: ReplaceRound = False,
    camera: Annotated[str, typer.Option(help="By hand: camera that takes the photographs.")] = "",
    json: Json = False,
) -> None:
    """Check that every device of a venue can be reached, exposed and resolved; exit 1 if not.

    Photographs each projector about five times, prints what to set, and leaves the projectors dark.
    """
    loaded, output = load_venue(venue), Output(json, RunLog(venue, "doctor"))
    diagnosis = Diagnosis()
    given = given_photographs(photos, replace)
    if behaviour and is_by_hand(loaded):
        _behaviour_by_hand(loaded, camera, given, diagnosis, output)
        return
    if behaviour:
        refuse_mixed(loaded)
    if replace and not behaviour:
        raise InputError("--replace: goes with --behaviour; test photographs are not stored")
    if behaviour and given:
        raise InputError(
            "--photos: with --behaviour it is for venues whose devices are all driven by hand; leave it out"
        )
    if photos is not None:
        output.follow(examine_photographs(loaded, camera, photos, diagnosis))
        _finish(diagnosis, output)
        return
    if camera:
        raise InputError(
            "--camera: it is for photographs by hand; leave it out, or give --photos too"
        )
    reached = False
    try:
        with recorded(venue, "doctor"), open_rig(loaded) as rig:
            reached = True
            output.follow(examine(rig, loaded, diagnosis, behaviour=behaviour))
    except DeviceError as error:
        diagnosis.keep(Finding("rig", "lit" if reached else "closed", str(error)))
    _finish(diagnosis, output)


def _behaviour_by_hand(
    venue: Venue, camera: str, given: Given | None, diagnosis: Diagnosis, output: Output
) -> None:
    """Ask for photographs of test pictures, a projector after the other, and judge them."""
    model = named_camera(with_decoded_bits(venue), camera)
    with recorded(venue.directory, "doctor"):
        try:
            with hand_photographer(venue, model, None, "behaviour", camera, given) as photographer:
                output.warn(photographer.notes)
                examine_behaviour_by_hand(photographer, venue, model, diagnosis)
        except PhotographsWanted as wanted:
            for name, behaviour in diagnosis.behaviour.items():
                for line in _behaviour_lines(name, behaviour):
                    output.say(line)
            command = ["procam", "doctor", str(venue.directory), "--behaviour"]
            ask_for_photographs(wanted, [*command, "--camera", camera], output, "it")
            return
    _finish(diagnosis, output)


def _finish(diagnosis: Diagnosis, output: Output) -> None:
    """Print what was found; exit 1 if anything is wrong."""
    for line in _lines(diagnosis):
        output.say(line)
    output.finish(diagnosis.as_dict())
    if diagnosis.findings:
        raise typer.Exit(1)


def _behaviour_lines(projector: str, behaviour: Behaviour) -> Iterator[str]:
    yield ""
    yield f"settings of {projector:10} as {behaviour.camera} sees it   sigma   limit"
    for effect in behaviour.effects:
        verdict = "  WRONG" if effect.found else ""
        yield (
            f"  {effect.name:20} {effect.value:+13.2%}  {effect.sigma:10.2%}  {effect.limit:6.1%}{verdict}"
        )
    yield from (f"  note: {why}" for why in behaviour.untested)


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _lines(diagnosis: Diagnosis) -> Iterator[str]:
    for name, state in diagnosis.controls.items():
        hours = "" if state["lamp_hours"] is None else f", {state['lamp_hours']} lamp hours"
        yield f"projector {name}: {state['power']}, input {state['source'] or 'unknown'}{hours}"
    for name, camera in diagnosis.cameras.items():
        response = ", ".join(f"x{2**e:.3f}" for e in camera.exponents)
        yield (
            f"camera {name}: black level {camera.black_level_dn:.1f}, room light "
            f"{camera.ambient_per_s:.2g} full scale/s"
            + (f", twice the exposure {response}" if response else "")
        )
    if diagnosis.views:
        yield ""
        yield COLUMNS
    for (projector, name), view in diagnosis.views.items():
        plan = view.plan
        bracket = " ".join(f"{e:g}" for e in plan.bracket_s)
        error = f"{plan.column_sigma_px:.2f}..{plan.column_sigma_darkest_px:.2f}"
        yield (
            f"{projector:10} {name:10} {view.peak:4.0%}  {plan.exposure_s:10g}  {plan.snr:11.1f}  "
            f"{bracket:19} {plan.lit_share:5.1%}  {error:>9}  {_or_dash(view.gamma, '.2f'):>5}  "
            f"{_or_dash(view.additivity, '.1%'):>6}"
        )
    for projector, behaviour in diagnosis.behaviour.items():
        yield from _behaviour_lines(projector, behaviour)
    yield ""
    # room light would pass for black light
    if diagnosis.capture() and all(f.kind != "ambient" for f in diagnosis.findings):
        yield f"[capture] for all: {diagnosis.lines()}"
    yield from (f"WRONG  {finding}" for finding in diagnosis.findings)
    count = len(diagnosis.findings)
    verdict = f"{count} finding{'s' * (count > 1)}" if count else "all is well"
    yield f"{diagnosis.photographs} photographs, {verdict}"

"""Makes the folder of a preference test: pictures, a page that asks, and the plan."""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from procam import __version__
from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import load_dome
from procam.files.images.stills import square_edge
from procam.workflows.events import Event, Steps
from procam.workflows.playout.compensate import run_key
from procam.workflows.playout.frame import FrameSettings, named_transfer, require_photometry
from procam.workflows.playout.sources import ClipFrame, first_frame
from studies.preference.pictures import PictureMaker
from studies.preference.plan import PAGE, PLAN, Picture, Plan, Question
from studies.preference.wanted import Wanted

ID_LETTERS, SEED_LETTERS = 12, 8  # hexadecimal: 8 of them are 32 bits
Render = Callable[[Mapping[str, Any]], str]


def make_kit(
    calibration_dir: Path, out: Path, wanted: Wanted, command: str, render: Render
) -> Steps[tuple[Plan, list[str]]]:
    """Write OUT: page.html, plan.json, pictures/HASH.png; an event per picture.

    The plan and notes are returned. OUT appears when all of it is there. `render`
    makes the page of what `Plan.for_page` gives.

    Raises
    ------
    InputError
        OUT is not empty, or a picture or the calibration cannot be used.
    """
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise InputError(f"{out} exists already and is not empty; choose a new folder for OUT")
    calibration = load_dome(calibration_dir)
    require_photometry(calibration)
    key = _key(calibration_dir, wanted)
    total = len(wanted.pictures) * len(wanted.needed)
    yield Event("pictures", 0, total, "")
    with atomic.replacing_directory(out) as folder:
        maker = PictureMaker(calibration, wanted, key, folder)
        for name, path in content_names(wanted.pictures).items():
            for what in maker.make(name, path, first_frame(path)):
                yield Event("pictures", len(maker.pictures), total, what)
        plan = _plan(calibration_dir, wanted, command, key, maker)
        atomic.write_text(folder / PLAN, plan.to_json())
        atomic.write_text(folder / PAGE, render(plan.for_page()))
    yield Event("pictures", total, total, str(out))
    return plan, maker.notes


def content_names(paths: Sequence[Path]) -> dict[str, Path]:
    """A name for each picture: its file's without the suffix, with a number where that is taken.

    >>> list(content_names([Path("a/sky.png"), Path("b/sky.exr"), Path("sky-2.png")]))
    ['sky', 'sky-2', 'sky-2-2']
    """
    named = dict[str, Path]()
    for path in paths:
        stem = name = path.stem or path.resolve().name
        number = 1
        while name in named:
            number += 1
            name = f"{stem}-{number}"
        named[name] = path
    return named


def _key(calibration_dir: Path, wanted: Wanted) -> str:
    """A digest of all that makes two tests the same; so equal tests have equal file names and ids.

    All pictures are read for it before any is compensated: a wrong one should not cost minutes.
    """
    asked = [*wanted.methods, str(wanted.repeats), str(wanted.on_dome)]
    digest = hashlib.sha256(run_key(calibration_dir, wanted.settings).encode())
    digest.update(json.dumps([asked, list(content_names(wanted.pictures))]).encode())
    for path in wanted.pictures:
        digest.update(_checked(first_frame(path), wanted.settings).rgb.tobytes())
    return digest.hexdigest()


def _checked(clip_frame: ClipFrame, settings: FrameSettings) -> ClipFrame:
    square_edge(clip_frame.rgb, clip_frame.name)
    named_transfer(clip_frame, settings)
    return clip_frame


def _plan(
    calibration_dir: Path, wanted: Wanted, command: str, key: str, maker: PictureMaker
) -> Plan:
    settings = wanted.settings
    return Plan(
        id=key[:ID_LETTERS],
        version=__version__,
        command=command,
        calibration=calibration_dir.resolve().name,
        on_dome=wanted.on_dome,
        settings={
            "state": settings.state,
            "white": settings.white,
            "transfer": settings.transfer,
            "db": settings.db,
            "white_nits": settings.white_nits,
        },
        methods=wanted.methods,
        pairs=wanted.pairs,
        catch=wanted.catch,
        repeats=wanted.repeats,
        seed=int(key[-SEED_LETTERS:], 16),
        contents=tuple(maker.contents),
        pictures=maker.pictures,
        questions=tuple(_questions(wanted, maker.pictures)),
    )


def _questions(wanted: Wanted, pictures: Mapping[str, Picture]) -> Iterator[Question]:
    """Each pair on each content, then a catch trial on each."""
    files = {(picture.content, picture.method): file for file, picture in pictures.items()}
    asked = [(pair, wanted.repeats) for pair in wanted.pairs]
    caught = [(wanted.catch, 1)] if wanted.catch else []
    for name in dict.fromkeys(picture.content for picture in pictures.values()):
        for number, ((first, second), times) in enumerate([*asked, *caught]):
            yield Question(
                content=name,
                pictures=(files[name, first], files[name, second]),
                times=times,
                catch=number >= len(asked),
            )

"""`procam decode`: plain structured light with a folder of photographs."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from procam.arrays import Array32
from procam.errors import CalibrationError, FileFormatError, InputError
from procam.estimate.structured_light.codes import DEFAULT_CODE, Code
from procam.estimate.structured_light.consistency import probe_places
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.described import folder_order
from procam.estimate.structured_light.limits import DecodeLimits, default_limits
from procam.estimate.structured_light.panel_checks import panel_notes
from procam.estimate.structured_light.panel_map import drop_inconsistent, fit_projector_map
from procam.estimate.structured_light.set_checks import SetReport, examine
from procam.files.images.layers import write_channels
from procam.files.images.pixels import write_image
from procam.interfaces.cli._codes import chosen_code, count_refusal
from procam.interfaces.cli._options import CodeOption, Json, OrderOption, SizeOption
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import SUFFIXES, Picture, check_out, panel_size, read_grey
from procam.interfaces.plots.correspondence import draw_map
from procam.model.correspondence import CorrespondenceMap, ProjectorMap

EXAMPLE = "procam decode photos --size 1024x768 --code gray --out map.exr"
Limits = tuple[float | None, float | None]  # white - black, contrast [counts]; None: automatic


def decode(
    images: Annotated[
        Path,
        typer.Argument(
            help="Folder of photographs, sorted by name as the pictures of procam patterns: white, "
            "black, sinusoids; or for stripes, as OpenCV's, column bits (finest last) as pattern, "
            "inverse; row bits; white; black. --order names another order."
        ),
    ],
    *,
    size: SizeOption,
    out: Annotated[Path, typer.Option(help="EXR map: projector.x, projector.y, sigma.")],
    code: CodeOption = DEFAULT_CODE,
    order: OrderOption = "",
    white_black: Annotated[
        float | None, typer.Option(help="Least white - black [counts]; automatic if not given.")
    ] = None,
    contrast: Annotated[
        float | None, typer.Option(help="Least |pattern - inverse| [counts]; automatic.")
    ] = None,
    json: Json = False,
) -> None:
    """Decode a folder of structured-light photographs; needs no venue.

    Writes the map, a picture of it (-look.png), and the map of the panel (-panel.exr) beside it.
    """
    output, layout = Output(json), chosen_code(code, panel_size(size), order)
    look, side = (out.with_name(f"{out.stem}{end}") for end in ("-look.png", "-panel.exr"))
    _check_outputs(images, out, look, side)
    found, panel, notes = decode_folder(images, layout, (white_black, contrast))
    if not found.valid.any():
        raise CalibrationError(
            f"{images}: no pixel decodes as {code} on {size}; are size, code and order right?"
        )
    xy, sigma = found.projector_xy, np.sqrt(np.mean(found.sigma_px**2, axis=-1))
    write_channels(out, {"projector.x": xy[..., 0], "projector.y": xy[..., 1], "sigma": sigma})
    write_image(look, draw_map(found, layout.size))
    write_channels(side, _panel_channels(panel))
    share, middle = float(found.valid.mean()), float(np.nanmedian(sigma))
    for note in notes:
        output.say(note)
    output.say(
        f"{out} written; {int(found.valid.sum())} pixels decoded, {share:.1%} of the picture, "
        f"standard error {middle:.2f} px; {look} shows it"
    )
    output.say(
        f"{side} written; where the camera sees patches of {panel.patch_px}x{panel.patch_px} projector "
        f"pixels, {panel.valid.mean():.1%} of them"
    )
    output.finish(
        {
            "out": str(out),
            "look": str(look),
            "panel": str(side),
            "patch_px": panel.patch_px,
            "decoded": int(found.valid.sum()),
            "share": share,
            "sigma_px": middle,
            "notes": notes,
        }
    )


def decode_folder(
    folder: Path, code: Code, limits: Limits
) -> tuple[CorrespondenceMap, ProjectorMap, list[str]]:
    """The camera's map and the panel's map of a folder of pictures, and notes on what is unusual.

    Limits that are given switch all other cleaning off.
    """
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: there is no such folder; give one with photographs")
    files = sorted(
        (p for p in folder.glob("*") if p.suffix.lower() in SUFFIXES and p.is_file()), key=_in_order
    )
    if abs(len(files) - len(code.planes)) > 1:
        raise FileFormatError(count_refusal(folder, len(files), code))
    verdict = _matched(files, code)
    shown = [None if i is None else files[i] for i in verdict.order]
    assert shown[0] is not None and shown[1] is not None
    white, black = read_grey(shown[0]), read_grey(shown[1])
    decoder = Decoder(code, _limits(limits, white, black))
    decoder.add(0, white)
    decoder.add(1, black)
    for plane, path in enumerate(shown):
        if plane > 1 and path is not None:
            decoder.add(plane, read_grey(path))
    decoded = decoder.result()
    found, panel = decoded.map, fit_projector_map(decoded.map, code.size)
    if limits == (None, None):
        found = drop_inconsistent(found, panel)
    return found, panel, [*verdict.notes, *decoded.notes, *panel_notes(code, found)]


def _check_outputs(folder: Path, out: Path, *others: Path) -> None:
    if out.resolve().parent == folder.resolve():
        raise InputError(f"{out}: lies among the photographs; choose another folder for it")
    check_out(out, ".exr")
    for path in others:
        if path.exists() and not out.exists():
            raise InputError(
                f"{path} exists already, without a map of the same name; choose another name for --out"
            )


def _panel_channels(panel: ProjectorMap) -> dict[str, Array32]:
    return {
        "camera.x": panel.camera_px[..., 0],
        "camera.y": panel.camera_px[..., 1],
        "sigma": panel.sigma_px,
        "coverage": panel.coverage,
    }


def _matched(files: list[Path], code: Code) -> SetReport:
    """Which file shows which plane; files of another size than most are left out."""
    pictures = ((path, read_grey(path)) for path in files)
    seen = [
        (path, _kind(picture), picture[probe_places(picture.shape)]) for path, picture in pictures
    ]
    kinds = [kind for _, kind, _ in seen]
    usual = max(set(kinds), key=kinds.count)
    notes = [
        f"{path.name}: {kind}, unlike most, which are {usual}; left out"
        for path, kind, _ in seen
        if kind != usual
    ]
    same = [path for path, kind, _ in seen if kind == usual]
    probes = [probe for _, kind, probe in seen if kind == usual]
    verdict = examine(code, folder_order(code), probes, [path.name for path in same])
    order = [None if i is None else files.index(same[i]) for i in verdict.order]
    return SetReport(order, notes + verdict.notes)


def _kind(picture: Picture) -> str:
    height, width = picture.shape
    return f"{width}x{height} px of {picture.dtype.name}"


def _limits(asked: Limits, white: Picture, black: Picture) -> DecodeLimits:
    automatic = default_limits(white, black)
    if asked == (None, None):
        return automatic
    for name, value in zip(("white-black", "contrast"), asked, strict=True):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(f"--{name} is {value}; it must be a number of counts, 0 or more")
    return replace(
        automatic,
        white_black=automatic.white_black if asked[0] is None else asked[0],
        contrast=automatic.contrast if asked[1] is None else asked[1],
        lit_share=0.0,
        neighbours=False,
    )


def _in_order(path: Path) -> list[str | int]:
    """Sorts img_2 before img_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]

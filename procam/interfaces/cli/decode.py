"""`procam decode`: plain structured light with a folder of photographs."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from procam.arrays import Array32
from procam.errors import CalibrationError, FileFormatError, InputError
from procam.estimate.structured_light.codes import DEFAULT_CODE, Code
from procam.estimate.structured_light.consistency import probe_places
from procam.estimate.structured_light.decode import Decoded, Decoder
from procam.estimate.structured_light.described import folder_order, unseen_errors
from procam.estimate.structured_light.exposures import scaled
from procam.estimate.structured_light.gaps import count_fits, missing_as_cause
from procam.estimate.structured_light.limits import (
    DecodeLimits,
    default_limits,
    dropped_samples,
)
from procam.estimate.structured_light.panel_checks import orientation, panel_notes
from procam.estimate.structured_light.panel_map import drop_inconsistent, fit_projector_map
from procam.estimate.structured_light.set_checks import SetReport, examine
from procam.files.images.layers import write_channels
from procam.files.images.photos import in_order
from procam.files.images.pixels import write_image
from procam.interfaces.cli._codes import chosen_code, count_refusal
from procam.interfaces.cli._options import CodeOption, Json, OrderOption, SizeOption
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import SUFFIXES, Picture, check_out, panel_size, read_grey
from procam.model.correspondence import CorrespondenceMap, ProjectorMap

EXAMPLE = "procam decode photos map.exr --size 1024x768 --code gray"
LINES = 16  # of the grid in the picture of a map, over the longer side of the panel
HOLE = 24  # grey of holes in it
Limits = tuple[float | None, float | None]  # white - black, contrast [counts]; None: automatic


def decode(
    images: Annotated[
        Path,
        typer.Argument(
            help="Folder of photographs, sorted by name as the pictures of `procam lens patterns`: white, "
            "black, sinusoids; or for stripes, as OpenCV's, column bits (finest last) as pattern, "
            "inverse; row bits; white; black. --order names another order."
        ),
    ],
    out: Annotated[
        Path, typer.Argument(metavar="OUT.exr", help="Map: projector.x, projector.y, sigma.")
    ],
    *,
    size: SizeOption,
    code: CodeOption = DEFAULT_CODE,
    order: OrderOption = "",
    white_black: Annotated[
        float | None, typer.Option(help="Least white - black in counts; automatic if not given.")
    ] = None,
    contrast: Annotated[
        float | None,
        typer.Option(help="Least |pattern - inverse| in counts; automatic if not given."),
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Decode a set that a check of its pictures refuses.")
    ] = False,
    json: Json = False,
) -> None:
    """Decode a folder of structured-light photographs; needs no venue.

    Writes the map, a picture of it (-look.png), and the map of the panel (-panel.exr) beside it.
    """
    output, layout = Output(json), chosen_code(code, panel_size(size), order)
    look, side = (out.with_name(f"{out.stem}{end}") for end in ("-look.png", "-panel.exr"))
    _check_outputs(images, out, look, side)
    found, panel, notes = decode_folder(images, layout, (white_black, contrast), anyway=anyway)
    if not found.valid.any():
        raise CalibrationError(
            f"{images}: no pixel decodes as {code} on {size}; are size, code and order right?"
        )
    xy, sigma = found.projector_xy, np.sqrt(np.mean(found.sigma_px**2, axis=-1))
    write_channels(out, {"projector.x": xy[..., 0], "projector.y": xy[..., 1], "sigma": sigma})
    write_image(look, draw_map(found, layout.size))
    write_channels(side, _panel_channels(panel))
    for note in notes:
        output.say(note)
    figures = _figures(found, panel, sigma)
    output.say(
        f"{out} written; {figures['decoded']} pixels decoded, {figures['share']:.1%} of the picture, "
        f"standard error {figures['sigma_px']:.2f} px; {look} shows it"
    )
    output.say(
        f"{side} written; where the camera sees patches of {panel.patch_px}x{panel.patch_px} projector "
        f"pixels, {panel.valid.mean():.1%} of them"
    )
    files = {"out": str(out), "look": str(look), "panel": str(side)}
    output.finish(files | figures | {"notes": notes})


def _figures(found: CorrespondenceMap, panel: ProjectorMap, sigma: Array32) -> dict[str, float]:
    """How much was decoded, and how well."""
    return {
        "patch_px": panel.patch_px,
        "decoded": int(found.valid.sum()),
        "share": float(found.valid.mean()),
        "sigma_px": float(np.nanmedian(sigma)),
    }


def draw_map(found: CorrespondenceMap, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Colours (H, W, 3): red grows to the panel's right, green downwards; a grid every 1/16.

    The cells of a sound map are straight and of one colour each; holes are dark grey.
    """
    xy = np.where(found.valid[..., None], found.projector_xy, 0.0)
    share = np.clip(xy / np.maximum(np.array(size) - 1.0, 1.0), 0, 1)
    colour = np.stack([share[..., 0], share[..., 1], 1 - share.mean(axis=-1)], axis=-1)
    cell = max(size) / LINES
    # a line runs where neighbours lie in different cells
    index = np.floor(xy / cell)
    line = np.zeros(found.valid.shape, bool)
    line[:, 1:] |= (index[:, 1:] != index[:, :-1]).any(axis=-1)
    line[1:, :] |= (index[1:] != index[:-1]).any(axis=-1)
    colour = np.where(line[..., None], 1.0, 0.15 + 0.7 * colour)
    picture = np.where(found.valid[..., None], 255 * colour, HOLE)
    return np.asarray(np.rint(picture), np.uint8)


def decode_folder(
    folder: Path, code: Code, limits: Limits, *, anyway: bool = False
) -> tuple[CorrespondenceMap, ProjectorMap, list[str]]:
    """The camera's map and the panel's map of a folder of pictures, and notes on what is unusual.

    Limits that are given switch all other cleaning off. With `anyway` the checks of what the pictures show
    are overruled; the notes say which.
    """
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: there is no such folder; give one with photographs")
    files = sorted(
        (p for p in folder.glob("*") if p.suffix.lower() in SUFFIXES and p.is_file()), key=in_order
    )
    if not count_fits(len(code.planes), [path.name for path in files]):
        raise FileFormatError(count_refusal(folder, len(files), code))
    verdict = _matched(files, code, anyway)
    decoded = _decoded(files, code, limits, verdict)
    mirrored, mixed = orientation(code, decoded.map)
    refused = [*decoded.refused, *mixed]
    if refused and not anyway:
        raise InputError(refused[0] + missing_as_cause(verdict.notes))
    found, panel = decoded.map, fit_projector_map(decoded.map, code.size)
    if limits == (None, None):
        found = drop_inconsistent(found, panel)
    refused = [*verdict.refused, *refused]
    overruled = [f"decoded anyway, though a check refuses it: {why}" for why in refused]
    notes = [*overruled, *verdict.notes, *decoded.notes, *mirrored, *unseen_errors(code)]
    return found, panel, notes + panel_notes(code, found)


def _decoded(files: list[Path], code: Code, limits: Limits, verdict: SetReport) -> Decoded:
    """The photographs in the order that was found, all with the exposure of white."""
    shown = {plane: i for plane, i in enumerate(verdict.order) if i is not None}
    white, black = read_grey(files[shown[0]]), read_grey(files[shown[1]])
    if not verdict.levels:
        for picture in map(read_grey, (files[i] for i in shown.values())):
            white, black = np.maximum(white, picture), np.minimum(black, picture)
    levels = (white, black)
    accepted = _limits(limits, white, black)
    if not verdict.gains:
        decoder = Decoder(code, accepted)
        for plane, i in shown.items():
            decoder.add(plane, levels[plane] if plane < 2 else read_grey(files[i]))
        return decoder.result()
    # samples that cannot be used are NaN, for scaled ones have other limits
    decoder = Decoder(code, replace(accepted, saturated=None, dark=None))
    for plane, i in shown.items():
        picture = read_grey(files[i])
        lost = dropped_samples(picture, accepted) & (code.planes[plane].kind == "sine")
        same = scaled(picture, black, verdict.gains.get(i, 1.0))
        decoder.add(plane, np.where(lost, np.float32(np.nan), same))
    return decoder.result()


def _check_outputs(folder: Path, out: Path, *others: Path) -> None:
    if out.resolve().parent == folder.resolve():
        raise InputError(f"{out}: lies among the photographs; choose another folder for it")
    check_out(out, ".exr", option="OUT")
    for path in others:
        if path.exists() and not out.exists():
            raise InputError(
                f"{path} exists already, without a map of the same name; choose another name for OUT"
            )


def _panel_channels(panel: ProjectorMap) -> dict[str, Array32]:
    return {
        "camera.x": panel.camera_px[..., 0],
        "camera.y": panel.camera_px[..., 1],
        "sigma": panel.sigma_px,
        "coverage": panel.coverage,
    }


def _matched(files: list[Path], code: Code, anyway: bool) -> SetReport:
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
    names = [path.name for path in same]
    verdict = examine(code, folder_order(code), probes, names, anyway=anyway)
    order = [None if i is None else files.index(same[i]) for i in verdict.order]
    gains = {files.index(same[i]): gain for i, gain in verdict.gains.items()}
    return replace(verdict, order=order, notes=notes + verdict.notes, gains=gains)


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

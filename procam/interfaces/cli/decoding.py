"""`procam decode` and `procam patterns`: plain structured light with folders of pictures."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.errors import CalibrationError, FileFormatError, InputError
from procam.estimate.structured_light.codes import CODES, Code, make_code, picture
from procam.estimate.structured_light.consistency import probe_places
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.limits import DecodeLimits, default_limits
from procam.estimate.structured_light.panel_checks import panel_notes
from procam.estimate.structured_light.panel_map import drop_inconsistent, fit_projector_map
from procam.estimate.structured_light.set_checks import SetReport, examine
from procam.files.images.layers import write_channels
from procam.files.images.pixels import read_image, write_image
from procam.interfaces.cli.output import Output
from procam.interfaces.plots.correspondence import quick_look
from procam.model.correspondence import CorrespondenceMap, ProjectorMap

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".exr", ".bmp", ".pgm")
Picture = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]


def run_patterns(size: str, out: Path, code: str, output: Output) -> None:
    """Write the pictures of a code into a folder, in the order `procam decode` wants them."""
    layout = make_code(code, _size(size))
    if out.exists() and any(out.iterdir()):
        raise InputError(f"{out}: got a folder with files in it, expected a new or empty one")
    out.mkdir(parents=True, exist_ok=True)
    order = folder_order(layout)
    for number, plane in enumerate(order):
        write_image(out / f"{number:04d}.png", picture(layout, layout.planes[plane]))
    output.say(
        f"{len(order)} pictures written to {out}; show them in the order of their names, photograph each, "
        f"and decode with --code {code}"
    )
    output.finish({"out": str(out), "pictures": [str(layout.planes[i]) for i in order]})


def run_decode(
    folder: Path,
    size: str,
    out: Path,
    code: str,
    limits: tuple[float | None, float | None],
    output: Output,
) -> None:
    """Decode FOLDER and write the map, and a picture of it to look at beside it."""
    layout = make_code(code, _size(size))
    if out.resolve().parent == folder.resolve():
        raise InputError(f"{out}: lies among the photographs; choose another folder for it")
    look, side = (out.with_name(f"{out.stem}{end}") for end in ("-look.png", "-panel.exr"))
    _check_outputs(out, look, side)
    found, panel, notes = decode_folder(folder, layout, limits)
    if not found.valid.any():
        raise CalibrationError(
            f"{folder}: no pixel decodes as {code} on {size}; are size, code and order right?"
        )
    xy, sigma = found.projector_xy, np.sqrt(np.mean(found.sigma_px**2, axis=-1))
    write_channels(out, {"projector.x": xy[..., 0], "projector.y": xy[..., 1], "sigma": sigma})
    write_image(look, quick_look(found, layout.size))
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


def _check_outputs(out: Path, *others: Path) -> None:
    if out.suffix != ".exr":
        raise InputError(f"{out}: got the suffix {out.suffix!r}, expected .exr for a map")
    for path in others:
        if path.exists() and not out.exists():
            raise InputError(
                f"{path}: is there already, and no map of the same name; choose another name for --out"
            )


def decode_folder(
    folder: Path, code: Code, limits: tuple[float | None, float | None]
) -> tuple[CorrespondenceMap, ProjectorMap, list[str]]:
    """Camera's and panel's side of a folder of pictures, and what was odd.

    `limits` are white - black and contrast in counts, None for automatic; given ones switch all
    other cleaning off.
    """
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: got no such folder, expected one with photographs")
    files = sorted(
        (p for p in folder.glob("*") if p.suffix.lower() in SUFFIXES and p.is_file()), key=_in_order
    )
    if abs(len(files) - len(code.planes)) > 1:
        raise FileFormatError(_wrong_number(folder, len(files), code))
    verdict = _matched(files, code)
    shown = [None if i is None else files[i] for i in verdict.order]
    assert shown[0] is not None and shown[1] is not None
    white, black = read_grey(shown[0]), read_grey(shown[1])
    decoder = Decoder(code, _limits(limits, white, black))
    decoder.add(0, white)
    decoder.add(1, black)
    for number, path in enumerate(shown):
        if number > 1 and path is not None:
            decoder.add(number, read_grey(path))
    decoded = decoder.result()
    found, panel = decoded.map, fit_projector_map(decoded.map, code.size)
    if limits == (None, None):
        found = drop_inconsistent(found, panel)
    return found, panel, [*verdict.notes, *decoded.notes, *panel_notes(code, found)]


def _panel_channels(panel: ProjectorMap) -> dict[str, NDArray[np.float32]]:
    return {
        "camera.x": panel.camera_px[..., 0],
        "camera.y": panel.camera_px[..., 1],
        "sigma": panel.sigma_px,
        "coverage": panel.coverage,
    }


def folder_order(code: Code) -> list[int]:
    """Planes in the order of a folder: as shown, but stripes end with white and black as OpenCV's do."""
    shown = list(range(len(code.planes)))
    return shown if code.has_waves else [*shown[2:], 0, 1]


def _matched(files: list[Path], code: Code) -> SetReport:
    """Which file shows which plane; files of another size than most are left out."""
    pictures = ((path, read_grey(path)) for path in files)
    seen = [
        (path, _kind(picture), picture[probe_places(picture.shape)]) for path, picture in pictures
    ]
    kinds = [kind for _, kind, _ in seen]
    usual = max(set(kinds), key=kinds.count)
    notes = [
        f"{path.name}: got {kind}, expected {usual} like most; left out"
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


def _limits(
    asked: tuple[float | None, float | None], white: Picture, black: Picture
) -> DecodeLimits:
    automatic = default_limits(white, black)
    if asked == (None, None):
        return automatic
    for name, value in zip(("white-black", "contrast"), asked, strict=True):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(f"--{name}: got {value}, expected a number of counts, 0 or more")
    return replace(
        automatic,
        white_black=automatic.white_black if asked[0] is None else asked[0],
        contrast=automatic.contrast if asked[1] is None else asked[1],
        lit_share=0.0,
        neighbours=False,
    )


def read_grey(path: Path) -> Picture:
    """A photograph (H, W) in its own type; the mean of three channels, whole if they were."""
    pixels = read_image(path)[..., :3]
    if pixels.shape[-1] == 1 or pixels.dtype.kind == "u":
        middle = pixels[..., 0] if pixels.shape[-1] == 1 else np.rint(pixels.mean(axis=-1))
        return middle.astype(pixels.dtype if pixels.dtype.kind == "u" else np.float32)
    grey = np.asarray(pixels, np.float32).mean(axis=-1)
    bad = int((~np.isfinite(grey)).sum())
    if bad:
        raise FileFormatError(
            f"{path}: got {bad} values that are NaN or infinite, expected photographs; export it again"
        )
    return grey


def _in_order(path: Path) -> list[str | int]:
    """Sorts img_2 before img_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


def _wrong_number(folder: Path, count: int, code: Code) -> str:
    width, height = code.size
    fitting = [name for name in CODES if len(make_code(name, code.size).planes) == count]
    hint = f"; {count} fit --code {' or '.join(fitting)}" if fitting else ""
    return (
        f"{folder}: got {count} pictures, expected {len(code.planes)} for the code {code.name} of a "
        f"projector of {width}x{height}{hint}"
    )


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match or not all(int(part) for part in match.groups()):
        raise InputError(f"size: got {text!r}, expected WIDTHxHEIGHT such as 1280x800")
    return int(match[1]), int(match[2])

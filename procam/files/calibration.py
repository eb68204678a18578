"""Calibration directories: calibration.json; in maps PROJECTOR.exr, dome.exr, states, mesh, form factors.

Numbers go to JSON with their sigmas, maps to EXR channels. The file is longer than 300 lines because
each part is written and read in one place, so that the two cannot drift apart.
"""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procam.arrays import Array32
from procam.errors import FileFormatError, InputError, ShapeError
from procam.files import calibration_entries as entries
from procam.files.atomic import replacing_directory
from procam.files.calibration_entries import check_maps, check_surface, numbers, size_of
from procam.files.images.layers import read_channels, read_layers, write_channels, write_layers
from procam.files.provenance import provenance_entry, read_provenance
from procam.maths.geometry.canvas import Canvas
from procam.model.calibration import SCHEMA_VERSION, Calibration, ProjectorCalibration
from procam.model.correspondence import ProjectorSurface
from procam.model.mask import Mask
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.photometry import Photometry
from procam.model.screen import RoomScreen, Screen
from procam.model.transport import ScatterKernel, ScreenMaps
from procam.model.venue_state import VenueState

if TYPE_CHECKING:
    from procam.maths.mesh.rooms import Room

Channels = dict[str, Array32]
READABLE = (1, SCHEMA_VERSION)
Keep = Callable[[ProjectorCalibration], ProjectorCalibration]
RGB = ("R", "G", "B")
DOME_MAPS = ("scatter_per_flux", "albedo", "lo", "hi")


def _whole(projector: ProjectorCalibration) -> ProjectorCalibration:
    return projector


def save_calibration(calibration: Calibration, directory: str | Path) -> None:
    """Write a calibration; the directory appears when it is complete.

    Parameters
    ----------
    calibration : what `load_calibration` gives back.
    directory : such as VENUE/calibrations/0001; it must not exist.

    Returns
    -------
    Nothing.

    Raises
    ------
    InputError
        If the folder exists.
    OSError
        If the disk is full or the folder cannot be written; nothing is left behind.

    Examples
    --------
    >>> save_calibration(load_calibration(Path("no-such-folder")), Path("copy"))
    Traceback (most recent call last):
    procam.errors.FileFormatError: ...
    """
    directory = Path(directory)
    if directory.exists():
        raise InputError(
            f"{directory} exists; give the folder of a calibration that is not written yet"
        )
    with replacing_directory(directory) as temporary:
        for name, projector in calibration.projectors.items():
            write_channels(temporary / "maps" / f"{name}.exr", _projector_channels(projector))
        write_layers(temporary / "maps" / "dome.exr", _dome_layers(calibration.maps))
        for name, state in calibration.states.items():
            if state.ambient is not None:
                path = temporary / "maps" / ambient_file(name)
                write_channels(path, {c: state.ambient[..., i] for i, c in enumerate(RGB)})
        screen = calibration.screen
        if isinstance(screen, RoomScreen):
            _write_room(temporary / "maps", screen)
        text = json.dumps(_document(calibration), indent=1, default=np.ndarray.tolist)
        (temporary / "calibration.json").write_text(text, encoding="utf-8")


def _write_room(maps: Path, screen: RoomScreen) -> None:
    from procam.files import form_factors, mesh_file  # noqa: PLC0415 - SciPy

    if screen.mesh is not None:
        mesh_file.write_mesh(maps / mesh_file.NAME, screen.mesh)
    if screen.has_factors:
        form_factors.write_form_factors(maps / form_factors.NAME, screen)


def _mesh_of(maps: Path, entry: dict[str, Any]) -> "Room | None":
    """The mesh of a screen that is one."""
    if entry.get("kind") != "mesh":
        return None
    from procam.files.mesh_file import NAME, read_mesh  # noqa: PLC0415 - SciPy

    return read_mesh(maps / NAME)


def _with_factors(maps: Path, screen: RoomScreen) -> RoomScreen:
    from procam.files.form_factors import NAME, with_form_factors  # noqa: PLC0415 - SciPy

    return with_form_factors(screen, maps / NAME)


def ambient_file(state: str) -> str:
    """Name of the map of a venue state's ambient light."""
    return f"state-{state}.exr"


def load_calibration(directory: str | Path, keep: Keep = _whole) -> Calibration:
    """Read a calibration directory.

    Parameters
    ----------
    directory : such as VENUE/calibrations/0001, with calibration.json and maps.
    keep : what to keep of each projector when it has been read, to save memory.

    Returns
    -------
    calibration : the model, with all maps.

    Raises
    ------
    FileFormatError
        If a file is missing, damaged, or of another schema version.

    Examples
    --------
    >>> load_calibration(Path("no-such-folder"))
    Traceback (most recent call last):
    procam.errors.FileFormatError: ...
    """
    return _load(directory, keep)


def load_dome(directory: Path) -> Calibration:
    """Read a calibration directory without its projectors, which dome masters do not need."""
    return _load(directory, keep=None)


def metered_white(directory: Path) -> float | None:
    """Luminance of a calibration's reference white [cd/m2], if a hand meter has read it; loads no map."""
    damaged = (AttributeError, LookupError, OSError, RecursionError, TypeError, ValueError)
    with suppress(*damaged):  # which whoever loads the calibration refuses
        found = entries.absolute(json.loads((directory / "calibration.json").read_bytes()))
        return found.nits_per_unit[0] if found else None
    return None


def _load(directory: str | Path, keep: Keep | None) -> Calibration:
    directory = Path(directory)
    path = directory / "calibration.json"
    if not path.is_file():
        raise FileFormatError(
            f"{directory} has no calibration.json; a calibration directory such as "
            "VENUE/calibrations/0001 is needed"
        )
    try:
        document = json.loads(path.read_text("utf-8"))
        if document["schema_version"] not in READABLE:
            raise FileFormatError(
                f"{path} has schema_version {document['schema_version']!r}, and this version of procam "
                f"reads {' and '.join(map(str, READABLE))}; calibrate again with this version"
            )
        return _calibration(directory, document, keep)
    except FileFormatError:
        raise
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise FileFormatError(
            f"{path} is a damaged calibration ({type(error).__name__}: {error}); restore it or run "
            "`procam session solve` on its session again"
        ) from error


def _projector_channels(projector: ProjectorCalibration) -> Channels:
    surface = projector.surface
    channels: dict[str, Any] = {
        f"direction.{axis}": surface.direction[..., i] for i, axis in enumerate("xyz")
    }
    channels |= {
        "solid_angle": surface.solid_angle_sr,
        "sigma_arcmin": surface.sigma_arcmin,
        "valid": surface.valid,
        "measured": surface.measured,
        "blend": projector.blend,
    }
    for name in ("gain", "exponent"):
        values = getattr(projector.photometry, name)
        if values is not None:
            channels |= {f"{name}.{c}": values[..., i] for i, c in enumerate(RGB)}
    return channels


def _dome_layers(maps: ScreenMaps) -> Channels:
    names = ("coverage", "falloff", *DOME_MAPS)
    layers = {n: getattr(maps, n) for n in names if getattr(maps, n) is not None}
    if maps.protected is not None:
        layers["protected"] = maps.protected.covered
    return layers


def _document(calibration: Calibration) -> dict[str, Any]:
    return {
        "schema_version": calibration.schema_version,
        "screen": _screen_entry(calibration.screen),
        "cameras": {n: _camera_entry(c) for n, c in calibration.cameras.items()},
        "main_camera": calibration.main_camera,
        "canvas": asdict(calibration.canvas) if isinstance(calibration.canvas, Canvas) else None,
        "projectors": {n: _projector_entry(p) for n, p in calibration.projectors.items()},
        "feedback": asdict(calibration.feedback),
        "albedo": asdict(calibration.albedo),
        "scatter_kernel": asdict(calibration.maps.kernel),
        "content_from_camera": calibration.content_from_camera,
        "quality": {n: f.as_dict() for n, f in calibration.quality.items()},
        "provenance": provenance_entry(calibration.provenance),
        "states": {n: _state_entry(s) for n, s in calibration.states.items()},
        "absolute": asdict(calibration.absolute) if calibration.absolute else None,
    }


def _screen_entry(screen: Screen) -> dict[str, Any]:
    """Its fields; a mesh has a file of its own."""
    of = replace(screen, mesh=None) if isinstance(screen, RoomScreen) else screen
    entry = {**asdict(of), "kind": screen.kind}
    entry.pop("mesh", None)
    return entry


def _state_entry(state: VenueState) -> dict[str, Any]:
    return {
        "feedback": asdict(state.feedback),
        "scatter_ratio": state.scatter_ratio,
        "ambient": state.ambient is not None,
    }


def _camera_entry(camera: CameraModel) -> dict[str, Any]:
    assert camera.camera_from_dome is not None
    return {
        "size": list(camera.size),
        "lens": asdict(camera.lens),
        "sensor": asdict(camera.sensor),
        "camera_from_dome": asdict(camera.camera_from_dome),
        "pupil": camera.pupil,
    }


def _projector_entry(projector: ProjectorCalibration) -> dict[str, Any]:
    model, light = projector.model, projector.photometry
    return {
        "size": list(model.size),
        "lens": asdict(model.lens),
        "projector_from_dome": asdict(model.projector_from_dome),
        "covariance": model.covariance,
        "response": asdict(light.response),
        "colour_mix": light.colour_mix,
    }


def _calibration(directory: Path, document: dict[str, Any], keep: Keep | None) -> Calibration:
    maps = read_layers(directory / "maps" / "dome.exr")
    mesh = _mesh_of(directory / "maps", document["screen"])
    screen = entries.screen(document["screen"], mesh)
    check_maps(maps, screen)
    if isinstance(screen, RoomScreen):
        screen = _with_factors(directory / "maps", screen)
    kept = dict[str, ProjectorCalibration]()
    if keep:
        for name, entry in document["projectors"].items():
            kept[name] = keep(_projector(directory, entries.safe_name(name), entry))
    return Calibration(
        screen,
        {n: entries.camera(n, e) for n, e in document["cameras"].items()},
        kept,
        _dome_maps(maps, document.get("scatter_kernel")),
        entries.measured(document["feedback"]),
        entries.measured(document["albedo"]),
        numbers(document, "content_from_camera", (3, 3), unknown=True),
        {n: entries.figure(e) for n, e in document["quality"].items()},
        read_provenance(document["provenance"]),
        SCHEMA_VERSION,
        {
            n: _state(directory, entries.safe_name(n), e)
            for n, e in document.get("states", {}).items()
        },
        entries.main_camera(document),
        entries.canvas(document, screen),
        entries.absolute(document),
    )


def _state(directory: Path, name: str, entry: dict[str, Any]) -> VenueState:
    ambient = None
    if entry["ambient"]:
        maps = read_channels(directory / "maps" / ambient_file(name))
        ambient = np.stack([maps[c] for c in RGB], axis=-1)
    ratio = numbers(entry, "scatter_ratio", (3,))
    return VenueState(name, entries.measured(entry["feedback"]), ratio, ambient)


def _dome_maps(dome: Channels, kernel: dict[str, Any] | None) -> ScreenMaps:
    covered = dome.get("protected")  # absent where nothing is protected
    protected = None if covered is None else Mask("screen", covered > 0.5)
    scatter, albedo, lo, hi = (dome[name] for name in DOME_MAPS)
    scatter_kernel = ScatterKernel.scalar() if kernel is None else entries.scatter_kernel(kernel)
    falloff = dome.get("falloff")
    return ScreenMaps(scatter, albedo, lo, hi, dome["coverage"], protected, scatter_kernel, falloff)


def _projector(directory: Path, name: str, entry: dict[str, Any]) -> ProjectorCalibration:
    maps = read_layers(directory / "maps" / f"{name}.exr")
    known = entry["covariance"] is not None
    model = ProjectorModel(
        name,
        size_of(entry),
        entries.lens(entry["lens"]),
        entries.pose(entry["projector_from_dome"]),
        numbers(entry, "covariance", (None, None)) if known else None,
    )
    surface = ProjectorSurface(
        _three_channels(maps, "direction"),
        maps["solid_angle"],
        maps["valid"] > 0.5,
        maps["measured"],
        maps["sigma_arcmin"],
    )
    check_surface(surface, model.size, maps["blend"])
    response = entries.response(entry["response"])
    mix, gain = numbers(entry, "colour_mix", (3, 3)), _three_channels(maps, "gain")
    exponent = _three_channels(maps, "exponent") if "exponent" in maps else None
    photometry = Photometry(response, mix, gain, exponent)
    return ProjectorCalibration(model, surface, photometry, maps["blend"])


def _three_channels(maps: Channels, name: str) -> Array32:
    layer = maps[name]
    if layer.shape[2:] != (3,):
        raise ShapeError(f"map {name}", layer.shape, "(H, W, 3)")
    return layer

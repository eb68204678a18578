"""Checks of a venue.toml beyond single values: names, positions, files and lenses that contradict.

Each function returns or yields one line for each mistake: the dotted path of the entry, what is wrong
with it, and what to do. `find_mistakes` gathers them, so that one run shows all. The module is longer than
300 lines because every table has its checks here.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from procam.files.venue.outlines import (
    canvas_mistakes,
    dome_mistakes,
    file_mistakes,
    is_within,
    pixel_mistakes,
)
from procam.files.venue.screens import OFF_M, place_of
from procam.files.venue.server_checks import server_mistakes
from procam.files.venue.tables import (
    CameraTable,
    DistanceTable,
    DomeTable,
    FiducialTable,
    MeshTable,
    PlaceTable,
    ProjectorTable,
    ScreenTable,
    TagTable,
    VenueTable,
)
from procam.maths.geometry.local_shift import LocalShift
from procam.model.optics import TAG_COUNTS
from procam.model.screen import Dome, RoomScreen, Screen

FOCAL_WIDTHS = (0.05, 50.0)  # focal lengths of cameras, in widths of their pictures
MAX_STRETCH = 2.0  # between a camera's two focal lengths
MAX_OFFSET_WIDTHS = 3.0  # of a principal point outside the picture
BELOW_RIM_DEG = 5.0  # of a mark: on the rim's frame at most
DOME_KEYS, ROOM_KEYS = ("azimuth_deg", "elevation_deg", "sigma_deg"), ("canvas_m", "sigma_m")
MESH_KEYS = ("canvas_m", "point_m", "sigma_m")
MARKS_OF_ROOMS = "canvas_m and sigma_m", "canvas_m or point_m, and sigma_m"
MARK_KEYS = {"dome": DOME_KEYS, "mesh": MESH_KEYS}
COEFFICIENTS = {"kannala-brandt": 4, "brown": 5}


def find_mistakes(table: VenueTable, screen: Screen, folder: Path) -> list[str]:
    """One line for each mistake in the tables of a venue in `folder`, whose screen is given."""
    found = [*_name_mistakes(table), *_screen_mistakes(table.screen, screen, folder)]
    found += _others_mistakes(table.screen, screen)
    if table.blend.falloff_percent_per_deg and not isinstance(table.screen, DomeTable):
        found.append(
            f"blend.falloff_percent_per_deg is for domes, and the screen is a {table.screen.kind}; remove it"
        )
    for name, camera in table.cameras.items():
        found += _camera_mistakes(f"cameras.{name}", camera, folder)
    for name, projector in table.projectors.items():
        found += _projector_mistakes(f"projectors.{name}", projector, folder)
    for fiducial in table.fiducials:
        found += _fiducial_mistakes(fiducial, table)
    found += [*_place_mistakes(table, screen), *_below_rim(table), *_tag_mistakes(table.apriltags)]
    found += _distance_mistakes(table)
    return [*found, *server_mistakes(table)]


def _name_mistakes(table: VenueTable) -> list[str]:
    """Names that are used twice, or by a file of the calibration's maps."""
    found = [
        f"projectors.{name} has a name that a calibration needs for a map of the dome; rename it"
        for name in table.projectors
        if name.lower() == "dome" or name.lower().startswith("state-")
    ]
    found += [
        f"projectors.{name} has the name of a camera; rename either"
        for name in table.projectors
        if name in table.cameras
    ]
    found += [
        f"fiducials.{name} has the name of a camera or projector; rename it"
        for name in dict.fromkeys(f.name for f in table.fiducials)
        if name in table.cameras or name in table.projectors
    ]
    return found + _namesake_mistakes(table)


def _namesake_mistakes(table: VenueTable) -> list[str]:
    """Entries of one name are one fiducial seen by several devices, and need one position."""
    found, seen = list[str](), set[tuple[str, str | None]]()
    places = {tag.name: _stated(tag) for tag in table.apriltags}
    for mark in table.fiducials:
        where, place = f"fiducials.{mark.name}", _stated(mark)
        first, device = places.setdefault(mark.name, place), mark.camera or mark.projector
        if device and (mark.name, device) in seen:
            found.append(f"{where} is listed twice for {device}; rename or remove one")
        elif place != first:
            found.append(
                f"{where} has {_shown(place)} here and {_shown(first)} before; "
                "correct it or rename one"
            )
        seen.add((mark.name, device))
    return found


def _stated(mark: PlaceTable) -> dict[str, object]:
    """The keys of a mark's place that are given."""
    keys = ("azimuth_deg", "elevation_deg", "canvas_m", "point_m")
    return {key: getattr(mark, key) for key in keys if getattr(mark, key) is not None}


def _shown(place: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in place.items()) or "no place"


def _screen_mistakes(table: ScreenTable, screen: Screen, folder: Path) -> Iterator[str]:
    for key, outlines in (("masks", table.masks), ("protected", table.protected)):
        if isinstance(screen, Dome):
            yield from dome_mistakes(f"screen.{key}", outlines)
        else:
            yield from canvas_mistakes(f"screen.{key}", outlines, screen.room.size_m)
        yield from file_mistakes(f"screen.{key}", outlines, folder)


def _others_mistakes(table: ScreenTable, screen: Screen) -> Iterator[str]:
    """Albedos of parts that a room does not have, or that are lit, whose albedo is measured."""
    if isinstance(table, DomeTable) or isinstance(screen, Dome):
        return
    names = [name for name, *_ in screen.others]
    for name in table.others:
        if name not in names:
            yield f"screen.others.{name} is no part that is not lit ({', '.join(names)}); remove it"


def _camera_mistakes(where: str, camera: CameraTable, folder: Path) -> Iterator[str]:
    if len(camera.k) != (count := COEFFICIENTS[camera.model]):
        yield (
            f"{where}.k has {len(camera.k)} numbers, and model {camera.model!r} needs {count}; correct "
            "either"
        )
    if camera.black_level >= 2**camera.bits - 1:
        yield (
            f"{where}.black_level is {camera.black_level:g}; {camera.bits} bits saturate at "
            f"{2**camera.bits - 1}. Correct black_level or bits"
        )
    yield from _lens_mistakes(where, camera)
    yield from pixel_mistakes(f"{where}.masks", camera.masks, camera.size)
    yield from file_mistakes(f"{where}.masks", camera.masks, folder)
    yield from _response_mistakes(where, camera, folder)


def _response_mistakes(where: str, camera: CameraTable, folder: Path) -> Iterator[str]:
    path = folder / camera.response
    if camera.response.endswith(".csv") and not path.is_file():
        yield (
            f"{where}.response: {path}: no such file; a table of level,light lines is needed there"
        )
    if camera.response != "solve":
        if camera.brackets is not None:
            yield (
                f'{where}.brackets is for response = "solve", and response is {camera.response!r}; remove '
                "it or change the response"
            )
    elif camera.brackets is None:
        yield (
            f'{where}.brackets is missing: response = "solve" needs a folder of photographs of one still '
            "scene at three exposures or more; add it"
        )
    elif not (folder / camera.brackets).is_dir():
        yield (
            f"{where}.brackets: {folder / camera.brackets}: no such folder; photographs of a still scene "
            "at three exposures or more are needed there"
        )


def _lens_mistakes(where: str, camera: CameraTable) -> Iterator[str]:
    """Lenses that no camera has, from which the solver would not converge."""
    width, height = camera.size
    low, high = (share * width for share in FOCAL_WIDTHS)
    if not low <= min(camera.f) <= max(camera.f) <= high:
        yield (
            f"{where}.f is {list(camera.f)}; it must be {low:g}..{high:g} px, {FOCAL_WIDTHS[0]:g} to "
            f"{FOCAL_WIDTHS[1]:g} widths of the picture. Give pixels, not millimetres"
        )
    elif max(camera.f) > MAX_STRETCH * min(camera.f):
        yield (
            f"{where}.f is {list(camera.f)}; the two may differ by a factor of {MAX_STRETCH:g} at most, "
            "and most cameras have equal ones"
        )
    far = MAX_OFFSET_WIDTHS * width
    if not all(-far <= c <= edge + far for c, edge in zip(camera.c, (width, height), strict=True)):
        yield (
            f"{where}.c is {list(camera.c)}; it must lie in the picture of {width}x{height} px or at most "
            f"{far:g} px outside. Begin with the middle"
        )


def _projector_mistakes(where: str, projector: ProjectorTable, folder: Path) -> list[str]:
    found = pixel_mistakes(f"{where}.masks", projector.masks, projector.size)
    found += file_mistakes(f"{where}.masks", projector.masks, folder)
    return found + _nudge_mistakes(where, projector)


def _nudge_mistakes(where: str, projector: ProjectorTable) -> list[str]:
    nudges, (width, height) = projector.nudges, projector.size
    found = [
        f"{where}.nudges.{i}.pixel is {list(nudge.pixel)}; it must lie on the panel of {width}x{height} px"
        for i, nudge in enumerate(nudges)
        if not is_within(nudge.pixel, projector.size)
    ]
    pixels, by = np.array([(n.pixel, n.shift_px) for n in nudges]).reshape(-1, 2, 2).swapaxes(0, 1)
    shift = LocalShift.on_panel(projector.size, pixels, by)
    torn = shift.first_fold()
    if torn is not None:
        found.append(
            f"{where}.nudges.{torn}: shift_px {by[torn].tolist()} at pixel {pixels[torn].tolist()} folds "
            f"the picture over itself; it must be less than {2 / 3 * shift.reach_px:.0f} px, and "
            "neighbours' shifts must differ by less than their distance"
        )
    return found


def _fiducial_mistakes(fiducial: FiducialTable, table: VenueTable) -> Iterator[str]:
    where = f"fiducials.{fiducial.name}"
    if (fiducial.camera is None) == (fiducial.projector is None):
        yield (
            f"{where} has both or neither of camera and projector; name the one device whose pixel it is"
        )
    cameras = {name: device.size for name, device in table.cameras.items()}
    projectors = {name: device.size for name, device in table.projectors.items()}
    yield from _device_mistakes(where, "camera", fiducial, cameras)
    yield from _device_mistakes(where, "projector", fiducial, projectors)


def _place_mistakes(table: VenueTable, screen: Screen) -> Iterator[str]:
    """Marks without a place of the kind that the screen has."""
    marks: list[tuple[str, PlaceTable]] = [(f"fiducials.{f.name}", f) for f in table.fiducials]
    marks += [(f"apriltags.{i}", tag) for i, tag in enumerate(table.apriltags)]
    kind, keys = table.screen.kind, MARK_KEYS.get(table.screen.kind, ROOM_KEYS)
    for where, mark in marks:
        for key in (*DOME_KEYS, *MESH_KEYS):
            if key not in keys and getattr(mark, key) is not None:
                own = "angles" if kind == "dome" else MARKS_OF_ROOMS[kind == "mesh"]
                yield f"{where}.{key} is not for a {kind}, where marks have {own}; remove it"
        if isinstance(screen, Dome) and mark.azimuth_deg is None and mark.elevation_deg is None:
            yield f"{where} has no angle; add azimuth_deg, elevation_deg or both"
        if getattr(mark, keys[-1]) is None:
            yield f"{where}.{keys[-1]} is missing; add it (`procam init` writes a complete example)"
        if isinstance(screen, RoomScreen):
            yield from _room_mistakes(where, mark, screen, table.screen)


def _room_mistakes(
    where: str, mark: PlaceTable, screen: RoomScreen, table: ScreenTable
) -> Iterator[str]:
    on_canvas, in_space = mark.canvas_m is not None, mark.point_m is not None
    if on_canvas and in_space and isinstance(table, MeshTable):
        yield f"{where} has both canvas_m and point_m; remove one"
    elif isinstance(table, MeshTable) and not on_canvas and not in_space:
        yield f"{where} has no place; add point_m, its coordinates in {table.file}, or canvas_m"
    elif not on_canvas and not isinstance(table, MeshTable):
        yield f"{where}.canvas_m is missing; add its metres from the canvas's upper left corner"
    elif place_of(mark, screen, table) is None and on_canvas:
        yield (
            f"{where}.canvas_m is {list(mark.canvas_m or ())}, where nothing is lit; `procam venue canvas` "
            "draws what lies where"
        )
    elif place_of(mark, screen, table) is None:
        yield (
            f"{where}.point_m is {list(mark.point_m or ())}, more than {OFF_M:g} m from what is lit; measure "
            "it in the mesh's coordinates"
        )


def _below_rim(table: VenueTable) -> Iterator[str]:
    if not isinstance(table.screen, DomeTable):
        return
    rim = 90 - table.screen.half_angle_deg
    marks = [(f"fiducials.{f.name}", f.elevation_deg) for f in table.fiducials]
    marks += [(f"apriltags.{i}", tag.elevation_deg) for i, tag in enumerate(table.apriltags)]
    for where, elevation in marks:
        if elevation is not None and elevation < rim - BELOW_RIM_DEG:
            yield (
                f"{where}.elevation_deg is {elevation:g}; a screen of half_angle_deg "
                f"{table.screen.half_angle_deg:g} ends at {rim:g}. Correct either"
            )


def _device_mistakes(
    where: str, key: str, fiducial: FiducialTable, sizes: Mapping[str, tuple[int, int]]
) -> Iterator[str]:
    """Mistakes about the device, `key` "camera" or "projector", that a fiducial names."""
    name = getattr(fiducial, key)
    if name is not None and name not in sizes:
        yield f"{where}.{key} is {name!r}; it must be one of {', '.join(sizes)}"
    elif name is not None and not is_within(fiducial.pixel, sizes[name]):
        width, height = sizes[name]
        yield (
            f"{where}.pixel is {list(fiducial.pixel)}; it must lie in the {width}x{height} px of {key} {name}"
        )


def _tag_mistakes(tables: Sequence[TagTable]) -> list[str]:
    found, before = list[str](), set[str]()
    for i, entry in enumerate(tables):
        where = f"apriltags.{i}"
        if entry.id >= (count := TAG_COUNTS[entry.family]):
            found.append(
                f"{where}.id is {entry.id}; family {entry.family!r} has 0..{count - 1}. Correct id or family"
            )
        if entry.name in before:
            found.append(f"{where}: {entry.name} is listed twice; remove one")
        before.add(entry.name)
    return found


def _distance_mistakes(table: VenueTable) -> list[str]:
    marks = [*(f.name for f in table.fiducials), *(t.name for t in table.apriltags)]
    names = list(dict.fromkeys([*table.cameras, *table.projectors, *marks]))
    return [
        line
        for i, distance in enumerate(table.distances)
        for line in _end_mistakes(f"distances.{i}", distance, names)
    ]


def _end_mistakes(where: str, distance: DistanceTable, names: Sequence[str]) -> Iterator[str]:
    for key, name in (("a", distance.a), ("b", distance.b)):
        if name not in names:
            yield f"{where}.{key} is {name!r}; it must be one of {', '.join(names)}"
    if distance.a == distance.b:
        yield f"{where}: a and b are both {distance.a!r}; correct either"

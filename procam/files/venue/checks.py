"""What is wrong with a venue.toml beyond single values: names, places, files and lenses that clash."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from procam.files.venue.outlines import (
    dome_complaints,
    file_complaints,
    is_within,
    pixel_complaints,
)
from procam.files.venue.server_checks import server_complaints
from procam.files.venue.tables import (
    CameraTable,
    DistanceTable,
    FiducialTable,
    ProjectorTable,
    ScreenTable,
    TagTable,
    VenueTable,
)
from procam.maths.geometry.local_shift import LocalShift
from procam.model.optics import TAG_COUNTS

FOCAL_WIDTHS = (0.05, 50.0)  # focal lengths of cameras, in widths of their pictures
MOST_STRETCH = 2.0  # between a camera's two focal lengths
FAR_WIDTHS = 3.0  # of a principal point outside the picture
COEFFICIENTS = {"kannala-brandt": 4, "brown": 5}


def complaints(table: VenueTable, folder: Path) -> list[str]:
    """What is wrong with the tables of a venue in `folder`, a line each."""
    found = [*_name_complaints(table), *_screen_complaints(table.screen, folder)]
    for name, camera in table.cameras.items():
        found += _camera_complaints(f"cameras.{name}", camera, folder)
    for name, projector in table.projectors.items():
        found += _projector_complaints(f"projectors.{name}", projector, folder)
    for fiducial in table.fiducials:
        found += _fiducial_complaints(fiducial, table)
    found += _tag_complaints(table.apriltags)
    found += _distance_complaints(table)
    return [*found, *server_complaints(table)]


def _name_complaints(table: VenueTable) -> list[str]:
    """Names that would be taken for one another."""
    found = [
        f"projectors.{name}: got the name of a camera, expected another one; rename either"
        for name in table.projectors
        if name in table.cameras
    ]
    found += [
        f"fiducials.{name}: got the name of a camera or projector, expected another one; rename it"
        for name in dict.fromkeys(f.name for f in table.fiducials)
        if name in table.cameras or name in table.projectors
    ]
    return found + _namesake_complaints(table)


def _namesake_complaints(table: VenueTable) -> list[str]:
    """Marks of one name are one mark, seen by several devices, and have one place."""
    found, seen = list[str](), set[tuple[str, str | None]]()
    places = {tag.tag.name: (tag.azimuth_deg, tag.elevation_deg) for tag in table.apriltags}
    for mark in table.fiducials:
        where, place = f"fiducials.{mark.name}", (mark.azimuth_deg, mark.elevation_deg)
        first, device = places.setdefault(mark.name, place), mark.camera or mark.projector
        if device and (mark.name, device) in seen:
            found.append(f"{where}: got it twice on {device}, expected once; rename or remove one")
        elif place != first:
            found.append(
                f"{where}: got azimuth_deg, elevation_deg {_told(place)}, expected {_told(first)} as "
                "before, for one name is one mark; correct it or rename one"
            )
        seen.add((mark.name, device))
    return found


def _told(place: tuple[float | None, float | None]) -> str:
    return ", ".join("none" if angle is None else f"{angle:g}" for angle in place)


def _screen_complaints(screen: ScreenTable, folder: Path) -> Iterator[str]:
    for key, outlines in (("masks", screen.masks), ("protected", screen.protected)):
        yield from dome_complaints(f"screen.{key}", outlines)
        yield from file_complaints(f"screen.{key}", outlines, folder)


def _camera_complaints(where: str, camera: CameraTable, folder: Path) -> Iterator[str]:
    if len(camera.k) != (count := COEFFICIENTS[camera.model]):
        yield (
            f"{where}.k: got {len(camera.k)} numbers, expected {count} for model {camera.model!r}; "
            "correct either"
        )
    yield from _lens_complaints(where, camera)
    yield from pixel_complaints(f"{where}.masks", camera.masks, camera.size)
    yield from file_complaints(f"{where}.masks", camera.masks, folder)
    yield from _response_complaints(where, camera, folder)


def _response_complaints(where: str, camera: CameraTable, folder: Path) -> Iterator[str]:
    path = folder / camera.response
    if camera.response.endswith(".csv") and not path.is_file():
        yield (
            f"{where}.response: {path}: got no such file, expected a table of level,light lines; "
            "put it there or correct the name"
        )
    if camera.response != "solve":
        if camera.brackets is not None:
            yield (
                f"{where}.brackets: got {camera.brackets!r} with response = {camera.response!r}, expected "
                'it with response = "solve" only; remove it or set that'
            )
    elif camera.brackets is None:
        yield (
            f'{where}.brackets: got nothing, expected with response = "solve" a folder of photographs of '
            "one still scene at three exposures or more; add it"
        )
    elif not (folder / camera.brackets).is_dir():
        yield (
            f"{where}.brackets: {folder / camera.brackets}: got no such folder, expected one of "
            "photographs of a still scene at three exposures or more; put it there or correct the name"
        )


def _lens_complaints(where: str, camera: CameraTable) -> Iterator[str]:
    """Lenses that no camera has: from there no solution ever finds back."""
    width, height = camera.size
    low, high = (share * width for share in FOCAL_WIDTHS)
    if not low <= min(camera.f) <= max(camera.f) <= high:
        yield (
            f"{where}.f: got {list(camera.f)}, expected {low:g}..{high:g} px, {FOCAL_WIDTHS[0]:g} to "
            f"{FOCAL_WIDTHS[1]:g} widths of the picture; give pixels, not millimetres"
        )
    elif max(camera.f) > MOST_STRETCH * min(camera.f):
        yield (
            f"{where}.f: got {list(camera.f)}, expected two that differ by a factor of "
            f"{MOST_STRETCH:g} at most; correct them, most cameras have equal ones"
        )
    far = FAR_WIDTHS * width
    if not all(-far <= c <= edge + far for c, edge in zip(camera.c, (width, height), strict=True)):
        yield (
            f"{where}.c: got {list(camera.c)}, expected a place at most {far:g} px outside the picture "
            f"of {width}x{height} px; begin with its middle"
        )


def _projector_complaints(where: str, projector: ProjectorTable, folder: Path) -> list[str]:
    found = pixel_complaints(f"{where}.masks", projector.masks, projector.size)
    found += file_complaints(f"{where}.masks", projector.masks, folder)
    return found + _nudge_complaints(where, projector)


def _nudge_complaints(where: str, projector: ProjectorTable) -> list[str]:
    nudges, (width, height) = projector.nudges, projector.size
    found = [
        f"{where}.nudges.{i}.pixel: got {list(nudge.pixel)}, expected a place on the panel of "
        f"{width}x{height} px; correct it"
        for i, nudge in enumerate(nudges)
        if not is_within(nudge.pixel, projector.size)
    ]
    pixels, by = np.array([(n.pixel, n.shift_px) for n in nudges]).reshape(-1, 2, 2).swapaxes(0, 1)
    shift = LocalShift.on_panel(projector.size, pixels, by)
    torn = shift.torn_at()
    if torn is not None:
        found.append(
            f"{where}.nudges.{torn}: got shift_px {by[torn].tolist()} at pixel "
            f"{pixels[torn].tolist()}, where the picture would lie over itself; expected less than "
            f"{2 / 3 * shift.reach_px:.0f} px, and neighbours whose shifts differ by less than they "
            "are apart; correct or remove it"
        )
    return found


def _fiducial_complaints(fiducial: FiducialTable, table: VenueTable) -> Iterator[str]:
    where = f"fiducials.{fiducial.name}"
    if (fiducial.camera is None) == (fiducial.projector is None):
        yield (
            f"{where}: got both or neither of camera and projector, expected one of them; "
            "name the device whose pixel it is"
        )
    cameras = {name: device.size for name, device in table.cameras.items()}
    projectors = {name: device.size for name, device in table.projectors.items()}
    yield from _device_complaints(where, "camera", fiducial, cameras)
    yield from _device_complaints(where, "projector", fiducial, projectors)
    if fiducial.azimuth_deg is None and fiducial.elevation_deg is None:
        yield _no_angle(where)


def _device_complaints(
    where: str, key: str, fiducial: FiducialTable, sizes: Mapping[str, tuple[int, int]]
) -> Iterator[str]:
    """Of the camera or projector, as `key` says, that a fiducial names."""
    name = getattr(fiducial, key)
    if name is not None and name not in sizes:
        yield f"{where}.{key}: got {name!r}, expected one of {', '.join(sizes)}; correct it"
    elif name is not None and not is_within(fiducial.pixel, sizes[name]):
        width, height = sizes[name]
        yield (
            f"{where}.pixel: got {list(fiducial.pixel)}, expected a place in the {width}x{height} px of "
            f"{key} {name}; correct it"
        )


def _no_angle(where: str) -> str:
    return f"{where}: got no angle, expected azimuth_deg, elevation_deg or both; add what is known"


def _tag_complaints(tables: Sequence[TagTable]) -> list[str]:
    found, before = list[str](), set[str]()
    for i, entry in enumerate(tables):
        where = f"apriltags.{i}"
        if entry.azimuth_deg is None and entry.elevation_deg is None:
            found.append(_no_angle(where))
        if entry.id >= (count := TAG_COUNTS[entry.family]):
            found.append(
                f"{where}.id: got {entry.id}, expected 0..{count - 1} of family {entry.family!r}; "
                "correct id or family"
            )
        if entry.tag.name in before:
            found.append(f"{where}: got {entry.tag.name} twice, expected each once; remove one")
        before.add(entry.tag.name)
    return found


def _distance_complaints(table: VenueTable) -> list[str]:
    marks = [*(f.name for f in table.fiducials), *(t.tag.name for t in table.apriltags)]
    names = list(dict.fromkeys([*table.cameras, *table.projectors, *marks]))
    return [
        line
        for i, distance in enumerate(table.distances)
        for line in _end_complaints(f"distances.{i}", distance, names)
    ]


def _end_complaints(where: str, distance: DistanceTable, names: Sequence[str]) -> Iterator[str]:
    for key, name in (("a", distance.a), ("b", distance.b)):
        if name not in names:
            yield f"{where}.{key}: got {name!r}, expected one of {', '.join(names)}; correct it"
    if distance.a == distance.b:
        yield f"{where}: got {distance.a!r} for both a and b, expected two ends; correct either"

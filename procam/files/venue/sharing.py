"""Keys of venue.toml that may go to other people: a closed list, those that a solve reads.

All other keys stay at the venue. Every key of the tables is in one of the two lists below, and a test
fails on one that is in neither. `*` is the name of a device, or any entry of a list.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from procam.files.venue.tables import VenueTable

SHARED = {
    "screen": "kind radius_m half_angle_deg tilt_deg floor_albedo floor_albedo_sigma masks protected "
    "map_size width_m depth_m height_m arc_deg lit other_albedo other_albedo_sigma others "
    "file canvas origin_m smooth",
    "cameras.*": "size model f c k intrinsics response bits black_level vignetting glare glare_sigma masks",
    "projectors.*": "size kind lens fov_deg rotation_deg masks",
    "projectors.*.nudges.*": "pixel shift_px",
    "fiducials.*": "name camera projector pixel sigma_px azimuth_deg elevation_deg sigma_deg canvas_m "
    "point_m sigma_m",
    "apriltags.*": "family id azimuth_deg elevation_deg sigma_deg canvas_m point_m sigma_m",
    "distances.*": "a b metres sigma_m",
    "capture": "exposure_s black_exposure_s shot_s",
    "blend": "falloff_percent_per_deg",
}
# commands, addresses and ports of devices, folders, and what the owner has agreed with the client
PRIVATE = {
    "": "acceptance history unattended",
    "cameras.*": "backend brackets",
    "projectors.*": "backend control",
}


def paths_of(lists: Mapping[str, str]) -> Iterator[str]:
    """The dotted paths of a list of keys.

    >>> list(paths_of({"": "history", "blend": "falloff_percent_per_deg"}))
    ['history', 'blend.falloff_percent_per_deg']
    """
    for place, keys in lists.items():
        yield from (f"{place}.{key}" if place else key for key in keys.split())


def shared_tables(table: VenueTable) -> tuple[dict[str, Any], list[str]]:
    """The keys of a venue.toml that may be shared, and the dotted paths of the others that it has."""
    whole = table.model_dump(mode="json", exclude_unset=True)
    kept = table.model_dump(mode="json", exclude_unset=True, include=_included())
    return kept, list(_missing(whole, kept, ""))


def _included() -> dict[str, Any]:
    """`SHARED` as pydantic takes it."""
    found: dict[str, Any] = {}
    for path in paths_of(SHARED):
        *places, key = path.split(".")
        inner = found
        for place in places:
            inner = inner.setdefault("__all__" if place == "*" else place, {})
        inner[key] = True
    return found


def _missing(whole: Mapping[str, Any], kept: Mapping[str, Any], where: str) -> Iterator[str]:
    for key, value in whole.items():
        if key not in kept:
            yield f"{where}{key}"
        elif isinstance(value, dict):
            yield from _missing(value, kept[key], f"{where}{key}.")

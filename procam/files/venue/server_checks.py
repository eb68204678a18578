"""Checks of a venue.toml with a media server that is fed with dome masters."""

from collections.abc import Iterator

from procam.files.venue.tables import DomeTable, ProjectorTable, VenueTable

MIN_PX, MAX_PX = 512, 16384  # of a master, for tags that a camera reads
DOME_MASTER = "dome-master"
OF_MASTERS, OF_PROJECTORS = ("fov_deg", "rotation_deg"), ("lens",)


def server_mistakes(table: VenueTable) -> Iterator[str]:
    """One line for each entry that contradicts a projector of kind "dome-master"."""
    for name, projector in table.projectors.items():
        where, is_server = f"projectors.{name}", projector.kind == DOME_MASTER
        for key in OF_PROJECTORS if is_server else OF_MASTERS:
            if key in projector.model_fields_set:
                other = "projector" if is_server else DOME_MASTER
                yield (
                    f"{where}.{key} belongs to kind = {other!r}, and this kind is {projector.kind!r}; remove "
                    "it or correct the kind"
                )
        if is_server:
            yield from _master_mistakes(where, projector, table)


def _master_mistakes(where: str, projector: ProjectorTable, table: VenueTable) -> Iterator[str]:
    width, height = projector.size
    if width != height or not MIN_PX <= width <= MAX_PX:
        yield (
            f"{where}.size is {width}x{height}; it must be a square of {MIN_PX} to {MAX_PX} px. Give the "
            "size of the dome masters that the server plays"
        )
    if len(table.projectors) > 1:
        yield (
            f"{where}.kind is {DOME_MASTER!r}, which must be the only projector; remove the "
            f"{len(table.projectors) - 1} others, which the server drives"
        )
    if not isinstance(table.screen, DomeTable):
        yield (
            f"{where}.kind is {DOME_MASTER!r}, and the screen is a {table.screen.kind}; name the projectors "
            "themselves"
        )
    elif table.screen.radius_m is None:
        yield (
            "screen.radius_m is missing: with a projector of kind "
            f"{DOME_MASTER!r} the dome's radius in metres is needed to place the camera; add it"
        )
    if table.distances:
        yield (
            f"distances are not used with a projector of kind {DOME_MASTER!r}, because radius_m gives the "
            "size; remove them"
        )

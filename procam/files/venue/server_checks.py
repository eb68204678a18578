"""What is wrong with a venue.toml that has a media server fed with dome masters."""

from collections.abc import Iterator

from procam.files.venue.tables import ProjectorTable, VenueTable

SMALLEST_PX, LARGEST_PX = 512, 16384  # of a master, for tags that a camera reads
DOME_MASTER = "dome-master"
OF_MASTERS, OF_PROJECTORS = ("fov_deg", "rotation_deg"), ("lens",)


def server_complaints(table: VenueTable) -> Iterator[str]:
    """What does not go with projectors of kind "dome-master", a line each."""
    for name, projector in table.projectors.items():
        where, is_server = f"projectors.{name}", projector.kind == DOME_MASTER
        for key in OF_PROJECTORS if is_server else OF_MASTERS:
            if key in projector.model_fields_set:
                other = "projector" if is_server else DOME_MASTER
                yield (
                    f"{where}.{key}: got an entry with kind = {projector.kind!r}, expected none; it "
                    f"belongs to kind = {other!r}: remove it or correct the kind"
                )
        if is_server:
            yield from _master_complaints(where, projector, table)


def _master_complaints(where: str, projector: ProjectorTable, table: VenueTable) -> Iterator[str]:
    width, height = projector.size
    if width != height or not SMALLEST_PX <= width <= LARGEST_PX:
        yield (
            f"{where}.size: got {width}x{height}, expected a square of {SMALLEST_PX} to {LARGEST_PX} px; "
            "give the size of the dome masters that the server plays"
        )
    if len(table.projectors) > 1:
        yield (
            f"{where}.kind: got {DOME_MASTER!r} beside {len(table.projectors) - 1} other projectors, "
            "expected it alone; those behind the server are the server's: remove them"
        )
    if table.screen.radius_m is None:
        yield (
            "screen.radius_m: got nothing, expected the dome's radius in metres with a projector of kind "
            f"{DOME_MASTER!r}: it tells where the camera stands; add it"
        )
    if table.distances:
        yield (
            f"distances: got {len(table.distances)} with a projector of kind {DOME_MASTER!r}, expected none; "
            "radius_m gives the size: remove them"
        )

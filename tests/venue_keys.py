"""All keys that venue.toml can hold, from its tables; and files that together have each of them."""

from collections.abc import Iterator
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from procam.files.venue.sharing import PRIVATE, paths_of
from procam.files.venue.tables import VenueTable

# text that is planted in `EVERY_KEY`, in pictures and in files beside it; none may leave the venue
PLANTED = {
    "ssh host": "door.lobby.example",
    "bearer token": "eyJhbGciOiJIUzI1NiJ9",
    "e-mail address": "annika@planetarium.example",
    "user name": "annika",
    "serial port": "ttyS7",
    "IP address": "10.1.2.3",
    "password": "s3cret-w0rd",
    "absolute path": "/home/kuppel/rig",
    "web address": "hooks.example/T0K3N",
    "place of a photograph": "48.137154",
    "serial number": "SN-0042917",
    "computer": "booth-pc.local",
    "client": "Sternwarte Musterstadt",
    "time of day": "2000000000",
}
EVERY_KEY = """\
# annika@planetarium.example, for Sternwarte Musterstadt
[screen]
kind = "dome"
radius_m = 6.0
half_angle_deg = 90.0
tilt_deg = 0.0
floor_albedo = 0.1
floor_albedo_sigma = 0.05
masks = [[[0, 5], [9, 5], [5, 9]]]
protected = ["annika/desk.png"]
map_size = 512

[cameras.zenith]
backend = "acme"
size = [60, 60]
model = "kannala-brandt"
f = [19.0, 19.0]
c = [29.5, 29.5]
k = [0.0, 0.0, 0.0, 0.0]
intrinsics = "prior"
response = "solve"
brackets = "annika"
bits = 12
black_level = 64.0
vignetting = [0.1]
glare = 0.01
glare_sigma = 0.01
masks = []

[projectors.south]
backend = "acme"
size = [64, 40]
kind = "projector"
lens = "brown"
masks = ["annika/desk.png"]
control = {protocol = "escvp21", port = "/dev/ttyS7"}
nudges = [{pixel = [30.0, 20.0], shift_px = [0.5, 0.0]}]

[[fiducials]]
name = "annika@planetarium.example"
camera = "zenith"
pixel = [40.0, 30.0]
sigma_px = 0.3
azimuth_deg = 0.0
elevation_deg = 60.0
sigma_deg = 0.1

[[fiducials]]
name = "Sternwarte Musterstadt, 10.1.2.3"
projector = "south"
pixel = [4.0, 4.0]
azimuth_deg = 90.0
sigma_deg = 0.1

[[apriltags]]
family = "36h11"
id = 3
azimuth_deg = 10.0
elevation_deg = 40.0
sigma_deg = 0.1

[[distances]]
a = "annika@planetarium.example"
b = "south"
metres = 5.0
sigma_m = 0.01

[capture]
exposure_s = 0.13
black_exposure_s = 6.5
shot_s = 2.0

[blend]
falloff_percent_per_deg = 0.5

[history]
keep_sessions = 3

[acceptance]
coverage = 0.9

[unattended]
interlock = "ssh annika@door.lobby.example /home/kuppel/rig/empty"
begin = "00:00"
end = "23:59"
power_on = true
notify = "curl -H 'Authorization: Bearer eyJhbGciOiJIUzI1NiJ9' https://hooks.example/T0K3N"

[acme]
host = "10.1.2.3"
password = "s3cret-w0rd"
camera = {serial = "SN-0042917", computer = "booth-pc.local"}
"""
ROOM_MARKS = ("canvas_m", "point_m", "sigma_m")
OF_ROOMS = {
    *(f"screen.{key}" for key in "width_m depth_m height_m arc_deg lit others".split()),
    *(f"screen.{key}" for key in "file canvas origin_m smooth".split()),
    *("screen.other_albedo", "screen.other_albedo_sigma"),
    *(f"{mark}.*.{key}" for mark in ("fiducials", "apriltags") for key in ROOM_MARKS),
}
OF_SERVERS = {"projectors.*.fov_deg", "projectors.*.rotation_deg"}  # no projector may have them


def with_server(text: str) -> str:
    """`EVERY_KEY` for a media server, which has no lens and no distances."""
    head, _, rest = text.partition("[[distances]]")
    text = head + "[capture]" + rest.partition("[capture]")[2]
    server = 'kind = "dome-master"\nfov_deg = 170.0\nrotation_deg = 5.0'
    text = text.replace('kind = "projector"\nlens = "brown"', server)
    return text.replace("size = [64, 40]", "size = [512, 512]").replace(
        'masks = ["annika/desk.png"]\n', ""
    )


def leaves(model: type[BaseModel] = VenueTable, where: str = "") -> dict[str, Any]:
    """Types by the dotted paths of keys, with `*` for devices and entries; a private table is one key."""
    found: dict[str, Any] = {}
    for key, info in model.model_fields.items():
        path, inner = f"{where}{key}", list(_tables(info.annotation))
        if not inner or path in paths_of(PRIVATE):
            found[path] = info.annotation
            continue
        for star, table in inner:
            found |= leaves(table, f"{path}{star}.")
    return found


def _tables(kind: Any) -> Iterator[tuple[str, type[BaseModel]]]:
    """The tables that a type may hold; `.*` if it holds several."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield "", kind
    for each in get_args(kind):
        several = get_origin(kind) in (dict, list)
        for star, table in _tables(each):
            yield (".*" if several else star), table


def keys_of(tables: dict[str, Any]) -> set[str]:
    """The paths of `leaves` that tables have."""
    return {path for path in leaves() if _has(tables, path.split("."))}


def _has(value: Any, parts: list[str]) -> bool:
    if not parts:
        return True
    if parts[0] == "*":
        inner = value.values() if isinstance(value, dict) else value
        return any(_has(each, parts[1:]) for each in inner)
    return isinstance(value, dict) and parts[0] in value and _has(value[parts[0]], parts[1:])

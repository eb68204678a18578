"""The venue.toml of a simulated venue, with what an owner would know of it.

`python -m simulators.template PRESET` (or `server`, `small`, `six-projectors`, `box`, `cylinder`, `room`)
prints one; it wrote those in calib_data/venues. The module is longer than 300 lines because domes, rooms
and servers share the parts of the file.
"""

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from procam.arrays import Array
from procam.maths.geometry.sphere import direction_from_angles
from simulators.builds import CameraBuild
from simulators.drawn_rooms import CLICK_PX, GLARE_SHARE, SURVEY_DEG, Known, draw_room, known_camera
from simulators.placement import place_cameras, place_projectors
from simulators.presets import PRESETS, Overrides, Preset, PresetName, white_exposure_s
from simulators.room_obj import L_LENGTHS, L_LIT, MESH_KEYS
from simulators.scene import SceneSize
from simulators.server import NAME as SERVER
from simulators.surface import Surface
from simulators.wall_placement import place_wall_cameras, place_wall_projectors
from simulators.walled_room import WalledSurface
from simulators.walls import Wall, canvas_corners, walls_of

FIDUCIALS_DEG = {"front": (12.0, 35.0), "left": (130.0, 30.0), "right": (-110.0, 50.0)}
BLACK_EXPOSURE_S = 6.5
OWNER_SEED = 1  # of the errors of what the owner has measured
SMALL = SceneSize(projector_size=(320, 200), camera_size=(480, 480), rays=512)
SIX_PROJECTORS = SceneSize(projectors=6)
SIZES = {"small": SMALL, "six-projectors": SIX_PROJECTORS}
SERVER_EXPOSURE_S = 0.2  # soft edges reduce the light of each projector
OTHER_ALBEDO = 0.2
OTHERS = ("left", "front", "right", "back", "floor", "ceiling")
ROOMS: dict[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "box": (
        {"width_m": 6.0, "depth_m": 5.0, "height_m": 3.0},
        ("left", "front", "right", "floor"),
    ),
    "cylinder": ({"radius_m": 5.0, "arc_deg": 120.0, "height_m": 3.0}, ("wall",)),
    "L": (L_LENGTHS, L_LIT),
}
MARKS_AT = ((0.08, 0.12), (0.92, 0.12), (0.5, 0.5), (0.08, 0.88), (0.92, 0.88))  # of each lit wall
SURVEY_M = 0.003  # standard error of a mark's position
ROOM_MARKS = """\
# Marks on the walls whose position on the canvas is known, in metres from its upper left corner, and the
# camera pixels where they are. `procam venue canvas` draws what lies where.

"""
MARKS = """\
# Marks on the dome whose position is known, and the camera pixels where they are. Printed AprilTags need no
# pixel: [[apriltags]] with id, azimuth_deg, elevation_deg, sigma_deg, and family if it is not 36h11.

"""


def venue_text(
    preset_name: PresetName,
    size: SceneSize | None = None,
    seed: int = 1,
    **overrides: Unpack[Overrides],
) -> str:
    """A complete venue.toml for a preset, with the fiducials where the camera sees them."""
    preset, size = PRESETS[preset_name].altered(**overrides), size or SceneSize()
    tail = _tail(preset_name, white_exposure_s(preset), size, seed) + _overrides(overrides)
    return _text(f'dome, preset "{preset_name}"', preset, _known(preset, size), size, tail)


def room_text(number: int, size: SceneSize | None = None, seed: int = 1) -> str:
    """A complete venue.toml for a room drawn at random, as its owner knows it."""
    size = size or SceneSize()
    room = draw_room(number, size.camera_size)
    size = replace(size, projectors=room.projectors)
    tail = _tail("standard", white_exposure_s(room.preset), size, seed) + f"room = {number}\n"
    return _text(f"dome, room {number}", room.preset, room.known, size, tail)


def server_text(
    size: SceneSize | None = None, server_size: int = 1024, preset_name: PresetName = "standard"
) -> str:
    """A complete venue.toml of a dome behind a media server."""
    preset, size = PRESETS[preset_name], size or SceneSize()
    known = replace(_known(preset, size), intrinsics="fixed")  # tags cannot solve a lens too
    parts = [
        _head(f'dome behind a media server, preset "{preset_name}"', preset, known, size),
        *(_camera(camera, preset, known) for camera in known.cameras),
        _server(server_size),
        _tail(preset_name, SERVER_EXPOSURE_S, size, 1).replace(
            "white of one projector", "the server's full white"
        ),
    ]
    return "\n".join(parts) + f"server = true\nserver_size = {server_size}\n"


def walls_text(
    kind: str,
    size: SceneSize | None = None,
    preset_name: PresetName = "standard",
    patch_m: float = 0.25,
    **built: float,
) -> str:
    """A complete venue.toml of a "box", a "cylinder" or an "L"; `built` are lengths that its owner has wrong.

    An L is a mesh, whose file is that of `room_obj.obj_text`.
    """
    preset, size = PRESETS[preset_name], size or SceneSize(cameras=2)
    stated, lit = ROOMS[kind]
    walls = walls_of(kind, stated | built)
    surface = WalledSurface(
        preset, tuple(walls), frozenset(lit), dict.fromkeys(OTHERS, OTHER_ALBEDO), patch_m
    )
    cameras = tuple(place_wall_cameras(surface, size.cameras, size.camera_size))
    rng = np.random.default_rng(OWNER_SEED)
    believed = (
        tuple(known_camera(rng, c, by_board=True) for c in cameras) if preset.noisy else cameras
    )
    known = replace(_known(preset, size), cameras=believed)
    names = [b.name for b in place_wall_projectors(surface, size.projectors, (64, 40))]
    parts = [
        _room_head(kind, stated, lit, size),
        *(_camera(camera, preset, known) for camera in believed),
        *(_projector(name, size.projector_size) for name in names),
        ROOM_MARKS
        + "\n".join(_wall_fiducials(c, walls_of(kind, stated), surface, rng) for c in cameras),
        _tail(preset_name, white_exposure_s(preset), size, 1),
        _walls_table(kind, stated | built, lit, patch_m),
    ]
    return "\n".join(parts)


def _room_head(kind: str, lengths: dict[str, float], lit: Sequence[str], size: SceneSize) -> str:
    map_size = f"map_size = {size.map_size}\n" if size.map_size else ""
    numbers = "".join(f"{key} = {value}\n" for key, value in lengths.items())
    which = (
        f"lit = {json.dumps(list(lit))}   # parts that projectors light\n" if kind == "box" else ""
    )
    shape = MESH_KEYS if kind == "L" else f'kind = "{kind}"\n{numbers}{which}'
    title = {"L": "room of the shape of an L"}.get(kind, kind)
    return f"""\
# A simulated {title}. It has every key that a real venue needs, with its unit.

[screen]
{shape}other_albedo = {OTHER_ALBEDO}          # an estimate for the parts that are not lit, and its
other_albedo_sigma = 0.05   # standard error; what cameras see of them is measured
{map_size}"""


def _wall_fiducials(
    camera: CameraBuild, known: Sequence[Wall], surface: WalledSurface, rng: np.random.Generator
) -> str:
    """Marks on lit walls where a camera sees them, by what the owner knows of the room.

    They are on the canvas, but in space in an L, of which a mesh is known.
    """
    is_mesh = "inner-front" in (wall.name for wall in known)
    corners, lines = {} if is_mesh else canvas_corners(known, surface.lit), list[str]()
    survey_rng = np.random.default_rng(OWNER_SEED)  # the same errors for all cameras
    survey = {
        (wall.name, number): SURVEY_M * survey_rng.normal(size=2)
        for wall in known
        for number in range(len(MARKS_AT))
    }
    for built, wall in zip(surface.walls, known, strict=True):
        for number, at in enumerate(MARKS_AT if wall.name in surface.lit else ()):
            point = built.points(*np.array(at))
            pixel = camera.pixels(camera.camera_from_dome.apply(point)) + CLICK_PX * rng.normal(
                size=2
            )
            if not camera_sees(camera, surface, point, pixel):
                continue
            off = survey[wall.name, number]
            if wall.name in corners:
                place = np.array(corners[wall.name]) + np.array(at) * wall.size_m + off
            else:
                place = wall.points(*(np.array(at) + off / wall.size_m))
            key = "canvas_m" if wall.name in corners else "point_m"
            lines.append(f"""\
[[fiducials]]
name = "{wall.name}-{number + 1}"
{key} = [{", ".join(f"{x:.4f}" for x in place)}]
sigma_m = {SURVEY_M}
camera = "{camera.name}"
pixel = [{pixel[0]:.2f}, {pixel[1]:.2f}]
sigma_px = {CLICK_PX}
""")
    return "\n".join(lines)


def camera_sees(camera: CameraBuild, surface: WalledSurface, point: Array, pixel: Array) -> bool:
    """Whether a point (3,) lies in a camera's picture circle, and nothing before it."""
    radius = np.linalg.norm(pixel - camera.lens.centre)
    eye = camera.camera_from_dome.inverse().translation
    return bool(radius < 0.47 * min(camera.size) and surface.sees(eye, point[None])[0])


def _walls_table(kind: str, lengths: dict[str, float], lit: Sequence[str], patch_m: float) -> str:
    values = ", ".join(f"{key} = {value}" for key, value in lengths.items())
    return f"""\
[simulated.walls]
kind = "{kind}"
lengths = {{ {values} }}
lit = {json.dumps(list(lit))}
other_albedo = {OTHER_ALBEDO}
patch_m = {patch_m}
"""


def _text(title: str, preset: Preset, known: Known, size: SceneSize, tail: str) -> str:
    names = [b.name for b in place_projectors(size.projectors, (64, 40), preset)]
    cameras = place_cameras(size.cameras, size.camera_size, size.camera_kind, preset)
    parts = [
        _head(title, preset, known, size),
        *(_camera(camera, preset, known) for camera in known.cameras),
        *(_projector(name, size.projector_size) for name in names),
        MARKS + "\n".join(_fiducials(camera, preset, known) for camera in cameras),
        tail,
    ]
    return "\n".join(parts)


def _known(preset: Preset, size: SceneSize) -> Known:
    """What the owner of a preset's venue has measured; without noise everything is exact."""
    # the owner has compared a grey card with the carpet, and recognises black paint
    floor = (0.1, 0.03) if preset.floor_albedo else (0.0, 0.01)
    glare = (preset.glare, GLARE_SHARE * preset.glare) if preset.glare_known else (0.0, 0.01)
    cameras = tuple(place_cameras(size.cameras, size.camera_size, size.camera_kind, preset))
    known = Known(preset.half_angle_deg, preset.tilt_deg, floor, glare, cameras)
    if not preset.noisy:
        return known
    rng = np.random.default_rng(OWNER_SEED)
    believed = tuple(known_camera(rng, camera, by_board=True) for camera in cameras)
    return replace(
        known,
        glare=(round(float(rng.normal(*glare)), 5) if preset.glare_known else glare[0], glare[1]),
        cameras=believed,
        intrinsics="prior",
        survey_deg=SURVEY_DEG,
        click_px=CLICK_PX,
        seed=OWNER_SEED,
    )


def _server(size: int) -> str:
    return f"""\
[projectors.{SERVER}]
kind = "dome-master"       # a media server that drives the projectors: aligned, blended, fed with masters
backend = "simulated"
size = [{size}, {size}]        # of the dome masters it plays [px]
fov_deg = 180.0            # of the master, from edge to edge of its circle
rotation_deg = 0.0         # azimuth at which its bottom edge is shown
control = {{ protocol = "escvp21", port = "backend" }}  # or a device such as "/dev/ttyUSB0"
"""


def _head(title: str, preset: Preset, known: Known, size: SceneSize) -> str:
    map_size = f"map_size = {size.map_size}\n" if size.map_size else ""
    return f"""\
# A simulated {title}. It has every key that a real venue needs, with its unit.

[screen]
kind = "dome"
radius_m = {preset.radius_m}
half_angle_deg = {known.half_angle_deg}      # pole to rim: all of the cap that reflects, lit or not
tilt_deg = {known.tilt_deg}            # lean of the pole towards the audience's front
floor_albedo = {known.floor[0]}        # an estimate for the deck under the dome; it affects the
floor_albedo_sigma = {known.floor[1]}  # albedo only, never the compensation
{map_size}"""


def _camera(camera: CameraBuild, preset: Preset, known: Known) -> str:
    lens = camera.lens
    bits = camera.bits if preset.noisy else 16
    return f"""\
[cameras.{camera.name}]
backend = "simulated"
size = {list(camera.size)}
model = "{lens.kind}"
f = {_numbers(lens.focal)}        # focal lengths [px]
c = {_numbers(lens.centre)}       # principal point [px]; (0, 0) is the centre of the first pixel
k = {_numbers(lens.distortion)}
intrinsics = "{known.intrinsics}"      # "fixed": f, c and k are exact; "prior": nearly; "solve": a guess
response = "linear"
bits = {bits}
black_level = {camera.black_level}
vignetting = {_numbers(camera.vignetting)}   # 1 + v1 theta^2 + v2 theta^4, theta off the axis [rad]
glare = {known.glare[0]}              # veiling glare: share of the frame's mean that is added to every pixel
glare_sigma = {known.glare[1]:g}
"""


def _projector(name: str, size: tuple[int, int]) -> str:
    return f"""\
[projectors.{name}]
backend = "simulated"
size = {list(size)}
control = {{ protocol = "escvp21", port = "backend" }}  # or a device such as "/dev/ttyUSB0"
"""


def _fiducials(camera: CameraBuild, preset: Preset, known: Known) -> str:
    surface, lines = Surface.build(preset), []
    rng = None if known.seed is None else np.random.default_rng(known.seed)
    for name, (azimuth, elevation) in FIDUCIALS_DEG.items():
        direction = direction_from_angles(np.radians(azimuth), np.radians(elevation))
        point = direction * surface.radius(direction)
        pixel = camera.pixels(camera.camera_from_dome.apply(point))
        off_deg, off_px = np.zeros((2, 2)) if rng is None else rng.normal(size=(2, 2))
        off_deg = known.survey_deg * off_deg / (np.cos(np.radians(elevation)), 1.0)
        pixel = pixel + known.click_px * off_px
        lines.append(f"""\
[[fiducials]]
name = "{name}"
azimuth_deg = {round(azimuth + off_deg[0], 5)}
elevation_deg = {round(elevation + off_deg[1], 5)}
sigma_deg = {known.survey_deg}
camera = "{camera.name}"
pixel = [{pixel[0]:.2f}, {pixel[1]:.2f}]
sigma_px = {known.click_px}           # a click by hand has about 0.3
""")
    return "\n".join(lines)


def _tail(name: str, exposure_s: float, size: SceneSize, seed: int) -> str:
    return f"""\
[capture]
exposure_s = {exposure_s}       # white of one projector just below saturation
black_exposure_s = {BLACK_EXPOSURE_S}  # black is dim

# For `verify` and `recalibrate` with --unattended: when projectors may be lit with nobody there, and a
# program that ends with 0 within 2 s if the dome is empty. No shell runs it: && | ; < > $ * are refused,
# write a script for them.
# [unattended]
# interlock = "/usr/local/bin/dome-is-empty"
# begin = "03:00"          # local times
# end = "05:30"

[simulated]  # settings of the simulator
preset = "{name}"
seed = {seed}
projectors = {size.projectors}
projector_size = {list(size.projector_size)}
cameras = {size.cameras}
camera_size = {list(size.camera_size)}
camera_kind = "{size.camera_kind}"
rays = {size.rays}
"""


def _overrides(overrides: Overrides) -> str:
    return "".join(f"{key} = {value}\n" for key, value in overrides.items() if value is not None)


def _numbers(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{v:.6f}".rstrip("0").rstrip(".") for v in values) + "]"


def example_text(name: str) -> str:
    """The venue.toml of an example in calib_data/venues, without its "simulated-"."""
    if name == SERVER:
        return server_text()
    if name in SIZES:
        return venue_text("standard", SIZES[name])
    if name in ROOMS or name == "room":
        return walls_text("L" if name == "room" else name)
    return venue_text(name)  # type: ignore[arg-type]


if __name__ == "__main__":
    sys.stdout.write(example_text(sys.argv[1]))

"""Files of every kind that procam reads, each as procam or another program writes it."""

import hashlib
import json
import shutil
import struct
import zipfile
from pathlib import Path

import av
import cv2
import numpy as np

from procam.files.bundle.write import writing_bundle
from procam.files.form_factors import write_form_factors
from procam.files.history.record import recorded
from procam.files.images.pixels import write_image
from procam.files.mesh_file import write_mesh
from procam.files.output_log import OutputLog
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.maths.mesh.rooms import planned_room
from procam.model.frame import CameraSettings, Frame
from procam.model.plan import Plan, Shot
from procam.model.screen import RoomScreen
from procam.workflows.capture.settings import keep_settings
from procam.workflows.photographs.driven import Wanted
from procam.workflows.photographs.rounds import Rounds
from simulators.room_obj import obj_text
from simulators.scene import SceneSize
from simulators.template import venue_text
from studies.preference import answers, plan

CALIBRATION, SESSION = "venue/calibrations/0001", "venue/sessions/0001"
SMALL = SceneSize(projectors=1, projector_size=(64, 40), camera_size=(60, 60), rays=64)
SHOTS = (
    Shot("dark", "", "", "dark", (0.13,)),
    Shot("south-0000", "south", "patterns/south/0000.png", "white", (0.13,), "mono"),
)
CODE = (
    'order = ["white", "black", "columns-phase", "columns-gray", "rows-phase", "rows-gray"]\n'
    + "".join(
        f"[{axis}]\nperiods_px = [16, 18]\nsteps = 3\ngray_cell_px = 16\n"
        for axis in ("columns", "rows")
    )
)
METER = "projector,patch,azimuth_deg,elevation_deg,Y,x,y\n" + "".join(
    f"south,{patch},10,40,{light},0.31,0.33\n"
    for patch, light in (("white", 11.5), ("black", 0.02))
)
ROOM = RoomScreen("box", (4.0, 4.0, 3.0), ("front",))
vars(ROOM)["room"] = planned_room(ROOM.kind, ROOM.size, ROOM.lit, 300)  # in a moment
WANTED = Wanted({"south": np.zeros((80, 128, 3), np.float32)}, 0.1)


def all_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def rounds_in(folder: Path) -> Rounds:
    """The rounds of photographs in a folder of a venue's sessions."""
    return Rounds(folder, load_venue(folder.parents[1]).cameras["zenith"], 0.1, "a sky")


def make_files(folder: Path) -> None:
    """Add pictures, movies, tables and more to a folder whose `venue` has a session and a calibration."""
    light = np.random.default_rng(0).random((48, 64, 3))
    _pictures(folder, light)
    _movies(folder, light)
    rounds_in(folder / "venue/sessions/refine-0001").ask([WANTED])
    keep_settings(Session(folder / SESSION), "zenith", {"ISO": 100.0, "aperture f/": 4.0})
    (folder / CALIBRATION).with_name("in-use").write_text("0001\n")
    with recorded(folder / "venue", "solve"):
        pass
    loop = {"session": "0001", "residual": [0.1, 0.01], "noise_floor": 0.004, "unseen": [0.1, 0.02]}
    (folder / "loop").mkdir()
    (folder / "loop" / "loop.json").write_text(json.dumps(loop))
    (folder / "locked").mkdir()
    (folder / "locked" / ".lock").write_text("`procam verify` (process 17)")
    (folder / "code.toml").write_text(CODE)
    write_form_factors(folder / "form-factors.npz", ROOM)
    write_mesh(folder / "screen.npz", ROOM.room)
    (folder / "room.obj").write_text(obj_text())
    (folder / "meter.csv").write_text(METER)
    (folder / "response.csv").write_text("level,light\n0,0\n0.3,0.1\n0.8,0.6\n1,1\n")
    (folder / "photographs.csv").write_text("file,shot\na.png,dark\nb.png,south-0000\n")
    OutputLog(folder / "outputs.jsonl", "key").add(folder / "code.toml", [1, 2], {"peak": 0.7})
    _bundles(folder)
    _profiles(folder)
    _preference_test(folder / "asked")


def _pictures(folder: Path, light: np.ndarray) -> None:
    coded = (light * 255).astype(np.uint8)
    write_image(folder / "still.png", coded)
    write_image(folder / "square.png", coded[:, :48])
    write_image(folder / "frames/south.png", (light * 65535).astype(np.uint16))
    write_image(folder / "still.tif", (light * 65535).astype(np.uint16))
    write_image(folder / "still.exr", light.astype(np.float32), ("R", "G", "B"))
    cv2.imwrite(str(folder / "photo.jpg"), coded)
    (folder / "frames.rgb").write_bytes(coded.tobytes() * 2)


def _movies(folder: Path, light: np.ndarray) -> None:
    for name, codec, layout in (
        ("movie.mkv", "ffv1", "bgr0"),
        ("movie.mov", "prores_ks", "yuv422p10le"),
    ):
        with av.open(str(folder / name), "w") as movie:
            stream = movie.add_stream(codec, rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, layout
            for shift in range(4):
                rgb = np.roll((light * 255).astype(np.uint8), shift, axis=1)
                frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
                movie.mux(stream.encode(frame.reformat(format=layout)))
            movie.mux(stream.encode())


def _bundles(folder: Path) -> None:
    """A bundle of two frames, its files, and a data set of it."""
    small = folder / "small"
    small.mkdir()
    (small / "venue.toml").write_text(venue_text("standard", SMALL).split("[simulated]")[0])
    session, bundle = Session(small / "sessions/0001"), folder / "bundle.zip"
    session.write_plan(Plan(SHOTS), {SHOTS[1].pattern: np.full((40, 64), 255, np.uint8)})
    for shot in SHOTS:
        counts = np.ones((60, 60) if shot.pixel_format == "mono" else (60, 60, 3), np.uint16)
        session.store(
            "zenith", shot, 0.13, Frame(counts, CameraSettings(0.13, shot.pixel_format), 0, 1)
        )
    result_of(writing_bundle(load_venue(small), session, bundle))
    with recorded(small, "capture"):
        pass
    with zipfile.ZipFile(bundle) as archive:
        archive.extractall(folder / "forged")
    dataset = folder / "dataset"
    shutil.copytree(folder / CALIBRATION, dataset / "truth/room")
    (dataset / "bundles").mkdir()
    shutil.copy(bundle, dataset / "bundles/one.zip")
    document = {
        "schema_version": 1,
        **dict.fromkeys(("procam", "license", "command"), "-"),
        "sessions": [{"name": "one", "room": "room", "seed": 1}],
        "files": {
            path.relative_to(dataset).as_posix(): {
                "bytes": path.stat().st_size,
                "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            }
            for path in all_files(dataset)
        },
    }
    (dataset / "dataset.json").write_text(json.dumps(document))


def _profiles(folder: Path) -> None:
    """An ICC profile, chunks of a PNG, and chromaticities, all of Rec.2020."""

    def fixed(*values: float) -> bytes:
        return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))

    columns = (0.6734, 0.2790, -0.0019), (0.1656, 0.6753, 0.0299), (0.1251, 0.0456, 0.7971)
    tags = {b"desc": b"desc" + bytes(4) + struct.pack(">I", 8) + b"Rec.2020"}
    for letter, column in zip((b"r", b"g", b"b"), columns, strict=True):
        tags[letter + b"XYZ"] = b"XYZ " + bytes(4) + fixed(*column)
        tags[letter + b"TRC"] = b"para" + bytes(4) + struct.pack(">HH", 0, 0) + fixed(2.2)
    table, body, start = b"", b"", 132 + 12 * len(tags)
    for tag, data in tags.items():
        table += struct.pack(">4sII", tag, start + len(body), len(data))
        body += data
    head = struct.pack(">I12s4s4s104s", start + len(body), b"", b"RGB ", b"XYZ ", b"")
    (folder / "profile.icc").write_bytes(head + struct.pack(">I", len(tags)) + table + body)
    white, points = (0.3127, 0.329), (0.708, 0.292, 0.17, 0.797, 0.131, 0.046)
    (folder / "primaries.bin").write_bytes(struct.pack("<8f", *points, *white))
    chunks = {
        b"gAMA": struct.pack(">I", 45455),
        b"cHRM": struct.pack(">8I", *(round(1e5 * value) for value in (*white, *points))),
    }
    (folder / "chunks.bin").write_bytes(
        b"".join(struct.pack(">H", len(data)) + name + data for name, data in chunks.items())
    )


def _preference_test(folder: Path) -> None:
    folder.mkdir()
    asked = plan.Plan(
        id="abc",
        version="1",
        command="ask",
        calibration="0001",
        on_dome=True,
        settings={"db": 1.0},
        methods=("exact", "none"),
        pairs=(("exact", "none"),),
        catch=None,
        repeats=1,
        seed=1,
        contents=(plan.Content(name="sky", source="sky.png", size_px=64, scale=1.0),),
        pictures={
            n: plan.Picture(content="sky", method=m) for n, m in (("a", "exact"), ("b", "none"))
        },
        questions=(plan.Question(content="sky", pictures=("a", "b"), times=1, catch=False),),
    )
    (folder / plan.PLAN).write_text(asked.to_json())
    lines = f"{','.join(answers.COLUMNS)}\nabc,Annika,1,sky,a,b,a,1,1200,3\n"
    (folder / "answers.csv").write_text(lines)

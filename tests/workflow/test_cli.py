"""The command line: help, text and JSON, and one clear line for everything that is wrong."""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_venue import (
    CAMERA,
    TINY_PAIR,
    Stage,
    contents,
    make_venue,
    procam,
    refused,
    take_session,
    warped,
    watch_stage,
)

from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import projector_frames
from procam.devices.protocols import BackendRig
from procam.files.images.layers import RGB, read_channels, write_channels
from procam.files.images.pixels import read_image, write_image
from procam.files.session import Session
from procam.files.venue.load import Venue, load_venue, template_names
from procam.interfaces.cli.main import COMMANDS as MAIN_COMMANDS
from procam.interfaces.cli.main import GROUPS, PANELS
from procam.model.calibration import Calibration
from procam.workflows import venue_rig
from procam.workflows.sample_content import half_sky
from procam.workflows.venue_rig import open_rig
from simulators.devices import SimulatedCamera

COMMANDS = list(MAIN_COMMANDS)
SIZE = 96


class TestHelp:
    def test_the_version(self) -> None:
        assert procam("--version").out == f"procam {version('procam')}\n"

    @pytest.mark.parametrize(
        ("words", "completed"), [("procam re", "refine"), ("procam refine --ph", "--photos")]
    )
    def test_a_shell_completes_commands_and_options(self, words: str, completed: str) -> None:
        asked = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
        found = subprocess.run(
            [Path(sys.executable).with_name("procam")],
            env=os.environ | asked | {"_PROCAM_COMPLETE": "complete_bash"},
            capture_output=True,
            text=True,
            check=True,
        )
        assert completed in found.stdout.split()

    def test_an_error_is_a_document_for_scripts(self, tmp_path: Path) -> None:
        ran = procam("refine", tmp_path / "nowhere", "--json")
        assert (ran.code, json.loads(ran.out)["exit_code"]) == (2, 2)
        assert f"procam: {json.loads(ran.out)['error']}" == ran.complaint

    def test_the_list_is_grouped(self) -> None:
        text = procam("--help").out
        listed = [
            [f"─ {panel} ─", *(f"│ {name.split()[0]} " for name in PANELS[panel])]
            for panel in PANELS
        ]
        places = [text.index(entry) for entry in chain.from_iterable(listed)]
        assert places == sorted(places)
        for group in GROUPS:
            inner = [name.split()[1] for name in MAIN_COMMANDS if name.startswith(f"{group} ")]
            assert all(f"│ {name} " in procam(group, "--help").out for name in inner)

    @pytest.mark.parametrize("command", COMMANDS)
    def test_every_command_explains_itself_with_an_example(self, command: str) -> None:
        ran = procam(*command.split(), "--help")
        assert ran.code == 0
        assert re.search(rf"Example: procam {command}\b", ran.out)
        assert "--json" in ran.out

    def test_without_a_command_the_commands_are_listed(self) -> None:
        for arguments in ((), ("--help",), ("-h",)):
            ran = procam(*arguments)
            assert all(command.split()[0] in ran.out + ran.err for command in COMMANDS)


class TestInit:
    def test_writes_a_venue_that_loads(self, tmp_path: Path) -> None:
        for name in template_names():
            ran = procam("init", tmp_path / name, "--template", name, "--json")
            assert ran.code == 0
            assert json.loads(ran.out) == {"venue": str(tmp_path / name / "venue.toml")}
            assert load_venue(tmp_path / name).table.projectors

    def test_a_rig_by_hand_gets_its_pictures(self, tmp_path: Path) -> None:
        ran = procam("init", tmp_path, "--template", "by-hand")
        assert (ran.code, "then run: procam session plan " in ran.out) == (0, True)
        path = tmp_path / "venue.toml"
        path.write_text(path.read_text().replace("[1920, 1200]", "[160, 100]"))
        ran = procam("session", "plan", tmp_path, tmp_path / "out")
        assert (ran.code, ran.err) == (0, "")
        assert ran.out.count("then run: procam session add ") == 2
        assert "--camera zenith --photos" in ran.out and "--camera side --photos" in ran.out
        assert {p.stem for p in (tmp_path / "out").glob("*.m3u")} == {
            *("north", "south", "east", "north-end")
        }

    def test_never_overwrites(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_text("mine")
        assert "venue.toml exists already" in refused(
            "init", tmp_path, "--template", template_names()[0]
        )
        assert (tmp_path / "venue.toml").read_text() == "mine"

    def test_without_a_template_the_known_ones_are_listed(self, tmp_path: Path) -> None:
        complaint = refused("init", tmp_path / "new")
        assert "--template is missing: choose one of by-hand, simulated-" in complaint
        assert all(name in complaint for name in template_names())
        assert not (tmp_path / "new").exists()
        shown = procam("init", "--help").out
        assert all(name in shown for name in template_names())


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Venue:
    venue = make_venue(tmp_path_factory.mktemp("captured"))
    take_session(venue)
    return venue


class TestVenueCommands:
    def test_what_is_no_session_is_refused(self, tmp_path: Path) -> None:
        make_venue(tmp_path)
        for where in (tmp_path, tmp_path / "sessions" / "0001"):
            assert "there is no session here; give a" in procam("session", "solve", where).complaint
        assert "has no calibration" in procam("refine", tmp_path).complaint
        assert not (tmp_path / "calibrations").exists()


class TestInspect:
    def test_a_calibration(self, kept: Path) -> None:
        for where in (kept, kept / "calibration.json"):
            ran = procam("inspect", where, "--json")
            document = json.loads(ran.out)
            assert document["kind"] == "calibration"
            assert document["projectors"] == ["south", "north"]
            assert document["albedo"] == [0.46, 0.5, 0.57]
        said = procam("inspect", kept)
        assert re.search(r"kind +calibration", said.out)

    def test_a_session_and_its_plan(self, captured: Venue) -> None:
        session = Session(captured.directory / "sessions" / "0001")
        plan = session.read_plan()
        for where in (session.directory, session.directory / "plan.json"):
            document = json.loads(procam("inspect", where, "--json").out)
            assert document == {
                "kind": "session",
                "shots": len(plan.shots),
                "exposures": plan.exposures,
                "stored": {CAMERA: plan.exposures},
                "complete": True,
            }

    def test_pictures(self, kept: Path, tmp_path: Path) -> None:
        values = np.linspace(-1, 2, 12, dtype=np.float32).reshape(3, 4)
        values[0, 1] = np.nan
        write_channels(tmp_path / "a.exr", {"depth": values})
        document = json.loads(procam("inspect", tmp_path / "a.exr", "--json").out)
        assert document == {
            "kind": "image",
            "size": [4, 3],
            "depth": {"min": -1.0, "max": 2.0, "nan": 1},
        }
        write_image(tmp_path / "a.png", np.full((5, 7, 1), 9, np.uint8))
        document = json.loads(procam("inspect", tmp_path / "a.png", "--json").out)
        assert document["size"] == [7, 5]
        assert "direction.x" in procam("inspect", kept / "maps" / "south.exr").out

    @pytest.mark.parametrize(
        ("name", "content", "words"),
        [
            ("gone.png", None, "no such file"),
            ("garbage.png", b"not a picture", "readable image"),
            ("notes.txt", b"hello", "this is no file of procam's"),
            ("dome.zip", b"PK hello", "is no bundle, or a damaged one"),
            ("plan.json", b'{"schema": 1}', "has no list of shots"),
            ("calibration.json", b'{"schema_version": 1}', "dome.exr: no such file"),
        ],
    )
    def test_garbage(self, name: str, content: bytes | None, words: str, tmp_path: Path) -> None:
        if content is not None:
            (tmp_path / name).write_bytes(content)
        assert words in refused("inspect", tmp_path / name)


def picture(tmp_path: Path) -> Path:
    sky = half_sky(SIZE)
    write_channels(tmp_path / "sky.exr", {c: sky[..., i] for i, c in enumerate(RGB)})
    return tmp_path / "sky.exr"


def rgb(path: Path) -> np.ndarray:
    channels = read_channels(path)
    return np.stack([channels[c] for c in RGB], axis=-1)


class TestCompensateAndWarp:
    @pytest.mark.parametrize("method", ["exact", "paper-eq12", "none"])
    def test_exr_in_exr_out_is_what_the_compensator_gives(
        self, method: str, calibration: Calibration, kept: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "direct.exr"
        ran = procam("compensate", kept, picture(tmp_path), out, "--method", method, "--json")
        document = json.loads(ran.out)
        assert (ran.code, ran.err) == (0, "")
        assert document["out"] == str(out)
        expected = Compensator(calibration, SIZE, method).predict(half_sky(SIZE))  # type: ignore[arg-type]
        np.testing.assert_allclose(rgb(out), expected.direct, rtol=0, atol=1e-6)
        assert document["direct_flux_sr"] == pytest.approx(list(expected.flux), rel=1e-5)

    def test_warp_writes_each_projectors_frame(
        self, calibration: Calibration, kept: Path, tmp_path: Path
    ) -> None:
        ran = warped(kept, picture(tmp_path), tmp_path / "frames", "--json")
        paths = [tmp_path / "frames" / f"{name}.png" for name in ("south", "north")]
        assert json.loads(ran.out) == {"frames": [str(p) for p in paths]}
        sent = Compensator(calibration, SIZE, "none").predict(half_sky(SIZE)).direct
        drives = projector_frames(sent, calibration)
        expected = {
            name: np.rint(65535 * drive).astype(np.uint16) for name, drive in drives.items()
        }
        for path in paths:
            pixels = np.asarray(read_image(path))
            assert pixels.dtype == np.uint16
            # of 65535; the table that clips go by
            assert np.abs(pixels.astype(int) - expected[path.stem].astype(int)).max() <= 10

    @pytest.mark.parametrize("to", ["screen", "projectors"])
    def test_a_bad_picture_is_refused_and_leaves_no_output(
        self, to: str, kept: Path, tmp_path: Path
    ) -> None:
        source = picture(tmp_path)
        source.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
        out = tmp_path / "made" / "out.exr"
        assert f"{source} is truncated or damaged" in refused(
            "compensate", kept, source, out, "--to", to
        )
        assert not (tmp_path / "made").exists()

    def test_an_output_that_cannot_be_written_is_one_line(self, kept: Path, tmp_path: Path) -> None:
        folder = tmp_path / "out.exr"
        folder.mkdir()
        assert str(folder) in refused("compensate", kept, picture(tmp_path), folder)
        assert not list(folder.iterdir())
        assert not list(tmp_path.glob(".*"))


class TestProjector:
    @pytest.fixture
    def venue(self, tmp_path: Path) -> Path:
        return make_venue(tmp_path, size=TINY_PAIR).directory

    @pytest.fixture
    def stages(self, monkeypatch: pytest.MonkeyPatch) -> list[Stage]:
        """Venues in which the projectors are already on, and have been for 200 hours."""

        def lit(stage: Stage) -> BackendRig:
            for state in stage.scene.states.values():
                state.switch_on()
            stage.scene.clock.sleep(200 * 3600)
            return stage.backend

        return watch_stage(monkeypatch, lit)

    def test_state_says_everything(self, venue: Path, stages: list[Stage]) -> None:
        ran = procam("projector", venue, "north", "state", "--json")
        assert (ran.code, ran.err) == (0, "")
        assert json.loads(ran.out) == {
            "power": "on",
            "shuttered": False,
            "source": "30",
            "lamp_hours": 200,
            "errors": [],
        }
        assert re.search(r"lamp_hours +200\n", procam("projector", venue, "north", "state").out)
        assert stages[-1].lit() == ["south", "north"]

    def test_state_in_standby(self, venue: Path) -> None:
        document = json.loads(procam("projector", venue, "south", "state", "--json").out)
        assert (document["power"], document["shuttered"]) == ("standby", None)

    def test_on_and_off(self, venue: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        stages = watch_stage(monkeypatch)
        document = json.loads(procam("projector", venue, "north", "on", "--json").out)
        assert document["power"] == "on"
        assert [str(s.power) for s in stages[-1].scene.states.values()] == ["standby", "on"]

    def test_off(self, venue: Path, stages: list[Stage]) -> None:
        document = json.loads(procam("projector", venue, "north", "off", "--json").out)
        assert document["power"] in ("cooling", "standby")
        assert stages[-1].lit() == ["south"]

    def test_shutter(self, venue: Path, stages: list[Stage]) -> None:
        for value, lit in (("closed", ["south"]), ("open", ["south", "north"])):
            ran = procam("projector", venue, "north", "shutter", value, "--json")
            assert json.loads(ran.out)["shuttered"] is (value == "closed")
            assert stages[-1].lit() == lit

    def test_input_and_hours(self, venue: Path, stages: list[Stage]) -> None:
        ran = procam("projector", venue, "north", "input", "A0", "--json")
        assert json.loads(ran.out)["source"] == "A0"
        assert stages[-1].scene.states["north"].source == "A0"
        ran = procam("projector", venue, "north", "hours", "--json")
        assert json.loads(ran.out) == {"lamp_hours": 200}

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["north", "dance"], "action 'dance' is unknown; choose one of state, on, off"),
            (["north", "shutter", "ajar"], "shutter 'ajar' is unknown; choose open or closed"),
            (["north", "input", "??"], "input '??' is not a source code"),
            (
                ["attic", "state"],
                "projector 'attic' is not in venue.toml; choose one of south, north",
            ),
        ],
    )
    def test_bad_words_are_bad_input(
        self, arguments: list[str], words: str, venue: Path, stages: list[Stage]
    ) -> None:
        assert words in refused("projector", venue, *arguments)

    def test_no_camera_is_needed(self, venue: Path, stages: list[Stage]) -> None:
        path = venue / "venue.toml"
        path.write_text(path.read_text().replace('backend = "simulated"', "", 1))
        document = json.loads(procam("projector", venue, "north", "state", "--json").out)
        assert document["power"] in {"standby", "on"}

    def test_what_it_cannot_do_now_is_a_failed_device(self, venue: Path) -> None:
        ran = procam("projector", venue, "north", "shutter", "closed")
        assert ran.code == 1
        assert "shutter closed is not confirmed: projector north" in ran.complaint
        assert "switch it on first" in ran.complaint

    def test_a_projector_without_a_control_table(self, venue: Path) -> None:
        path = venue / "venue.toml"
        path.write_text(re.sub(r"(?m)^control = .*$", "", path.read_text()))
        assert "has no control table" in refused("projector", venue, "north", "state")

    def test_a_cable_that_is_not_there(self, venue: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(tempfile, "tempdir", str(venue))
        path = venue / "venue.toml"
        path.write_text(path.read_text().replace('port = "backend"', 'port = "/dev/procam-none"'))
        ran = procam("projector", venue, "north", "state")
        assert ran.code == 1
        assert "projector north: port /dev/procam-none" in ran.complaint
        text = path.read_text().partition("[simulated]")[0]
        text = text.replace('backend = "simulated"', "")  # all by hand, but for a cable
        path.write_text(text)
        ran = procam("projector", venue, "north", "state")
        assert "projector north: port /dev/procam-none" in ran.complaint
        path.write_text(text.replace("/dev/procam-none", "backend"))
        ran = procam("projector", venue, "north", "state")
        assert "projector north: its backend provides no control port" in ran.complaint
        assert not list(venue.glob("procam-serial-*"))


def edited(old: str, new: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return edit


def _dreamt(name: re.Match[str]) -> str:
    return name[0].replace("simulated", "dream")


class TestVenueErrors:
    @pytest.mark.parametrize(
        ("edit", "words"),
        [
            (
                edited("radius_m = 6.0", "radius_m = 0\nsize = 1\nhalf_angle = 2"),
                ["screen.radius_m is ", "screen.size is ", "screen.half_angle is "],
            ),
            (
                edited("[projectors.south]", "[projectors.attic]"),
                ["projectors.attic: backend 'simulated' has no device of this name"],
            ),
            (edited("size = [128, 80]", "size = [128, 81]"), ["projectors.south.size: "]),
            (
                edited("rays = 64", "rays = 1\ncolour = 3"),
                ["simulated.rays is 1", "simulated.colour is 3"],
            ),
            (
                edited('backend = "simulated"', 'backend = "dream"'),
                [
                    "cameras.zenith.backend: no backend 'dream' is installed, only by-hand, simulated"
                ],
            ),
            (
                lambda text: re.sub(r'"simulated"|(?<=^\[)simulated', _dreamt, text, flags=re.M),
                ["backend: no backend 'dream' is installed, only by-hand, simulated; correct"],
            ),
            (
                lambda text: text.replace('backend = "simulated"', 'backend = "simulatd"'),
                ["simulated is not a known key; "],
            ),
        ],
    )
    def test_every_mistake_has_its_line_and_nothing_stays_open(
        self,
        edit: Callable[[str], str],
        words: list[str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        wires = tmp_path / "wires"
        wires.mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(wires))
        path = make_venue(tmp_path / "venue").directory / "venue.toml"
        path.write_text(edit(path.read_text()))
        ran = procam("session", "capture", path.parent)
        assert (ran.code, ran.out) == (2, "")
        lines = ran.err.splitlines()
        assert len(lines) == len(words), lines
        assert all(any(word in line for line in lines) for word in words), lines
        assert not list(wires.iterdir())

    def test_two_backends(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """A camera of one, projectors of another."""
        path = make_venue(tmp_path).directory / "venue.toml"
        real, opened = venue_rig.open_backend, list[str]()

        def open_backend(name: str, settings: Any, folder: Path) -> BackendRig:
            opened.append(name)
            rig = real("simulated", load_venue(path.parent).backends["simulated"], folder)
            return replace(rig, projectors={}) if name == "dream" else replace(rig, cameras={})

        monkeypatch.setattr(venue_rig, "known_backends", lambda: ["dream", "simulated"])
        monkeypatch.setattr(venue_rig, "open_backend", open_backend)
        mixed = path.read_text().replace('"simulated"', '"dream"', 1) + "[dream]\n"
        path.write_text(mixed)
        venue = load_venue(path.parent)
        with open_rig(venue) as rig:
            assert (list(rig.cameras), list(rig.projectors)) == (["zenith"], ["south"])
            assert list(rig.controls) == ["south"]
        assert opened == ["dream", "simulated"]
        path.write_text(mixed.replace("zenith]", "attic]").replace('"zenith"', '"attic"'))
        message = procam("session", "capture", tmp_path).complaint
        assert "cameras.attic: backend 'dream' has no device of this name, only zenith" in message

    @pytest.mark.parametrize("command", ["session capture", "doctor", "calibrate"])
    @pytest.mark.parametrize(
        ("device", "table"), [("camera zenith", "cameras"), ("projector south", "projectors")]
    )
    def test_what_is_done_by_hand_is_reported_how(
        self, device: str, table: str, command: str, tmp_path: Path
    ) -> None:
        message = f"use `procam session plan {tmp_path}`, `procam doctor --photos` and `procam session add`"
        path = make_venue(tmp_path).directory / "venue.toml"
        head = f"[{table}.{device.split()[1]}]\n"
        path.write_text(edited(f'{head}backend = "simulated"\n', head)(path.read_text()))
        assert f"{path}: {device} is driven by hand; {message}" in refused(
            *command.split(), tmp_path
        )

    @pytest.mark.parametrize("command", ["session capture", "calibrate", "refine"])
    def test_a_missing_venue_is_reported_how_to_make_one(
        self, command: str, tmp_path: Path
    ) -> None:
        complaint = refused(*command.split(), tmp_path / "nowhere")
        assert "nowhere/venue.toml: no such file" in complaint
        assert "procam init" in complaint
        assert not (tmp_path / "nowhere").exists()

    def test_a_crashing_camera_is_not_dressed_up(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def broken(camera: SimulatedCamera) -> None:
            raise ZeroDivisionError

        make_venue(tmp_path)
        stages = watch_stage(monkeypatch)
        monkeypatch.setattr(SimulatedCamera, "capture", broken)
        with pytest.raises(ZeroDivisionError):
            procam("session", "capture", tmp_path)
        assert stages[-1].lit() == []


class TestDemo:
    def test_an_unknown_preset(self, tmp_path: Path) -> None:
        assert "perfect" in refused("demo", "--out", tmp_path / "run", "--preset", "perfect")
        assert not (tmp_path / "run").exists()

    def test_somebody_elses_folder_is_left_alone(self, tmp_path: Path) -> None:
        (tmp_path / "thesis.txt").write_text("mine")
        assert "Nothing was touched" in refused("demo", "--out", tmp_path)
        assert contents(tmp_path) == {"thesis.txt": b"mine"}

"""Calibration directories written and read back, and the errors of damaged ones."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edited_files import edited_json

from procam.errors import FileFormatError, InputError
from procam.estimate.media_server.dome_master import DomeMaster
from procam.files.calibration import load_calibration, load_dome, save_calibration
from procam.files.images.layers import read_channels, write_channels
from procam.files.versions import calibration_in_use, list_calibrations, next_directory
from procam.maths.geometry.canvas import STANDARD
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.correspondence import ProjectorSurface
from procam.model.mask import Mask
from procam.model.provenance import Provenance
from procam.model.transport import Measured, ScatterKernel
from procam.model.venue_state import VenueState


def _assert_same(found: Any, expected: Any, where: str = "calibration") -> None:
    if dataclasses.is_dataclass(expected):
        assert type(found) is type(expected), where
        for field in dataclasses.fields(expected):
            name = field.name
            _assert_same(getattr(found, name), getattr(expected, name), f"{where}.{name}")
    elif isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype, where
        np.testing.assert_array_equal(found, expected, err_msg=where)
    elif isinstance(expected, Mapping):
        assert set(found) == set(expected), where
        for key in expected:
            _assert_same(found[key], expected[key], f"{where}[{key}]")
    else:
        assert found == expected and type(found) is type(expected), where


@pytest.fixture
def saved(tmp_path: Path, calibration: Calibration) -> Path:
    directory = tmp_path / "calibrations" / "0001"
    save_calibration(calibration, directory)
    return directory


class TestRoundTrip:
    def test_all_values_are_read_back_exactly(self, saved: Path, calibration: Calibration) -> None:
        _assert_same(load_calibration(saved), calibration)

    def test_protected_parts_are_read_back(self, tmp_path: Path, calibration: Calibration) -> None:
        covered = np.zeros((96, 96), bool)
        covered[10:30, 20:50] = True
        maps = dataclasses.replace(calibration.maps, protected=Mask("screen", covered))
        protecting = dataclasses.replace(calibration, maps=maps)
        save_calibration(protecting, tmp_path / "0001")
        _assert_same(load_calibration(tmp_path / "0001"), protecting)

    def test_kernel_and_falloff_are_read_back(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        rng = np.random.default_rng(3)
        kernel = ScatterKernel(1, rng.normal(size=(3, 4, 4)), rng.normal(size=(3, 4)))
        falloff = rng.uniform(0.5, 1, (96, 96)).astype(np.float32)
        maps = dataclasses.replace(calibration.maps, kernel=kernel, falloff=falloff)
        furnished = dataclasses.replace(calibration, maps=maps)
        save_calibration(furnished, tmp_path / "0001")
        _assert_same(load_calibration(tmp_path / "0001"), furnished)

    def test_venue_states_are_read_back(self, tmp_path: Path, calibration: Calibration) -> None:
        rng = np.random.default_rng(4)
        ambient = rng.uniform(0, 0.02, (96, 96, 3)).astype(np.float32)
        m = Measured(rng.uniform(0.3, 0.4, 3), rng.uniform(0, 0.01, 3))
        states = {
            "full": VenueState("full", m, rng.uniform(1.1, 1.2, 3), ambient),
            "school": VenueState("school", m, rng.uniform(1.1, 1.2, 3)),
        }
        with_states = dataclasses.replace(calibration, states=states)
        save_calibration(with_states, tmp_path / "0001")
        _assert_same(load_calibration(tmp_path / "0001"), with_states)
        assert sorted(p.name for p in (tmp_path / "0001" / "maps").glob("state-*")) == [
            "state-full.exr"
        ]

    def test_an_older_calibration_without_states(
        self, saved: Path, calibration: Calibration
    ) -> None:
        with edited_json(saved / "calibration.json") as document:
            del document["states"]
        _assert_same(load_calibration(saved), calibration)

    def test_an_older_calibration_without_a_kernel(self, saved: Path) -> None:
        with edited_json(saved / "calibration.json") as document:
            del document["scatter_kernel"]
        _assert_same(load_calibration(saved).maps.kernel, ScatterKernel.scalar())

    def test_without_protection_there_is_no_layer_of_it(self, saved: Path) -> None:
        """And so does every calibration that was made before there was any."""
        assert "protected" not in read_channels(saved / "maps" / "dome.exr")
        assert load_calibration(saved).maps.protected is None

    def test_a_dome_has_no_projectors(self, saved: Path, calibration: Calibration) -> None:
        """Their maps may be absent."""
        for name in calibration.projectors:
            (saved / "maps" / f"{name}.exr").unlink()
        _assert_same(load_dome(saved), dataclasses.replace(calibration, projectors={}))

    def test_file_names(self, saved: Path) -> None:
        files = sorted(str(p.relative_to(saved)) for p in saved.rglob("*") if p.is_file())
        assert files == [
            "calibration.json",
            "maps/dome.exr",
            "maps/north.exr",
            "maps/south.exr",
        ]

    def test_saving_that_fails_leaves_nothing(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        unfit = dataclasses.replace(
            calibration, provenance=Provenance(meter={"not": {"json": object()}})
        )
        with pytest.raises(TypeError):
            save_calibration(unfit, tmp_path / "0001")
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("fov_deg", "rotation_deg"), [(180, 0), (220, -50)])
def test_the_canvas_of_a_media_server_is_known_without_its_entry(
    fov_deg: float, rotation_deg: float, tmp_path: Path, calibration: Calibration
) -> None:
    """Files of earlier versions have none, but the server itself."""
    server = DomeMaster("south", 48, np.radians(fov_deg), np.radians(rotation_deg))
    south = calibration.projectors["south"]
    surface = {
        f.name: getattr(south.surface, f.name)[:30].repeat(2, axis=0)[:48]
        for f in dataclasses.fields(south.surface)
    }
    photometry = dataclasses.replace(south.photometry, gain=surface["direction"])
    devices = {
        "south": ProjectorCalibration(
            server.model, ProjectorSurface(**surface), photometry, surface["measured"]
        )
    }
    save_calibration(dataclasses.replace(calibration, projectors=devices), tmp_path / "0001")
    with edited_json(tmp_path / "0001" / "calibration.json") as document:
        del document["canvas"]
    found = load_calibration(tmp_path / "0001").canvas
    assert (found.fov, found.rotation) == pytest.approx((server.fov, server.rotation))
    assert (found == STANDARD) == (fov_deg == 180)


def test_an_existing_folder_is_left_as_it_is(saved: Path, calibration: Calibration) -> None:
    with pytest.raises(InputError, match="exists; give the folder of a calibration that is not"):
        save_calibration(calibration, saved)
    _assert_same(load_calibration(saved), calibration)


class TestNumbering:
    def test_counts_up(self, tmp_path: Path, calibration: Calibration) -> None:
        for number in ("0001", "0002", "0003"):
            assert next_directory(tmp_path) == tmp_path / "calibrations" / number
            save_calibration(calibration, next_directory(tmp_path))
            assert calibration_in_use(tmp_path).name == number
        assert [p.name for p in list_calibrations(tmp_path)] == ["0001", "0002", "0003"]

    def test_goes_on_after_an_old_one_is_deleted(self, tmp_path: Path) -> None:
        for number in ("0001", "0002"):
            folder = tmp_path / "calibrations" / number
            folder.mkdir(parents=True)
            (folder / "calibration.json").write_text("{}")
        (tmp_path / "calibrations" / "0001" / "calibration.json").unlink()
        (tmp_path / "calibrations" / "0001").rmdir()
        assert next_directory(tmp_path).name == "0003"

    def test_no_calibration_yet(self, tmp_path: Path) -> None:
        with pytest.raises(FileFormatError, match=r"has no calibration; .*procam calibrate"):
            calibration_in_use(tmp_path)


class TestDamage:
    def _message(self, directory: Path) -> str:
        with pytest.raises(FileFormatError) as caught:
            load_calibration(directory)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    def test_no_calibration_here(self, tmp_path: Path) -> None:
        message = self._message(tmp_path)
        assert message.startswith(f"{tmp_path} has no calibration.json")
        assert "VENUE/calibrations/0001" in message

    @pytest.mark.parametrize("version", [0, 3, "1", None])
    def test_of_another_version(self, saved: Path, version: object) -> None:
        with edited_json(saved / "calibration.json") as document:
            document["schema_version"] = version
        message = self._message(saved)
        assert f"has schema_version {version!r}" in message
        assert "calibrate again" in message

    @pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"schema_version": 1}', "\x00"])
    def test_damaged_json(self, saved: Path, text: str) -> None:
        (saved / "calibration.json").write_text(text)
        message = self._message(saved)
        assert message.startswith(f"{saved / 'calibration.json'} is a damaged calibration")
        assert "procam session solve" in message

    def test_numbers_of_another_shape(self, saved: Path) -> None:
        with edited_json(saved / "calibration.json") as document:
            document["feedback"]["value"] = [0.3, 0.3]
        assert "value has 2 numbers where 3 belong" in self._message(saved)

    @pytest.mark.parametrize(
        ("at", "value", "message"),
        [
            ("screen.radius_m", 1e300, "radius_m is 1e+300 where"),
            ("screen.floor_albedo", 1.2, "floor_albedo is 1.2 where 0 to 1 belong"),
            ("screen.tilt", "x", "damaged calibration"),
            ("canvas.fov", True, "fov is True where a number belongs"),
            ("cameras.0.lens.kind", "fish", "damaged calibration"),
            ("cameras.0.lens.focal", [0, 100], "focal is 0 where"),
            ("cameras.0.size", [], "size has 0 numbers where 2 belong"),
            ("cameras.0.sensor.bits", 40, "bits is 40 where 1 to 16 belong"),
            ("cameras.0.camera_from_dome.translation.0", None, "translation is nan where"),
            ("cameras.0.camera_from_dome.rotation", np.diag([1, 1, -1]), "is no rotation matrix"),
            ("cameras.0.camera_from_dome.rotation", 1.01 * np.eye(3), "is no rotation matrix"),
            (
                "projectors.0.size",
                [7, 7],
                "map direction has (30, 48) pixels where the panel has (7, 7)",
            ),
            ("projectors.0.response.levels.0", 0.99, "levels of a response do not rise"),
            ("scatter_kernel.degree", 1, "damaged calibration"),
            ("scatter_kernel.degree", 7, "damaged calibration"),
            ("scatter_kernel.matrix", [[["x"]]] * 3, "damaged calibration"),
            (
                "projectors.0.colour_mix",
                [[1, 0], [0, 1]],
                "colour_mix has 2 x 2 numbers where 3 x 3",
            ),
        ],
    )
    def test_values_that_cannot_be(self, saved: Path, at: str, value: Any, message: str) -> None:
        *keys, last = (int(key) if key.isdigit() else key for key in at.split("."))
        with edited_json(saved / "calibration.json") as document:
            place = document
            for key in keys:
                is_name = isinstance(place, dict) and key == 0
                place = next(iter(place.values())) if is_name else place[key]
            place[last] = np.array(value).tolist()
        assert message in self._message(saved)

    @pytest.mark.parametrize("name", ["../../x", "a b", "", ".a"])
    def test_names_that_would_lead_elsewhere(self, saved: Path, name: str) -> None:
        with edited_json(saved / "calibration.json") as document:
            document["projectors"] = {name: next(iter(document["projectors"].values()))}
        assert "is no name that procam gives" in self._message(saved)

    @pytest.mark.parametrize(
        ("channel", "factor", "message"),
        [
            ("direction.x", 1.5, "vectors whose length is not 1"),
            ("solid_angle", -1.0, "solid_angle is negative or NaN"),
            ("blend", 3.0, "blend has values outside 0 to 1"),
        ],
    )
    def test_maps_that_cannot_be(
        self, saved: Path, channel: str, factor: float, message: str
    ) -> None:
        path = next(p for p in (saved / "maps").glob("*.exr") if p.stem != "dome")
        channels = read_channels(path)
        write_channels(path, channels | {channel: channels[channel] * np.float32(factor)})
        assert message in self._message(saved)

    @pytest.mark.parametrize("key", ["screen", "cameras", "projectors", "feedback", "quality"])
    def test_a_part_is_missing(self, saved: Path, key: str) -> None:
        with edited_json(saved / "calibration.json") as document:
            del document[key]
        message = self._message(saved)
        assert "damaged calibration" in message and key in message

    @pytest.mark.parametrize("name", ["dome", "south"])
    def test_a_map_is_gone(self, saved: Path, name: str) -> None:
        (saved / "maps" / f"{name}.exr").unlink()
        assert self._message(saved).startswith(f"{saved / 'maps' / name}.exr: no such file")

    @pytest.mark.parametrize("name", ["dome", "south"])
    def test_a_map_is_truncated(self, saved: Path, name: str) -> None:
        path = saved / "maps" / f"{name}.exr"
        path.write_bytes(path.read_bytes()[:-200])
        assert self._message(saved).startswith(f"{path} is truncated or damaged")

    def test_a_states_map_is_gone(self, tmp_path: Path, calibration: Calibration) -> None:
        lamps = np.zeros_like(calibration.maps.hi)
        state = VenueState("full", calibration.feedback, np.ones(3), lamps)
        directory = tmp_path / "0001"
        save_calibration(dataclasses.replace(calibration, states={"full": state}), directory)
        path = directory / "maps" / "state-full.exr"
        write_channels(path, dict.fromkeys("RGB", lamps[::2, ::2, 0]))
        assert "ambient of venue state full has shape" in self._message(directory)
        path.unlink()
        assert self._message(directory).startswith(f"{path}: no such file")

    def test_a_map_of_another_kind(self, saved: Path) -> None:
        (saved / "maps" / "south.exr").write_bytes((saved / "maps" / "dome.exr").read_bytes())
        assert "direction" in self._message(saved)

    @pytest.mark.parametrize("name", ["direction.y", "gain.R", "blend", "hi.G", "coverage"])
    def test_a_map_lacks_a_channel(self, saved: Path, name: str) -> None:
        file = "dome" if name in ("hi.G", "coverage") else "south"
        path = saved / "maps" / f"{file}.exr"
        channels = {n: plane.copy() for n, plane in read_channels(path).items() if n != name}
        write_channels(path, channels)
        message = self._message(saved)
        assert "is a damaged calibration" in message or "; it needs a single one" in message
        assert name.partition(".")[0] in message

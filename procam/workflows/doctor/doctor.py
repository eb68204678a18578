"""Examines every device that a venue names, and reports faults before a capture session starts.

About five photographs for each projector and camera, ten where a camera is looked at first; two dozen
more for each projector whose settings are tested.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from procam.devices.protocols import Power
from procam.devices.rig import Rig
from procam.errors import CalibrationError, DeviceError
from procam.estimate.projector_tests.patterns import PatchLayout
from procam.files.venue.load import Venue
from procam.workflows.doctor.behaviour import BehaviourTest
from procam.workflows.doctor.behaviour_driven import DrivenTest
from procam.workflows.doctor.examined_camera import ExaminedCamera
from procam.workflows.doctor.findings import (
    Diagnosis,
    Finding,
    judge_behaviour,
    judge_views,
)
from procam.workflows.events import Event, Steps


def examine(
    rig: Rig, venue: Venue, diagnosis: Diagnosis, *, behaviour: bool = False
) -> Steps[None]:
    """Fill `diagnosis`: reach all devices, photograph each projector with each camera, judge.

    With `behaviour` also test for settings of projectors that break calibration. Leaves projectors
    dark one by one as it goes; the rig does so again when it is let go.
    """
    total = len(rig.projectors) * (1 + len(rig.cameras) + behaviour) + len(rig.cameras) + 1
    done = 0
    awake = []
    for name in rig.projectors:
        if _wake(rig, name, diagnosis):
            awake.append(name)
        done += 1
        yield Event("doctor", done, total, f"projector {name} asked")
    cameras = {}
    for name, camera in rig.cameras.items():
        examined = ExaminedCamera(rig, camera, venue.cameras[name].sensor, diagnosis)
        with _reported(diagnosis, examined.device):
            examined.look_at_dark(venue.table.capture)
            cameras[name] = examined
        done += 1
        yield Event("doctor", done, total, f"camera {name} photographed the dark")
    for name in awake:
        if behaviour:  # first: light that moves with the picture would pass for a camera's fault
            with _reported(diagnosis, f"projector {name}"), _lit(rig, name, diagnosis):
                _test_behaviour(name, cameras, venue, diagnosis)
            done += 1
            yield Event("doctor", done, total, f"{name} tested for its settings")
        for camera_name, examined in cameras.items():
            with _reported(diagnosis, f"projector {name}"), _lit(rig, name, diagnosis):
                examined.look_at(name, venue.table.capture)
            done += 1
            yield Event("doctor", done, total, f"{name} photographed by {camera_name}")
    judge_views(diagnosis)
    yield Event("doctor", total, total, f"{len(diagnosis.findings)} findings")


@contextmanager
def _reported(diagnosis: Diagnosis, device: str) -> Iterator[None]:
    """What a device refuses becomes a finding, and the others are still looked at."""
    try:
        yield
    except (DeviceError, CalibrationError) as error:
        diagnosis.keep(Finding(device, type(error).__name__, str(error)))


@contextmanager
def _lit(rig: Rig, name: str, diagnosis: Diagnosis) -> Iterator[None]:
    """Only this projector's light is out."""
    try:
        rig.light(name)
        yield
    finally:
        with _reported(diagnosis, f"projector {name}"):
            rig.darken(name)


def _test_behaviour(
    name: str, cameras: dict[str, ExaminedCamera], venue: Venue, diagnosis: Diagnosis
) -> None:
    """Test a projector before the first camera that sees it well enough."""
    for camera, examined in cameras.items():
        frames = DrivenTest(examined, name).photograph(venue.table.capture)
        layout = PatchLayout(venue.table.projectors[name].size)
        tested = BehaviourTest(camera, examined.measured, layout, frames).run()
        diagnosis.behaviour[name] = tested
        if tested.effects:
            judge_behaviour(diagnosis, name)
            return


def _wake(rig: Rig, name: str, diagnosis: Diagnosis) -> bool:
    """Switch a projector on and make it dark; False when it cannot be."""
    device, awake = f"projector {name}", False
    with _reported(diagnosis, device):
        control = rig.controls.get(name)
        if control is not None and control.state().power is not Power.ON:
            control.set_power(True)
        rig.darken(name)
        awake = True
        if control is not None:
            state = control.state()
            diagnosis.controls[name] = {
                "power": str(state.power),
                "shuttered": state.shuttered,
                "source": state.source,
                "lamp_hours": state.lamp_hours,
                "errors": list(state.errors),
            }
            for complaint in state.errors:
                diagnosis.add(
                    device, "complaint", f"its complaint {complaint!r}", "none", "see to it"
                )
    return awake

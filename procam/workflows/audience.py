"""Measures a venue state: scattered light with an audience in, and the show's own lamps.

A few photographs, for people are sitting there: one of the room's own light, five to nine of each projector.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from procam.arrays import Array, Image, Map
from procam.errors import InputError, NotEnoughData, OutOfModelRange
from procam.estimate.light.audience import (
    AudienceView,
    ZoneObservation,
    audience_feedback,
    centre_shift,
)
from procam.estimate.structured_light.codes import Picture
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.model.venue_state import VenueState
from procam.workflows.capture.capture import missing_shots
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.capture.session_plan import plan_of_session
from procam.workflows.events import Event, Steps
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import Photographer, Wanted
from procam.workflows.photographs.open import check_devices

Shown = tuple[Mapping[str, Image], Image]  # a projector's picture, and where its light is expected
MOST_SHIFT_PX = 3.0  # of the middle of a lit part; the calibration's own pixel is a fraction of one
RATIOS = (0.5, 2.0)  # an audience changes the scattered light by a tenth
FEWEST = 2  # pictures: one gives no estimate of its own error
SATURATED_SHARE = 0.002  # of the screen; above it light is lost
GREEN = 1


def measure_state(
    photographer: Photographer,
    venue: Venue,
    calibration: Calibration,
    name: str,
    ambient_only: bool = False,
) -> Steps[tuple[VenueState, Array]]:
    """Photograph the venue as it is; its state, and the room's own light (3,), a mean over the screen [rel].

    With `ambient_only` no projector is lit, and the feedback stays what is known of the state, or of
    the calibration if nothing is.

    Raises
    ------
    InputError
        A name that cannot be one, or the calibration is of other devices than the venue.
    NotEnoughData
        The camera sees no direct light.
    OutOfModelRange
        The camera or a projector has moved, the room's light outshines the projectors, or what
        bounces has changed by more than people can change it.
    """
    check_state_name(calibration, name)
    check_devices(venue, calibration)
    camera = _Camera(photographer, venue, calibration)
    total = 1 if ambient_only else 1 + len(calibration.projectors)
    pictures = {} if ambient_only else _zone_pictures(venue, calibration)
    camera.plan(pictures)
    ambient, mean = camera.ambient()
    text = f"the room's own light is {_percent(mean)} of white"
    known = calibration.states.get(name, VenueState(name, calibration.feedback, np.ones(3)))
    state = replace(known, ambient=ambient)
    if not ambient_only:
        yield Event("state", 1, total, text)
        observations: list[ZoneObservation] = []
        for done, projector in enumerate(calibration.projectors, start=2):
            observations += camera.zones(projector)
            if done < total:
                yield Event("state", done, total, f"{projector} photographed")
        _check_enough(observations)
        ratio = camera.audience.scatter_ratio(observations, camera.calibrated_zones(pictures))
        _check_ratio(ratio)
        state = VenueState(name, audience_feedback(calibration, ratio), ratio.value, ambient)
        text = f"{text}; scattered light is {_percent(ratio.value)} of the calibration's"
    yield Event("state", total, total, text)
    return state, mean


def with_state(calibration: Calibration, state: VenueState) -> Calibration:
    """The calibration with a state added, or put in the place of an older one."""
    return replace(calibration, states={**calibration.states, state.name: state})


class _Camera:
    """The camera that the calibration's light was measured with."""

    def __init__(self, photographer: Photographer, venue: Venue, calibration: Calibration) -> None:
        self._photographer, self._capture = photographer, venue.table.capture
        self._sessions = venue.directory / "sessions"
        self._camera = MainCamera.of(venue, calibration)
        self.audience = AudienceView(calibration, self._camera.view)

    def ambient(self) -> tuple[Map, Array]:
        """The room's own light on the dome master, and its mean (3,) over what is lit.

        At the exposure of black where that saturates nowhere, else at that of white.
        """
        for exposure_s in self._dark_exposures():
            light = self._photograph({}, exposure_s)
            if self._lost(light) <= SATURATED_SHARE:
                level, mean = self.audience.ambient(light)
                if mean.max() < 1:
                    return level, mean
        raise OutOfModelRange(
            "the room's own light is brighter than the projectors' white; dim the room lights to a "
            "show's exit signs and aisle lights"
        )

    def plan(self, pictures: Mapping[str, Sequence[Picture]]) -> None:
        """Say what will be photographed: the dark at both exposures, and pictures (H, W, 1) by projector."""
        self._panels = {name: list(self._panel(name, pictures[name])) for name in pictures}
        dark = [Wanted({}, exposure_s) for exposure_s in self._dark_exposures()]
        shown = (picture for panel in self._panels.values() for picture, _ in panel)
        self._photographer.plan(
            [*dark, *(Wanted(picture, self._capture.exposure_s) for picture in shown)]
        )

    def _dark_exposures(self) -> list[float]:
        """The longest first."""
        return sorted({self._capture.black_exposure_s, self._capture.exposure_s})[::-1]

    def _panel(self, projector: str, pictures: Sequence[Picture]) -> Iterator[Shown]:
        """Black, then pictures of which the camera sees direct light, and where it is expected."""
        yield _grey(projector, np.zeros_like(pictures[0], np.float32)), np.zeros(0, np.float32)
        drives = (np.asarray(picture / 255, np.float32) for picture in pictures)
        for drive, expected in self._seen(projector, drives):
            yield _grey(projector, drive), expected

    def zones(self, projector: str) -> list[ZoneObservation]:
        """Parts of a projector's panel, without its black and the room's light."""
        (black, _), *pictures = self._panels[projector]
        dark = self._photograph(black, self._capture.exposure_s)
        return [self._zone(projector, picture, expected, dark) for picture, expected in pictures]

    def _seen(self, projector: str, pictures: Iterable[Image]) -> Iterator[tuple[Image, Image]]:
        """Pictures of which the camera sees any direct light, and where it is expected."""
        for picture in pictures:
            expected = self.audience.expected(projector, picture)
            if expected.any():
                yield picture, expected

    def _zone(
        self, projector: str, picture: Mapping[str, Image], expected: Image, dark: Image
    ) -> ZoneObservation:
        light = self._photograph(picture, self._capture.exposure_s) - dark
        if not self._shift(light, expected) <= MOST_SHIFT_PX:  # the camera delivered an old picture
            light = self._photograph(picture, self._capture.exposure_s, again=True) - dark
        shift = self._shift(light, expected)
        if not shift <= MOST_SHIFT_PX:
            raise OutOfModelRange(_moved(self._camera.name, projector, shift))
        lost = self._lost(light)
        if lost > SATURATED_SHARE:
            raise OutOfModelRange(
                f"a lit part of projector {projector}: {lost:.1%} of its pixels are saturated, more "
                f"than {SATURATED_SHARE:.1%}; dim the room lights, or lower [capture] exposure_s"
            )
        return self.audience.observe(light, expected > 0)

    def calibrated_zones(self, pictures: Mapping[str, Sequence[Picture]]) -> list[ZoneObservation]:
        """Those pictures from the session of the calibration; none if some are gone."""
        origin, camera = self.audience.calibration.provenance, self._camera.name
        session = Session(self._sessions / origin.session)
        if not (session.directory / "plan.json").is_file():
            return []
        plan = session.read_plan()
        numbered = any("number" in shot.detail for shot in plan.shots)  # light beside the zones
        others = any(len(plan.of(name, "zone")) != len(shown) for name, shown in pictures.items())
        if numbered or others or missing_shots(session, plan, [camera]):
            return []
        images = SessionImages(session, plan, self._camera.radiometer)
        return [
            observation for name in pictures for observation in self._stored_zones(images, name)
        ]

    def _stored_zones(self, images: SessionImages, projector: str) -> Iterator[ZoneObservation]:
        dark, dark_long = images.dark(projector)
        base = images.light(images.only(projector, "black")) - dark_long + dark
        for shot in images.plan.of(projector, "zone"):
            picture = images.session.pattern(shot)[..., :1]
            for _, expected in self._seen(projector, [picture]):
                light = self._camera.content(images.light(shot) - base)
                yield self.audience.observe(light, expected > 0)

    def _shift(self, light: Image, expected: Image) -> float:
        return centre_shift(light[..., GREEN], expected, self.audience.view.on_screen)

    def _photograph(
        self, pictures: Mapping[str, Image], exposure_s: float, *, again: bool = False
    ) -> Image:
        """Content light (H, W, 3), NaN where saturated."""
        take = self._photographer.retake if again else self._photographer.take
        frame = take(Wanted(pictures, exposure_s))
        return self._camera.content(self._camera.radiometer.radiance(frame))

    def _lost(self, light: Image) -> float:
        """Share of the screen that is saturated."""
        return float(np.isnan(light[self.audience.view.on_screen]).any(axis=-1).mean())


def _grey(projector: str, drive: Image) -> dict[str, Image]:
    """A grey picture (H, W, 1) of one projector, (H, W, 3)."""
    return {projector: np.broadcast_to(drive, (*drive.shape[:2], 3))}


def _zone_pictures(venue: Venue, calibration: Calibration) -> dict[str, list[Picture]]:
    """Those pictures (H, W, 1) of a session that light a part of a projector's panel, by projector."""
    plan, patterns = plan_of_session(venue)
    return {
        name: [patterns[shot.pattern] for shot in plan.of(name, "zone")]
        for name in calibration.projectors
    }


def check_state_name(calibration: Calibration, name: str) -> None:
    """Refuse a name that cannot be that of a state."""
    VenueState(name, calibration.feedback, np.ones(3))  # refuses a name before a lamp is lit
    if f"state-{name}" in calibration.projectors:
        raise InputError(
            f"venue state: the name {name!r} is taken by the map of projector state-{name}; choose "
            "another"
        )


def _check_enough(observations: Sequence[ZoneObservation]) -> None:
    if len(observations) < FEWEST:
        raise NotEnoughData(
            f"only {len(observations)} pictures of a part of a projector's panel show light, and "
            f"{FEWEST} are needed; are masks in venue.toml too wide?"
        )


def _check_ratio(ratio: Measured) -> None:
    low, high = RATIOS
    if not ((ratio.value >= low) & (ratio.value <= high)).all():
        raise OutOfModelRange(
            f"scattered light: {_percent(ratio.value)} of the calibration's, beyond the credible "
            f"{low:.0%} to {high:.0%}; is a projector lit that should be dark, or was the dome "
            "painted? then calibrate again"
        )


def _moved(camera: str, projector: str, shift: float) -> str:
    seen = (
        "not seen at all"
        if np.isnan(shift)
        else f"seen {shift:.1f} px from its place in the calibration ({MOST_SHIFT_PX:g} px at most)"
    )
    return (
        f"a lit part of projector {projector}: {seen}; is another picture shown? Else camera {camera} or the "
        "projector has moved, or is covered: calibrate again"
    )


def _percent(values: Array) -> str:
    return " / ".join(f"{100 * v:.1f}" for v in values) + " %"

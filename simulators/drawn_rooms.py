"""Rooms drawn at random: domes, rigs and cameras that nobody designed for, and what their owners know.

A room's number draws all of it; `python -m studies rooms` calibrates many.
"""

from dataclasses import dataclass, replace

import numpy as np

from procam.maths.geometry.lenses import Lens
from simulators.builds import CameraBuild, CameraFlaws
from simulators.placement import place_cameras
from simulators.presets import STANDARD, Preset

BOARD_FOCAL = 5e-4  # relative standard error of a focal length from a board, studies/boards.md
PRIOR_FOCAL, PRIOR_DISTORTION = 0.005, 0.01  # of a lens by its data sheet
VIGNETTING_SIGMA = (
    0.002  # of each coefficient, from photographs of one place turned through the picture
)
SURVEY_DEG, CLICK_PX = 0.05, 0.3  # of marks on the dome, and of clicks on them by hand
GLARE_SHARE = 0.1  # relative standard error of a veil measured with a light trap


@dataclass(frozen=True)
class DrawnRoom:
    """A room as it is. `known` is what its venue.toml says."""

    preset: Preset
    projectors: int
    known: "Known"


@dataclass(frozen=True)
class Known:
    """What the owner of a venue knows of it.

    Attributes
    ----------
    half_angle_deg, tilt_deg : of the dome.
    floor, glare : albedo of the deck and veiling glare, each with its standard error.
    cameras : as the owner believes them built. intrinsics : what to do with their lenses.
    survey_deg, click_px : standard errors of the marks on the dome and of clicks in photographs; the
        marks of venue.toml are off by these, drawn with `seed`, if there is one.
    """

    half_angle_deg: float
    tilt_deg: float
    floor: tuple[float, float]
    glare: tuple[float, float]
    cameras: tuple[CameraBuild, ...]
    intrinsics: str = "fixed"
    survey_deg: float = 0.01
    click_px: float = 0.01
    seed: int | None = None


def draw_room(number: int, camera_size: tuple[int, int]) -> DrawnRoom:
    """Room `number`, photographed by one camera."""
    rng = np.random.default_rng([20261, number])
    preset, projectors = _preset(rng), int(rng.integers(1, 7))
    (camera,) = place_cameras(1, camera_size, "fisheye", preset)
    return DrawnRoom(preset, projectors, _known(rng, preset, camera))


def _preset(rng: np.random.Generator) -> Preset:
    def either(low: float, high: float) -> float:
        """Nothing in half of the rooms."""
        return float(rng.uniform(low, high) * rng.integers(2))

    radius = float(rng.uniform(3, 12))
    albedo = float(rng.uniform(0.3, 0.8))
    return replace(
        STANDARD,
        radius_m=radius,
        half_angle_deg=float(rng.choice([rng.uniform(76, 90), 90.0])),
        tilt_deg=either(2, 25),
        strip_share=float(rng.uniform(0.03, 0.25)),
        ovality=float(rng.uniform(0, 5e-4)),
        floor_albedo=float(rng.uniform(0, 0.35)),
        deck_drop_m=either(0.05, 0.35) * radius,
        wall_albedo=float(rng.uniform(0, 0.3)),
        pod=bool(rng.integers(2)),
        albedo=albedo,
        brightness=STANDARD.brightness * STANDARD.albedo / albedo * 0.8,  # for 6 projectors too
        albedo_smooth=float(rng.uniform(0, 0.1)),
        seam=float(rng.uniform(0, 0.1)),
        dust=float(rng.uniform(0, 0.05)),
        gloss=either(0, 0.03),
        glare=float(rng.uniform(0, 0.015)),
        white_snr=float(rng.uniform(60, 200)),
        drift=float(rng.uniform(-0.003, 0.003)),
        rig_seed=int(rng.integers(2**31)),
        rig_spread=2.0,
        camera_shift=(*rng.uniform(-0.1, 0.1, 2).tolist(), float(rng.uniform(-0.03, 0.05))),
        flaws=CameraFlaws(
            local_veil=float(rng.uniform(0, 0.6)),
            vignetting_slope=(float(rng.normal(0, 0.005)), float(rng.normal(0, 0.005))),
            ripple_px=float(rng.uniform(0, 0.1)),
            black_drift_dn=float(rng.uniform(-0.3, 0.3)),
        ),
    )


def _known(rng: np.random.Generator, preset: Preset, camera: CameraBuild) -> Known:
    by_board = str(rng.choice(["board", "data sheet"])) == "board"
    glare_sigma = max(GLARE_SHARE * preset.glare, 3e-4)
    floor_sigma = float(rng.uniform(0.03, 0.15))
    believed = known_camera(rng, camera, by_board=by_board)
    return Known(
        min(90.0, round(preset.half_angle_deg + rng.normal(0, 0.3), 1)),
        round(preset.tilt_deg + rng.normal(0, 0.3), 1),
        (max(0.0, round(preset.floor_albedo + rng.normal(0, floor_sigma), 3)), floor_sigma),
        (max(0.0, preset.glare + rng.normal(0, glare_sigma)), glare_sigma),
        (believed,),
        "prior",
        survey_deg=SURVEY_DEG,
        click_px=CLICK_PX,
        seed=int(rng.integers(2**31)),
    )


def known_camera(rng: np.random.Generator, camera: CameraBuild, *, by_board: bool) -> CameraBuild:
    """A camera as its owner believes it built, by measurements with their errors."""
    lens = _known_lens(rng, camera.lens, by_board)
    vignetting = tuple(v + rng.normal(0, VIGNETTING_SIGMA) for v in camera.vignetting)
    return replace(camera, lens=lens, vignetting=vignetting)


def _known_lens(rng: np.random.Generator, lens: Lens, by_board: bool) -> Lens:
    """A lens by a board at a desk, or by its data sheet."""
    if by_board:
        return replace(lens, focal=lens.focal * (1 + rng.normal(0, BOARD_FOCAL)))
    distortion = lens.distortion.copy()
    distortion[0] += rng.normal(0, PRIOR_DISTORTION)
    return replace(lens, focal=lens.focal * (1 + rng.normal(0, PRIOR_FOCAL)), distortion=distortion)

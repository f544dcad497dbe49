"""Scene of bell2019, section 3.4: a ground robot drives towards a checkerboard that it keeps in view.

| quantity | here | source |
| --- | --- | --- |
| board | 8 x 6 corners, 0.06 m apart | published |
| start | 3.4 m +- 0.2 m away, at rest | printed: about 3 m; see below |
| path | 2.5 m long | published |
| camera | 1920 x 1080 at 30 Hz | published |
| focal length | 1150 pixels | ours: a common lens for that sensor |
| board off the axis | 15 to 28 degrees at the start, 15 at the end, to either side | ours: a spiral keeps it in view |
| speed | 0.25 m/s after 1 s, 0.4 s of rest before | ours: below the robot's limit |
| odometry | 50 Hz | published |
| its errors | scale SD 1 %, slip 2 %, gyro 4 mrad/s a sample and a bias of SD 0.5 mrad/s | ours, see below |
| depth prior | 3 m, SD 0.5 m, for the row that has one | ours |
| corners | noise of 0.5 pixels | ours: subpixel corners of a moving camera |

The odometry's scale follows from print: no combination of vision with the same odometry can know the scale better than
the odometry does, and with an SD of 1 % the camera's position errs as published, by 0.03 m after learning (the first 15
seeds draw scales of 1.4 % RMS). So does the start: estimator 1 keeps its start of 0.5 m until it has learned, so that
its published error before learning, 134.8 m for 48 features, is 2.8 m a feature; the mean depth until then was 3.3 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.bundle.window import BundleSettings
from camnet.estimation.structure.camera_path import CameraPath, planar_path
from camnet.estimation.structure.key_view import ViewSettings
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.estimation.structure.odometry import Odometry, OdometryErrors, OdometrySpread, measure_odometry
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import Intrinsics
from camnet.settings import NonNegative, Positive, Settings, Vector2
from camnet.types import Array

__all__ = ["BoardScene", "SetUp", "board_points", "make_scene"]

#: corners across and down
BOARD = (8, 6)
_STEP_S = 0.05
_HEIGHT_M = 0.35
_SPREAD = OdometrySpread(scale_sd=0.01, slip_sd=0.02, gyro_bias_sd_radps=0.0005, gyro_noise_radps=0.004)


class SetUp(Settings):
    """The table above; one set-up for all rows."""

    square_m: Positive = 0.06
    start_m: Positive = 3.4
    start_spread_m: NonNegative = 0.2
    path_m: Positive = 2.5
    off_axis_deg: Vector2 = (15.0, 28.0)
    speed_mps: Positive = 0.25
    speed_up_s: Positive = 1.0
    rest_s: Positive = 0.4
    frame_hz: Positive = 30.0
    odometry_hz: Positive = 50.0
    noise_px: NonNegative = 0.5
    camera: Intrinsics = Intrinsics(
        width_px=1920, height_px=1080, fx_px=1150.0, fy_px=1150.0, cx_px=960.0, cy_px=540.0
    )
    odometry: OdometrySpread = _SPREAD
    views: ViewSettings = ViewSettings()
    observers: ObserverSettings = ObserverSettings()
    bundle: BundleSettings = BundleSettings(odometry=_SPREAD)
    depth_prior_m: tuple[Positive, Positive] = (3.0, 0.5)


@dataclass(frozen=True, eq=False, slots=True)
class BoardScene:
    """One run's truth and odometry.

    Attributes
    ----------
    t_s : (K,) times of the images, s
    path : the camera's true path
    points_world : (48, 3) corners, m
    odometry, errors : as measured, and what is wrong with it
    camera : the pinhole
    """

    t_s: Array
    path: CameraPath
    points_world: Array
    odometry: Odometry
    errors: OdometryErrors
    camera: Pinhole


def board_points(square_m: float) -> Array:
    """Corners (48, 3), m: the board is the plane x = 0, faces -x and is centred at the camera's height."""
    across, down = BOARD
    y, z = np.meshgrid(np.arange(across) - 0.5 * (across - 1), np.arange(down) - 0.5 * (down - 1))
    return np.column_stack([np.zeros(y.size), -square_m * y.ravel(), _HEIGHT_M - square_m * z.ravel()])


def make_scene(setup: SetUp, rng: np.random.Generator) -> BoardScene:
    """One run; the generator draws where the path lies and the odometry's errors."""
    path, duration = _path(setup, rng)
    frames = np.arange(0.0, math.floor(duration * setup.frame_hz) + 1.0) / setup.frame_hz
    samples = np.arange(0.0, math.floor(duration * setup.odometry_hz) + 2.0) / setup.odometry_hz
    errors = setup.odometry.draw(rng)
    odometry = measure_odometry(path, samples, errors, rng)
    return BoardScene(
        frames, path, board_points(setup.square_m), odometry, errors, Pinhole.from_settings(setup.camera)
    )


def _path(setup: SetUp, rng: np.random.Generator) -> tuple[CameraPath, float]:
    """Drive so that the board stays at a given angle off the direction of travel, which is the camera's axis."""
    start = setup.start_m + setup.start_spread_m * float(rng.uniform(-1.0, 1.0))
    low, high = np.radians(setup.off_axis_deg)
    bearing, side = float(rng.uniform(low, high)), 1.0 if rng.random() < 0.5 else -1.0
    cruise = (setup.path_m - 0.5 * setup.speed_mps * setup.speed_up_s) / setup.speed_mps
    duration = setup.rest_s + setup.speed_up_s + cruise
    # some knots before and after, so that the ends of the spline are as smooth as its middle
    t: Array = _STEP_S * np.arange(-10.0, math.ceil(duration / _STEP_S) + 10.0)
    way = _way(t - setup.rest_s, setup)
    fine = np.linspace(0.0, way[-1], 4001)
    off = bearing + (low - bearing) * np.minimum(fine / setup.path_m, 1.0)
    # distance to the board and direction seen from it: r' = -cos off, angle' = sin off / r
    step = fine[1] - fine[0]
    r = start - np.concatenate([[0.0], np.cumsum(np.cos(0.5 * (off[1:] + off[:-1])) * step)])
    turn = np.concatenate([[0.0], np.cumsum((np.sin(off) / r)[:-1] * step)])
    angle = side * (turn - 0.5 * turn[-1] + float(rng.uniform(-0.2, 0.2)))
    xy = np.column_stack([-r * np.cos(angle), -r * np.sin(angle)])
    yaw = angle - side * off
    at = [np.interp(way, fine, x) for x in (xy[:, 0], xy[:, 1], yaw)]
    return planar_path(t, np.column_stack(at[:2]), at[2], _HEIGHT_M), duration


def _way(t: Array, setup: SetUp) -> Array:
    """Length driven (K,) in m at times (K,) after the start: speed rises as (1 - cos)/2, then holds."""
    share = np.clip(t / setup.speed_up_s, 0.0, 1.0)
    rising = 0.5 * setup.speed_mps * setup.speed_up_s * (share - np.sin(np.pi * share) / np.pi)
    return np.asarray(rising + setup.speed_mps * np.maximum(t - setup.speed_up_s, 0.0))

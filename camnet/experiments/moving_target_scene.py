"""Scene of the moving-target experiment: bell2019 published none for chapter 5; all of it is ours.

| what | value | why |
| --- | --- | --- |
| camera | 1600 x 1200, f = 1000 px, 15 Hz, 0.5 or 1 px | |
| target | 12 points of a body of about 0.5 m, seen from all sides | features must stay visible as it turns |
| its way | 15 s at rest, 3 to 5 m away; then a wobbly circle of 2 m at 0.17 to 0.33 m/s | the same lap after lap |
| camera's way | 15 s with 2.1 m of baseline, then small moves about 5 m from the circle's centre | range 2.5 to 7.5 m |
| background | 40 corners, 6 to 11 m away | they give the camera's pose, as chapter 4 would |
| odometry | noise 0.02 m/s, 0.005 rad/s a sample at 50 Hz; scale SD 1 % | the scale at rest also without |
| out of view | seen U(15, 30) s, unseen U(10, 20) s | as published for parikh2018's first experiment |

``ways``: ``same`` every lap, ``speed`` multiplied by U(0.8, 1.2) each lap, or ``branch``: each lap the outer circle or,
with equal chance, a way that leaves it inwards by up to 0.9 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from camnet.estimation.structure.camera_path import CameraPath, planar_path
from camnet.estimation.structure.moving.replay import ReplaySettings
from camnet.estimation.structure.moving.twist_filter import TwistFilterSettings
from camnet.estimation.structure.odometry import Odometry, OdometrySpread, measure_odometry
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import from_yaw, to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.settings import NonNegative, Positive, Settings, Vector2
from camnet.types import Array, BoolArray, IntArray

__all__ = ["MovingScene", "MovingSetUp", "TargetWay", "Way", "make_moving_scene"]

Way = Literal["same", "speed", "branch"]
_FINE = 2000
_HEIGHT_M = 1.0


class MovingSetUp(Settings):
    """The table above; ``scale_seeds`` runs of the scale alone, at rest and never at rest."""

    camera: Intrinsics = Intrinsics(
        width_px=1600, height_px=1200, fx_px=1000.0, fy_px=1000.0, cx_px=800.0, cy_px=600.0
    )
    frame_hz: Positive = 15.0
    odometry_hz: Positive = 50.0
    rest_s: Positive = 15.0
    duration_s: Positive = 420.0
    features: Annotated[int, Field(ge=6, le=1000)] = 12
    corners: Annotated[int, Field(ge=6, le=1000)] = 40
    radius_m: Positive = 2.0
    range_m: Positive = 5.0
    baseline_m: Positive = 2.1
    speed_mps: Vector2 = (0.17, 0.33)
    speed_spread: NonNegative = 0.2
    branch_m: Positive = 0.9
    seen_s: Vector2 = (15.0, 30.0)
    unseen_s: Vector2 = (10.0, 20.0)
    rest_images: Annotated[int, Field(ge=2, le=1000)] = 46
    odometry: OdometrySpread = OdometrySpread(
        scale_sd=0.01, slip_sd=0.0, speed_noise_mps=0.02, gyro_noise_radps=0.005
    )
    noises_px: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.5, 1.0)
    scale_seeds: Annotated[int, Field(ge=1, le=10_000)] = 20
    filter: TwistFilterSettings = TwistFilterSettings()
    replay: ReplaySettings = ReplaySettings()


@dataclass(frozen=True, eq=False, slots=True)
class TargetWay:
    """True motion at K times: position (K, 3) m, heading and its rate (K,), velocity (K, 3) m/s, lap (K,), inner way.

    ``inner`` (K,) says on which way of a branch the target is, ``apart_m`` (K,) how far the two ways are apart there;
    ``lap`` counts from 0.
    """

    p_world: Array
    yaw: Array
    yaw_rate: Array
    v_world: Array
    lap: IntArray
    inner: BoolArray
    apart_m: Array

    @property
    def r_world(self) -> Array:
        """Body to world (K, 3, 3)."""
        return to_matrix(from_yaw(self.yaw))


@dataclass(frozen=True, eq=False, slots=True)
class MovingScene:
    """One run: truth, odometry and what is seen.

    Attributes
    ----------
    t_s : (K,) times of the images
    path, camera : the camera
    arms : (12, 3) features in the body, m; corners (40, 3) in the world, m
    target : true motion at the images
    seen : (K,) whether the target is in view
    xy_target, xy_corners : (K, 12, 2), (K, 40, 2) normalised coordinates with noise, NaN where not seen
    odometry, scale : measured velocities and the odometry's true scale error
    noise : standard deviation of normalised coordinates
    """

    t_s: Array
    path: CameraPath
    camera: Pinhole
    arms: Array
    corners: Array
    target: TargetWay
    seen: BoolArray
    xy_target: Array
    xy_corners: Array
    odometry: Odometry
    scale: float
    noise: float


def make_moving_scene(
    setup: MovingSetUp,
    noise_px: float,
    way: Way,
    rng: np.random.Generator,
    rests: bool = True,
    still: bool = False,
) -> MovingScene:
    """One run. With ``rests`` false the target moves from the start and is always in view; ``still`` cameras stand."""
    t = np.arange(0.0, setup.duration_s, 1.0 / setup.frame_hz)
    path = camera_path(setup, setup.duration_s, rng, still)
    camera = Pinhole.from_settings(setup.camera)
    target = _target(setup, t, way, rng, rests)
    arms = np.array([0.0, 0.0, 0.25]) + rng.uniform(-1.0, 1.0, (setup.features, 3)) * [0.25, 0.2, 0.2]
    corners = np.column_stack(
        [
            rng.uniform(1.5, 6.0, setup.corners),
            rng.uniform(-3.5, 3.5, setup.corners),
            rng.uniform(0.0, 2.5, setup.corners),
        ]
    )
    seen = _in_view(setup, t, rng) if rests else np.ones(len(t), dtype=bool)
    points = target.p_world[:, None] + np.einsum("kab,nb->kna", target.r_world, arms)
    xy_target = _see(setup, path, camera, t, points, noise_px, rng)
    xy_target[~seen] = np.nan
    xy_corners = _see(
        setup, path, camera, t, np.broadcast_to(corners, (len(t), *corners.shape)), noise_px, rng
    )
    samples = np.arange(0.0, setup.duration_s + 1.0, 1.0 / setup.odometry_hz)
    errors = setup.odometry.draw(rng)
    odometry = measure_odometry(path, samples, errors, rng)
    focal = float(camera.focal[0])
    return MovingScene(
        t,
        path,
        camera,
        arms,
        corners,
        target,
        seen,
        xy_target,
        xy_corners,
        odometry,
        errors.scale,
        noise_px / focal,
    )


def camera_path(
    setup: MovingSetUp, duration_s: float, rng: np.random.Generator, still: bool = False
) -> CameraPath:
    """Level camera about ``range_m`` from the origin that looks near it; ``still``: at rest."""
    t = np.arange(-1.0, duration_s + 2.0, 0.25)
    half, rest = 0.5 * setup.baseline_m, setup.rest_s
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    y = half * np.where(t < rest, -np.cos(np.pi * t / rest), np.cos(2.0 * np.pi * (t - rest) / 43.0))
    x = -setup.range_m + 0.35 * np.sin(2.0 * np.pi * t / 9.0 + phase[0])
    yaw = np.arctan2(-y, -x) + 0.03 * np.sin(2.0 * np.pi * t / 11.0 + phase[1])
    if still:
        x, y, yaw = (np.full_like(t, a[0]) for a in (x, y, yaw))
    return planar_path(t, np.column_stack([x, y]), yaw, _HEIGHT_M)


def _target(setup: MovingSetUp, t: Array, way: Way, rng: np.random.Generator, rests: bool) -> TargetWay:
    """Integrate along the way: time is a function of the angle, ``t(theta) = int ds / speed``."""
    low, high = setup.speed_mps
    laps = int(np.ceil(1.4 * high * setup.duration_s / (2.0 * np.pi * (setup.radius_m - setup.branch_m)))) + 2
    start, phase = rng.uniform(0.6 * np.pi, 1.4 * np.pi), rng.uniform(0.0, 2.0 * np.pi, 2)
    theta = np.linspace(0.0, 2.0 * np.pi * laps, _FINE * laps + 1)
    lap = np.minimum((theta / (2.0 * np.pi)).astype(int), laps - 1)
    factor = 1.0 + setup.speed_spread * rng.uniform(-1.0, 1.0, laps) * (way == "speed")
    inner = (rng.random(laps) < 0.5) & (way == "branch")
    angle = start + theta
    local = np.mod(theta, 2.0 * np.pi)
    bump = np.where((local > 1.0) & (local < 5.3), np.sin(np.pi * (local - 1.0) / 4.3) ** 2, 0.0)
    r = setup.radius_m * (1.0 + 0.06 * np.sin(3.0 * angle + phase[0])) - setup.branch_m * bump * inner[lap]
    p = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    d = np.gradient(p, theta, axis=0)
    yaw = np.unwrap(np.arctan2(d[:, 1], d[:, 0]))
    speed = (0.5 * (low + high) + 0.5 * (high - low) * np.sin(2.0 * angle + phase[1])) * factor[lap]
    length = np.linalg.norm(d, axis=1)
    rate = length / speed
    time = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(theta))])
    # at rest until s_0, then up to speed within a second
    run = np.maximum(t - setup.rest_s, 0.0) if rests else t + 1.0
    tau = np.where(run < 1.0, 0.5 * run**2, run - 0.5)
    pace = np.clip(run, 0.0, 1.0)
    at = np.interp(tau, time, theta)
    turn = np.gradient(yaw, theta)
    here = [np.interp(at, theta, a) for a in (p[:, 0], p[:, 1], yaw, speed, turn / rate)]
    along = np.column_stack([np.cos(here[2]), np.sin(here[2]), np.zeros(len(t))])
    number = np.minimum((at / (2.0 * np.pi)).astype(int), laps - 1)
    return TargetWay(
        np.column_stack([here[0], here[1], np.zeros(len(t))]),
        here[2],
        here[4] * pace,
        along * (here[3] * pace)[:, None],
        number,
        inner[number],
        np.interp(at, theta, setup.branch_m * bump) * (way == "branch"),
    )


def _in_view(setup: MovingSetUp, t: Array, rng: np.random.Generator) -> BoolArray:
    """In view while at rest and for some time after, then alternately out of view and in view."""
    seen = np.ones(len(t), dtype=bool)
    at = setup.rest_s + rng.uniform(*setup.seen_s)
    while at < t[-1]:
        end = at + rng.uniform(*setup.unseen_s)
        seen[(t >= at) & (t < end)] = False
        at = end + rng.uniform(*setup.seen_s)
    return seen


def _see(
    setup: MovingSetUp,
    path: CameraPath,
    camera: Pinhole,
    t: Array,
    points: Array,
    noise_px: float,
    rng: np.random.Generator,
) -> Array:
    """Normalised coordinates (K, N, 2) with noise; NaN outside the image."""
    truth = path.states(t)
    p_cam = np.einsum("kba,knb->kna", to_matrix(truth.q_world), points - truth.p_world[:, None])
    pixels = camera.project(p_cam)
    pixels = pixels + noise_px * rng.standard_normal(pixels.shape)
    xy = camera.normalise(pixels)
    return np.where(camera.in_image(pixels)[..., None], xy, np.nan)

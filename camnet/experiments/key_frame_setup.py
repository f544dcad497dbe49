"""World and path of the key-frame experiment: six loops through a corridor with a landmark (bell2019, section 4.6).

| quantity | here | source |
| --- | --- | --- |
| path | 6 loops of 42.6 m, a rectangle with rounded corners, at 0.45 m/s | published: 250 m in 560 s |
| landmark | seen along 1 m of the first straight, once a loop | published: about six resets |
| camera | 1920 x 1080 at 30 Hz, 0.3 m above the floor, focal length 1000 pixels | published; lens and height ours |
| yaw | 78 degrees off the travel, to the right | ours: towards the way it goes nothing is informative |
| walls | 1.15 m right of the path, 1.2 m high; 45 corners a square metre | ours: published mean distance 1.5 m |
| floor | 12 corners a square metre | ours |
| odometry | with every image | published |

The errors of the odometry are constants of each case, so that dead reckoning with resets errs as published, 0.63 m:

| case | gyro scale | gyro bias | wheel scale | slip (SD, 1 s) |
| --- | --- | --- | --- | --- |
| ``gyro_scale`` | 2.28 % | | | |
| ``mixed`` | 1.6 % | 0.0006 rad/s | 2 % | 5 % |
| ``slip`` | | | | 15 % |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from camnet.estimation.structure.camera_path import CameraPath, CameraStates, planar_path
from camnet.estimation.structure.key_frames.augmented_filter import FilterNoise
from camnet.estimation.structure.key_frames.settings import KeyFrameSettings
from camnet.estimation.structure.odometry import Odometry, OdometryErrors, measure_odometry
from camnet.experiments.key_frame_tracks import TrackNoise
from camnet.geometry.settings import Intrinsics
from camnet.settings import Fraction, NonNegative, Positive, Settings, Vector2
from camnet.types import Array, BoolArray

__all__ = [
    "CASES",
    "CorridorScene",
    "FilterSettings",
    "SetUp",
    "WorldSettings",
    "corridor_points",
    "lap_length",
    "make_scene",
]

_GYRO_NOISE_RADPS = 0.004
#: what is wrong with the odometry, by case
CASES: Mapping[str, OdometryErrors] = {
    "gyro_scale": OdometryErrors(gyro_scale=0.0228, gyro_noise_radps=_GYRO_NOISE_RADPS),
    "mixed": OdometryErrors(
        gyro_scale=0.016,
        gyro_bias_radps=(0.0, -0.0006, 0.0),
        scale=0.02,
        slip=0.05,
        gyro_noise_radps=_GYRO_NOISE_RADPS,
    ),
    "slip": OdometryErrors(slip=0.15, gyro_noise_radps=_GYRO_NOISE_RADPS),
}
#: knots of the path, s
_KNOT_S = 0.1


class WorldSettings(Settings):
    """See the module's table."""

    loops: int = 6
    size_m: Vector2 = (13.0, 8.9867)
    corner_m: Positive = 0.8
    speed_mps: Positive = 0.45
    camera_yaw_deg: float = -78.0
    camera_height_m: Positive = 0.3
    frame_hz: Positive = 30.0
    camera: Intrinsics = Intrinsics(
        width_px=1920, height_px=1080, fx_px=1000.0, fy_px=1000.0, cx_px=960.0, cy_px=540.0
    )
    wall_m: Positive = 1.15
    wall_height_m: Positive = 1.2
    wall_corners_per_m2: Positive = 45.0
    floor_corners_per_m2: NonNegative = 12.0
    landmark_m: Vector2 = (2.0, 3.0)


class FilterSettings(Settings):
    """What the filter is told: standard deviations of constants over runs, of slip, noise; see `augmented_filter`."""

    scale: Positive = 0.02
    gyro_bias_radps: Positive = 0.001
    gyro_scale: Positive = 0.02
    slip: Positive = 0.05
    slip_time_s: Positive = 1.0
    gyro_noise_radps: Positive = 0.004
    adapt_count: Positive = 50.0
    adapt_most: Positive = 1000.0


class SetUp(Settings):
    """One set-up for all cases and rows.

    Attributes
    ----------
    gates_px : standard deviations of the printed gates, pixels
    k_p, k_q : gains of the printed pose observer, 1/s; not published
    landmark_m, landmark_rad : noise of the pose by the landmark
    recognised_share : of the points in an image that are seen again, those that are recognised
    recognised_px : their noise, pixels
    least_recognised : points that a revisit needs
    structure_sd, structure_common_sd : relative standard deviations of learned distances, each by itself and of a key
        frame's in common, beside the wheels' scale
    """

    world: WorldSettings = WorldSettings()
    noise: TrackNoise = TrackNoise()
    key_frames: KeyFrameSettings = KeyFrameSettings()
    gates_px: tuple[Positive, ...] = (3.0, 10.0)
    k_p: Positive = 3.0
    k_q: Positive = 3.0
    landmark_m: Positive = 0.005
    landmark_rad: Positive = 0.002
    recognised_share: Fraction = 0.6
    recognised_px: Positive = 1.0
    least_recognised: int = Field(default=12, ge=4)
    structure_sd: Positive = 0.04
    structure_common_sd: Positive = 0.05
    filter: FilterSettings = FilterSettings()

    def filter_noise(self) -> FilterNoise:
        """Return what `run_filter` reads."""
        f = self.filter
        return FilterNoise(
            f.scale, f.gyro_bias_radps, f.gyro_scale, f.slip, f.slip_time_s, f.gyro_noise_radps, self.landmark_m,
            self.landmark_rad, f.adapt_count, f.adapt_most,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class CorridorScene:
    """One run: truth and odometry at K images.

    Attributes
    ----------
    points_world : (P, 3) corners, m
    path : the camera's true path
    truth : its states at the images
    odometry : measured, at the same times
    landmark : (K,) whether it is in view
    loop : (K,) number of the loop, from one landmark to the next
    """

    points_world: Array
    path: CameraPath
    truth: CameraStates
    odometry: Odometry
    landmark: BoolArray
    loop: Array


def _lap(s: WorldSettings) -> tuple[Array, Array]:
    """Lengths (8,) of straights and corners from the middle of the first straight on, and where they end (8,)."""
    r = s.corner_m
    a, b = s.size_m[0] - 2.0 * r, s.size_m[1] - 2.0 * r
    arc = 0.5 * np.pi * r
    lengths = np.array([0.5 * a, arc, b, arc, a, arc, b, arc, 0.5 * a])
    return lengths, np.cumsum(lengths)


def lap_length(s: WorldSettings) -> float:
    """Length of one loop, m."""
    return float(_lap(s)[1][-1])


def _ground(s: WorldSettings, way: Array) -> tuple[Array, Array]:
    """Positions (K, 2) in m and headings (K,) at lengths (K,) along the path; the world's centre is the corridor's."""
    lengths, ends = _lap(s)
    turn = np.where(np.arange(9) % 2 == 1, 0.5 * np.pi, 0.0)
    laps, along = np.divmod(way, ends[-1])
    piece = np.minimum(np.searchsorted(ends, along, side="right"), 8)
    begun = ends - lengths
    h0 = np.cumsum(turn) - turn
    # ends of the pieces, one after the other
    corners = np.zeros((10, 2))
    corners[0] = [0.0, -0.5 * s.size_m[1]]
    for k in range(9):
        corners[k + 1] = corners[k] + _advance(h0[k], lengths[k], turn[k], s.corner_m)
    rest = along - begun[piece]
    curved = np.where(turn[piece] > 0.0, rest / s.corner_m, 0.0)
    step = np.stack([_advance(h, x, c, s.corner_m) for h, x, c in zip(h0[piece], rest, curved, strict=True)])
    return corners[piece] + step, h0[piece] + curved + 2.0 * np.pi * laps


def _advance(heading: float, length: float, turned: float, r: float) -> Array:
    """Shift (2,) by a straight of some length, or by an arc of radius r to the left."""
    c, s = np.cos(heading), np.sin(heading)
    if turned > 0.0:
        ahead, left = r * np.sin(turned), r * (1.0 - np.cos(turned))
    else:
        ahead, left = length, 0.0
    return np.array([c * ahead - s * left, s * ahead + c * left])


def corridor_points(s: WorldSettings, rng: np.random.Generator) -> Array:
    """Corners (P, 3) on the outer walls and on the floor beside them, m."""
    half = 0.5 * np.array(s.size_m) + s.wall_m
    sides = 4.0 * (half[0] + half[1])
    count = rng.poisson(s.wall_corners_per_m2 * sides * s.wall_height_m)
    wall = np.column_stack(
        [_around(half, rng.uniform(0.0, sides, count)), rng.uniform(0.02, s.wall_height_m, count)]
    )
    area = 4.0 * half[0] * half[1]
    floor = rng.uniform(-half, half, (rng.poisson(s.floor_corners_per_m2 * area), 2))
    inside = np.all(np.abs(floor) < half - 2.0 * s.wall_m, axis=1)
    return np.concatenate([wall, np.column_stack([floor, np.zeros(len(floor))])[~inside]])


def _around(half: Array, way: Array) -> Array:
    """Points (K, 2) on the outline of a rectangle at lengths (K,) along it."""
    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    ends = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    return np.column_stack([np.interp(way, ends, ring[:, k]) for k in range(2)])


def make_scene(s: WorldSettings, errors: OdometryErrors, rng: np.random.Generator) -> CorridorScene:
    """One run; the generator draws the corners and the odometry's noise."""
    lap = lap_length(s)
    # from the landmark of one lap to that of the last
    start, length = s.landmark_m[0], s.loops * lap + s.landmark_m[1] - s.landmark_m[0]
    duration = length / s.speed_mps
    knots = np.arange(-5.0, np.ceil(duration / _KNOT_S) + 6.0) * _KNOT_S
    xy, heading = _ground(s, start + lap + s.speed_mps * knots)
    path = planar_path(knots, xy, heading - 2.0 * np.pi + np.radians(s.camera_yaw_deg), s.camera_height_m)
    t = np.arange(0.0, np.floor(duration * s.frame_hz) + 1.0) / s.frame_hz
    along = start + s.speed_mps * t
    seen = np.mod(along, lap)
    landmark = (seen >= s.landmark_m[0]) & (seen < s.landmark_m[1])
    loop = np.floor((along - s.landmark_m[0]) / lap)
    points = corridor_points(s, rng)
    return CorridorScene(points, path, path.states(t), measure_odometry(path, t, errors, rng), landmark, loop)

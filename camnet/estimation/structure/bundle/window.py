"""Sliding-window bundle adjustment of one key frame's features, as the images come.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| P | ``poses`` | | poses in the window, the key frame and the present one included |
| | ``spacing_m`` | m | a pose is kept once the camera is that far from the last one kept |
| ``rho_0``, ``s_rho`` | ``start_m``, ``start_inverse_sd`` | m, 1/m | start and prior of every inverse depth |
| | ``period`` | | frames from one adjustment to the next; between them odometry carries the pose on |

The published EKF starts at 0.5 m with a standard deviation of ``sqrt(1.5e5 r) = 1.22`` 1/m of the inverse depth: the
default prior is that one. It speaks of the object, whose N features are at about one depth: each has the standard
deviation ``s_rho sqrt(N)``, so that together they weigh as one; N independent priors would pull at the scale N times as
hard. When the window is full, the pose goes whose neighbours are nearest each other, so that the
poses stay spread over the whole way; odometry then leads directly from one neighbour to the other, and what is lost are
the pose's observations alone. Nothing is linearised about an old estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from pydantic import Field

from camnet.estimation.structure.bundle.preintegrate import preintegrate
from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState, Observations, build_problem
from camnet.estimation.structure.bundle.solver import adjust
from camnet.estimation.structure.odometry import Odometry, OdometryErrors, OdometrySpread
from camnet.estimation.structure.tracks import TrackedFrame, match
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import IDENTITY, exp, multiply, rotate, to_matrix
from camnet.settings import Positive, Settings
from camnet.types import Array, BoolArray

__all__ = ["BundleSettings", "SlidingBundle"]


class BundleSettings(Settings):
    """See the module's table; ``odometry`` states the spread of its errors."""

    poses: int = Field(default=10, ge=3)
    spacing_m: Positive = 0.05
    period: int = Field(default=3, ge=1)
    start_m: Positive = 0.5
    start_inverse_sd: Positive = 1.2247
    distance_m: tuple[Positive, Positive] = (0.5, 6.0)
    noise_px: Positive = 0.5
    rest_mps: Positive = 0.01
    iterations: int = Field(default=30, ge=1)
    odometry: OdometrySpread = OdometrySpread(gyro_bias_sd_radps=0.0005)

    @property
    def noise(self) -> OdometryErrors:
        """What odometry steps are weighted with."""
        o = self.odometry
        return OdometryErrors(
            slip=o.slip_sd,
            slip_time_s=o.slip_time_s,
            speed_noise_mps=o.speed_noise_mps,
            gyro_noise_radps=o.gyro_noise_radps,
        )


@dataclass(frozen=True, eq=False, slots=True)
class _Pose:
    """One pose of the window: when, what was seen (normalised coordinates and their SD), and the estimate."""

    t_s: float
    xy: Array
    seen: BoolArray
    sd: float
    p: Array
    q: Array


class SlidingBundle:
    """Feed it tracked frames; the first one is the key frame, whose features are followed.

    Parameters
    ----------
    camera : the pinhole
    odometry : measured velocities, over the whole time of the frames
    settings : see `BundleSettings`
    """

    def __init__(self, camera: Pinhole, odometry: Odometry, settings: BundleSettings) -> None:
        self._camera, self._odometry, self._s = camera, odometry, settings
        self._sd = settings.noise_px / float(np.mean(camera.focal))
        self._window: list[_Pose] = []
        self._frames, self._rested = 0, 0
        self._resting = True
        self._t = np.nan
        #: the camera's pose in the key frame, m
        self.p, self.q = np.zeros(3), IDENTITY.copy()
        #: rays (a, b) and inverse depths of the features in the key frame
        self.points = np.empty((0, 3))
        #: odometry scale and gyro bias
        self.common = np.zeros(4)

    def depths(self) -> Array:
        """Depths ``z`` (N,) in m of the features in the present camera frame, within the range of distances."""
        low, high = self._s.distance_m
        rho = np.clip(self.points[:, 2], 1.0 / high, None)
        ray = np.column_stack([self.points[:, :2], np.ones(len(rho))])
        p = (ray / rho[:, None] - self.p) @ to_matrix(self.q)
        return np.clip(p[:, 2], low, high)

    def update(self, frame: TrackedFrame) -> None:
        """Take one frame in."""
        if not self._window:
            self._ids = frame.ids.copy()
            self.points = np.full((len(frame.ids), 3), 1.0 / self._s.start_m)
            self._sum = np.zeros((len(frame.ids), 2))
        pixels, seen = match(frame, self._ids)
        xy = self._camera.normalise(pixels)
        speed = float(np.linalg.norm(self._odometry.at(frame.t_s)[0]))
        self._resting &= not self._window or (speed < self._s.rest_mps and bool(seen.all()))
        if self._resting:
            self._rest(frame.t_s, xy)
            return
        self._carry(frame.t_s)
        self._frames += 1
        if self._frames % self._s.period == 0:
            self._adjust(_Pose(frame.t_s, xy, seen, self._sd, self.p, self.q))

    def _rest(self, t: float, xy: Array) -> None:
        """While the camera stands, the key frame's rays are the mean of what is seen."""
        self._rested += 1
        self._sum += xy
        mean = self._sum / self._rested
        self.points[:, :2] = mean
        everything = np.ones(len(mean), dtype=bool)
        self._window = [_Pose(t, mean, everything, self._sd / np.sqrt(self._rested), self.p, self.q)]
        self._t = t

    def _carry(self, t: float) -> None:
        """Carry the pose on by odometry as it is calibrated."""
        dt = t - self._t
        v, w = self._odometry.at(self._t + 0.5 * dt)
        half = exp(0.5 * dt * (w - self.common[1:]))
        middle = multiply(self.q, half)
        self.p = self.p + dt / (1.0 + self.common[0]) * rotate(middle, v)
        self.q = multiply(middle, half)
        self._t = t

    def _adjust(self, now: _Pose) -> None:
        poses = [*self._window, now]
        problem = self._problem(poses)
        start = BundleState(
            np.array([x.p for x in poses]), np.array([x.q for x in poses]), self.points, self.common
        )
        after, cost, _ = adjust(problem, start, self._s.iterations, 1e-5)
        if np.isfinite(cost):
            self.points, self.common = after.points, after.common
            self.p, self.q = after.p[-1], after.q[-1]
            poses = [
                _Pose(x.t_s, x.xy, x.seen, x.sd, p, q)
                for x, p, q in zip(poses, after.p, after.q, strict=True)
            ]
        if np.linalg.norm(poses[-1].p - poses[-2].p) < self._s.spacing_m:
            poses.pop()
        self._window = poses
        if len(poses) >= self._s.poses:
            gaps = [np.linalg.norm(poses[i + 1].p - poses[i - 1].p) for i in range(1, len(poses) - 1)]
            del self._window[1 + int(np.argmin(gaps))]

    def _problem(self, poses: list[_Pose]) -> BundleProblem:
        steps = [preintegrate(self._odometry, a.t_s, b.t_s, self._s.noise) for a, b in pairwise(poses)]
        seen = [np.flatnonzero(x.seen) for x in poses]
        counts = [len(k) for k in seen]
        observations = Observations(
            np.repeat(np.arange(len(poses)), counts),
            np.concatenate(seen),
            np.concatenate([x.xy[k] for x, k in zip(poses, seen, strict=True)]),
            np.repeat([x.sd for x in poses], counts),
        )
        count = len(self.points)
        prior = np.column_stack(
            [np.full(count, 1.0 / self._s.start_m), np.full(count, self._s.start_inverse_sd * np.sqrt(count))]
        )
        return build_problem(
            observations,
            np.zeros(count, dtype=np.int64),
            list(steps),
            self._s.odometry.scale_sd,
            self._s.odometry.gyro_bias_sd_radps,
            prior,
        )

"""Sensing at the level of poses: the true relative pose with noise, drop-outs and latency.

With ``n_p ~ N(0, s_p^2 I)`` and ``n_r ~ N(0, s_r^2 I)``, drawn for every frame, camera and target:

    p_cam = R_c^T (p_m - p_c) + n_p          q_cam = exp(n_r) q_c^-1 q_m

Every frame draws the same count of random numbers whatever is visible, so two runs with one seed stay comparable
when their views differ.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numba import njit

from camnet.geometry.rotations_compiled import conjugate, exp, multiply, rotate
from camnet.sensing.settings import SensingSettings
from camnet.types import Array, BoolArray, CameraMotion, PoseMeasurement, Snapshot

__all__ = ["PoseSensor", "camera_motion"]

#: times within this many frame periods of a frame count as on it
_EARLY = 1e-6
_EARLY_S = 1e-9


@njit(cache=True)
def _relative_pose(p_c: Array, q_c: Array, p_m: Array, q_m: Array, noise: Array) -> tuple[Array, Array]:
    inverse = conjugate(q_c)
    return rotate(inverse, p_m - p_c) + noise[:3], multiply(exp(noise[3:]), multiply(inverse, q_m))


class PoseSensor:
    """Turns truth and visibility into pose measurements.

    Parameters
    ----------
    settings : noise, rate, latency, drop-outs
    n_targets, n_cameras : M and C
    """

    def __init__(self, settings: SensingSettings, n_targets: int, n_cameras: int) -> None:
        self._settings = settings
        self._shape = (n_cameras, n_targets)
        self._scale = np.repeat([settings.position_noise_m, settings.orientation_noise_rad], 3)
        self._pending: deque[PoseMeasurement] = deque()
        self._last_frame = -1

    def due(self, t_s: float) -> bool:
        """Whether a frame is to be taken at ``t_s``: the visibility test may be skipped when not."""
        return self._frame(t_s) > self._last_frame

    def measure(
        self, snapshot: Snapshot, visible: BoolArray, rng: np.random.Generator
    ) -> list[PoseMeasurement]:
        """Take a frame if one is due, and hand out the measurements whose latency has passed.

        Parameters
        ----------
        snapshot : the truth
        visible : (C, M) which camera sees which target; read only when a frame is due
        rng : source of noise and drop-outs

        Returns
        -------
        list of PoseMeasurement
            In the order of time, camera, target; with latency their ``t_s`` lies in the past.
        """
        if self.due(snapshot.t_s):
            self._last_frame = self._frame(snapshot.t_s)
            self._take(snapshot, visible, rng)
        ready: list[PoseMeasurement] = []
        while self._pending and self._pending[0].t_s + self._settings.latency_s <= snapshot.t_s + _EARLY_S:
            ready.append(self._pending.popleft())
        return ready

    def _frame(self, t_s: float) -> int:
        return math.floor(t_s * self._settings.rate_hz + _EARLY)

    def _take(self, snapshot: Snapshot, visible: BoolArray, rng: np.random.Generator) -> None:
        noise = rng.standard_normal((*self._shape, 6)) * self._scale
        kept = visible & (rng.random(self._shape) >= self._settings.dropout_probability)
        cameras, targets = kept.nonzero()  # in the order of camera, target
        motion, of = None, -1
        for c, m in zip(cameras.tolist(), targets.tolist(), strict=True):
            if motion is None or c != of:
                motion, of = camera_motion(snapshot, c), c
            p_cam, q_cam = _relative_pose(
                motion.p_world,
                motion.q_world,
                snapshot.target_p_world[m],
                snapshot.target_q_world[m],
                noise[c, m],
            )
            self._pending.append(PoseMeasurement(snapshot.t_s, c, m, p_cam, q_cam, motion))


def camera_motion(snapshot: Snapshot, camera: int) -> CameraMotion:
    """Pose and velocity of one camera, in arrays of their own."""
    return CameraMotion(
        snapshot.camera_p_world[camera].copy(),
        snapshot.camera_q_world[camera].copy(),
        snapshot.camera_v_world[camera].copy(),
        snapshot.camera_w_cam[camera].copy(),
    )

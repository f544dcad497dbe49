"""Sensing at the level of poses: the true relative pose with noise, drop-outs and latency.

With ``n_p ~ N(0, s_p^2 I)`` and ``n_r ~ N(0, s_r^2 I)``, drawn for every frame, camera and target:

    p_cam = R_c^T (p_m - p_c) + n_p          q_cam = exp(n_r) q_c^-1 q_m

Every frame draws the same count of random numbers whatever is visible, so two runs with one seed stay comparable
when their views differ.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from camnet.geometry.pinned import Pins
from camnet.geometry.triples import borrowing, conjugate, exp, multiply, quaternion, rotate
from camnet.sensing.settings import SensingSettings
from camnet.types import Array, BoolArray, CameraMotion, IntArray, PoseMeasurement, Snapshot

__all__ = ["PoseSensor", "camera_motion", "frame_at", "measure_frame"]

#: times within this many frame periods of a frame count as on it
_EARLY = 1e-6
_EARLY_S = 1e-9


class _Frame(NamedTuple):
    """Noise of a frame and what is measured in it.

    A visible pair is measured where its ``kept`` (C,M) is at least ``least``; ``normal`` (C,M,6) times ``scale`` (6,)
    is the noise, m and rad, camera frame. Poses (p, m, and q, body to camera) come in the first rows of ``out``
    (C M, 7), camera and target in ``pairs`` (C M, 2).
    """

    kept: Array
    least: float
    normal: Array
    scale: Array
    out: Array
    pairs: IntArray


_PINS = Pins(_Frame)
#: in compiled code: the frame at an address
frame_at = _PINS.of


@borrowing
def measure_frame(
    at: int, visible: BoolArray, camera_p: Array, camera_q: Array, target_p: Array, target_q: Array
) -> int:
    """Write the measurements of a frame; how many there are."""
    x = frame_at(at)
    count, scale = 0, x.scale
    for c in range(visible.shape[0]):
        for m in range(visible.shape[1]):
            if visible[c, m] and x.kept[c, m] >= x.least:
                x.pairs[count, 0], x.pairs[count, 1] = c, m
                inverse, n = conjugate(quaternion(camera_q, c, 0)), x.normal[c, m]
                way = (
                    target_p[m, 0] - camera_p[c, 0],
                    target_p[m, 1] - camera_p[c, 1],
                    target_p[m, 2] - camera_p[c, 2],
                )
                p_cam = rotate(inverse, way)
                turn = exp((n[3] * scale[3], n[4] * scale[4], n[5] * scale[5]))
                q_cam = multiply(turn, multiply(inverse, quaternion(target_q, m, 0)))
                for i in range(3):
                    x.out[count, i] = p_cam[i] + n[i] * scale[i]
                for i in range(4):
                    x.out[count, 3 + i] = q_cam[i]
                count += 1
    return count


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
        size = n_cameras * n_targets
        self._normal, self._kept = np.empty((*self._shape, 6)), np.empty(self._shape)
        #: as `measure_frame` left them: relative poses (C M,7), camera and target (C M,2)
        self.poses: Array = np.empty((size, 7))
        self.pairs: IntArray = np.empty((size, 2), dtype=np.int64)
        scale = np.repeat([settings.position_noise_m, settings.orientation_noise_rad], 3)
        least = settings.dropout_probability
        frame = _Frame(self._kept, least, self._normal, scale, self.poses, self.pairs)
        self._pinned = _PINS.pin(frame)
        self._pending: deque[PoseMeasurement] = deque()
        self._last_frame = -1

    @property
    def at(self) -> int:
        """Address of the frame, for `measure_frame`."""
        return self._pinned.at

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

    def draw(self, rng: np.random.Generator) -> None:
        """Draw the random numbers of a frame."""
        rng.standard_normal(out=self._normal)
        rng.random(out=self._kept)

    def _take(self, snapshot: Snapshot, visible: BoolArray, rng: np.random.Generator) -> None:
        self.draw(rng)
        count = measure_frame(
            self.at,
            visible,
            snapshot.camera_p_world,
            snapshot.camera_q_world,
            snapshot.target_p_world,
            snapshot.target_q_world,
        )
        if count == 0:
            return
        out = self.poses[:count].copy()
        motion, of = None, -1
        for (c, m), pose in zip(self.pairs[:count].tolist(), out, strict=True):
            if motion is None or c != of:
                motion, of = camera_motion(snapshot, c), c
            self._pending.append(PoseMeasurement(snapshot.t_s, c, m, pose[:3], pose[3:], motion))


def camera_motion(snapshot: Snapshot, camera: int) -> CameraMotion:
    """Pose and velocity of one camera, in arrays of their own."""
    return CameraMotion(
        snapshot.camera_p_world[camera].copy(),
        snapshot.camera_q_world[camera].copy(),
        snapshot.camera_v_world[camera].copy(),
        snapshot.camera_w_cam[camera].copy(),
    )

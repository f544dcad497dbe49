"""From tracked pixels and odometry to what the observers read: directions, and rotation and direction of the key frame.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``u = A^-1 p / |A^-1 p|`` | ``u_ic``, ``u_ik`` | (N, 3) | - | bell2019, 2.1; lens distortion taken out |
| ``R_{k/c}`` | ``r_kc`` | (3, 3) | - | gyro: ``R' = -w_c^x R`` |
| ``p_{k/c}`` | | (3,) | m | odometry: ``p' = -v_c - w_c^x p`` |
| ``u_{k/c}`` | ``u_kc`` | (3,) | - | `two_view.aided_direction` about the odometry's direction |

Directions of the key frame are the mean of the frames taken while odometry says that the camera stands (``rest_mps``):
the key frame's noise is in every later psi and nothing averages it out. The rotation of the key frame may come from an
essential matrix or a homography instead (``rotation``); its direction then comes with it, and where OpenCV finds none
the expected pose stands in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from camnet.estimation.structure.geometry import unit
from camnet.estimation.structure.odometry import Odometry
from camnet.estimation.structure.rates import turn_key_frame
from camnet.estimation.structure.tracks import TrackedFrame, match
from camnet.estimation.structure.two_view import aided_direction, essential_pose, homography_pose
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import IDENTITY, rotate, to_matrix
from camnet.settings import Positive, Settings
from camnet.types import Array, BoolArray, IntArray

__all__ = ["KeyFrameViews", "KeyView", "ViewSettings"]

#: below this length of the path no image is asked for the direction, m
_LEAST_BASELINE_M = 1e-4


class ViewSettings(Settings):
    """How rotation and direction of the key frame are found."""

    rotation: Literal["gyro", "homography", "essential"] = "gyro"
    noise_px: Positive = 0.5
    expected_direction_rad: Positive = 0.01
    least_baseline_m: Positive = 0.05
    rest_mps: Positive = 0.01


@dataclass(frozen=True, eq=False, slots=True)
class KeyView:
    """One image as the observers read it. N features of the key frame, in the order of ``ids``.

    Attributes
    ----------
    t_s, dt_s : time of the image, and since the one before, s
    ids : (N,) numbers of the features
    seen : (N,) whether each is in this image; directions of those that are not are NaN
    u_ik, u_ic : (N, 3) directions in the key frame and in the camera frame
    r_kc, u_kc : (3, 3), (3,) key frame in the camera frame; ``u_kc`` is NaN before the camera has moved
    baseline_m : distance from the key frame by odometry, m
    informed : whether the baseline suffices for psi
    v_cam, w_cam : (3,) m/s, (3,) rad/s measured velocities at ``t_s``
    at_key : whether the camera still stands where the key frame was taken
    """

    t_s: float
    dt_s: float
    ids: IntArray
    seen: BoolArray
    u_ik: Array
    u_ic: Array
    r_kc: Array
    u_kc: Array
    baseline_m: float
    informed: bool
    v_cam: Array
    w_cam: Array
    at_key: bool


class KeyFrameViews:
    """Turns tracked frames into views of one key frame; the first frame given is the key frame.

    Parameters
    ----------
    camera : the pinhole
    odometry : measured velocities, over the whole time of the frames
    settings : see `ViewSettings`
    """

    def __init__(self, camera: Pinhole, odometry: Odometry, settings: ViewSettings) -> None:
        self._camera, self._odometry, self._s = camera, odometry, settings
        self._noise = settings.noise_px / float(np.mean(camera.focal))
        self._ids: IntArray = np.empty(0, dtype=np.int64)
        self._sum = np.empty((0, 3))
        self._t = np.nan
        self._p, self._q = np.zeros(3), IDENTITY.copy()
        self._at_key = True

    def view(self, frame: TrackedFrame) -> KeyView:
        """Read one frame; frames come in the order of time."""
        first = len(self._ids) == 0
        if first:
            self._ids, self._t = frame.ids.copy(), frame.t_s
            self._sum = np.zeros((len(frame.ids), 3))
        dt = frame.t_s - self._t
        pixels, seen = match(frame, self._ids)
        u_ic = self._camera.unproject(pixels)
        v, w = self._odometry.at(frame.t_s)
        self._at_key &= first or bool(np.linalg.norm(v) < self._s.rest_mps and seen.all())
        if self._at_key:
            self._sum += u_ic
        else:
            self._move(dt)
        self._t = frame.t_s
        u_ik = unit(self._sum)[0]
        r_kc, u_kc, baseline = self._key_pose(u_ik, u_ic, seen)
        informed = not self._at_key and baseline >= self._s.least_baseline_m
        return KeyView(
            frame.t_s, dt, self._ids, seen, u_ik, u_ic, r_kc, u_kc, baseline, informed, v, w, self._at_key
        )

    def _move(self, dt: float) -> None:
        """Carry the expected pose over one frame at the velocities of its middle."""
        v, w = self._odometry.at(self._t + 0.5 * dt)
        # p_{k/c} turns with the camera and loses the way travelled, half of it before and half after the turn
        turn = turn_key_frame(IDENTITY, w, dt)
        self._p = rotate(turn, self._p - 0.5 * dt * v) - 0.5 * dt * v
        self._q = turn_key_frame(self._q, w, dt)

    def _key_pose(self, u_ik: Array, u_ic: Array, seen: BoolArray) -> tuple[Array, Array, float]:
        r_kc = to_matrix(self._q)
        expected, baseline = unit(self._p)
        if self._at_key or baseline < _LEAST_BASELINE_M:
            return r_kc, np.full(3, np.nan), 0.0
        a, b = u_ik[seen], u_ic[seen]
        if self._s.rotation == "gyro":
            image_rad, expected_rad = self._noise, self._s.expected_direction_rad
            return r_kc, aided_direction(a, b, r_kc, expected, image_rad, expected_rad), float(baseline)
        found = None
        if baseline >= self._s.least_baseline_m:
            if self._s.rotation == "essential":
                found = essential_pose(a, b, self._noise)
            else:
                found = homography_pose(a, b, self._noise, (r_kc, expected))
        r_kc, u_kc = (r_kc, expected) if found is None else found
        return r_kc, u_kc, float(baseline)

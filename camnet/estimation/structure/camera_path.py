"""The true path of a camera as a smooth function of time, for simulations.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``p``, ``q`` | ``p_world``, ``q_world`` | (K, 3), (K, 4) | m, - | cubic splines through given poses |
| ``v_c`` | ``v_cam`` | (K, 3) | m/s | ``R(q)^T p'`` |
| ``w_c`` | ``w_cam`` | (K, 3) | rad/s | ``q' = 1/2 B(q) w_c`` |

The velocities are the exact derivatives of the poses, at any time. Equal poses at both ends of a stretch keep the
camera at rest only up to the spline's overshoot; give enough knots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from camnet.errors import ConfigError
from camnet.geometry.rotations import from_yaw, multiply
from camnet.types import Array

__all__ = ["CameraPath", "CameraStates", "forward_camera", "planar_path"]


@dataclass(frozen=True, eq=False, slots=True)
class CameraStates:
    """Poses and velocities of a camera at K times.

    Attributes
    ----------
    t_s : (K,) s
    p_world, q_world : (K, 3) m, (K, 4) camera frame to world
    v_cam, w_cam : (K, 3) m/s, (K, 3) rad/s, both in the camera frame
    """

    t_s: Array
    p_world: Array
    q_world: Array
    v_cam: Array
    w_cam: Array


class CameraPath:
    """A camera's motion through K given poses; call ``states`` for what it is at any times.

    Parameters
    ----------
    t_s : (K,) increasing times, s; K >= 2
    p_world, q_world : (K, 3) positions, m, and (K, 4) orientations, camera frame to world

    Raises
    ------
    ConfigError
        If the times do not increase.
    """

    def __init__(self, t_s: Array, p_world: Array, q_world: Array) -> None:
        if len(t_s) < 2 or not np.all(np.diff(t_s) > 0.0):
            raise ConfigError(f"t_s {np.asarray(t_s)!r}: give two or more increasing times")
        self._p = CubicSpline(t_s, p_world)
        self._q = RotationSpline(t_s, Rotation.from_quat(q_world, scalar_first=True))
        self.start_s, self.end_s = float(t_s[0]), float(t_s[-1])

    def states(self, t_s: Array | float) -> CameraStates:
        """Return the true states at times (K,), s; outside the given times they are extrapolated."""
        t = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        turn = self._q(t)
        return CameraStates(
            t,
            np.asarray(self._p(t)),
            np.asarray(turn.as_quat(scalar_first=True)),
            np.asarray(turn.inv().apply(self._p(t, 1))),
            np.asarray(self._q(t, 1)),
        )


def forward_camera(yaw_rad: float | Array) -> Array:
    """Camera-to-world quaternion (..., 4) of a level camera that looks along the heading ``yaw_rad`` (...,)."""
    return multiply(from_yaw(yaw_rad), np.array([0.5, -0.5, 0.5, -0.5]))


def planar_path(t_s: Array, xy_world: Array, camera_yaw: Array, height_m: float) -> CameraPath:
    """Path of a level camera on a ground robot.

    Parameters
    ----------
    t_s : (K,) times, s
    xy_world : (K, 2) positions, m
    camera_yaw : (K,) where the camera looks, rad from the world's x axis; may leave [-pi, pi] but must be continuous
    height_m : height of the camera, m
    """
    p = np.column_stack([xy_world, np.full(len(xy_world), height_m)])
    return CameraPath(t_s, p, forward_camera(camera_yaw))

"""How distances, directions and orientations change as the camera moves (bell2019, chapter 2).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``v_c``, ``w_c`` | ``v_cam``, ``w_cam`` | (..., 3) | m/s, rad/s | the camera's velocities, in the camera frame |
| ``d'_{i/c} = -u^T v_c`` | ``distance_rate`` | (...,) | m/s | 2.1; the same law for ``d_{k/c}`` |
| ``u'_{i/c}`` | ``direction_rate`` | (..., 3) | 1/s | 2.2, ``-w^x u + (u u^T - I) v_c / d`` |
| ``p'_{k/c}`` | ``position_rate`` | (..., 3) | m/s | 2.3, ``-v_c - w_c^x p`` |
| ``q'_{c/k}`` | ``camera_quaternion_rate`` | (..., 4) | 1/s | 2.3, ``1/2 B(q_{c/k}) w_c`` |
| ``q'_{k/c}`` | ``key_quaternion_rate`` | (..., 4) | 1/s | 2.3, corrected: ``-1/2 w_c (x) q_{k/c}`` |
| ``xi = u' + w_c^x u`` | ``optical_flow`` | (..., 3) | 1/s | 3.2 |
| ``rho = (u u^T - I) v_c`` | ``translational_flow`` | (..., 3) | m/s | 3.2, ``xi d = rho`` |

Departure from print, the last equation of section 2.3. It reads
``q'_{k/c} = -1/2 B(q_{k/c}) w_c``. ``B(q) w`` takes w in the frame that
``R(q)`` maps *from*; ``q_{k/c}`` maps key frame to camera frame, and w_c is in the camera frame. From
``R'_{k/c} = -w_c^x R_{k/c} = R_{k/c} (-R^T w_c)^x`` follows ``q'_{k/c} = -1/2 B(q_{k/c}) R_{k/c}^T w_c``, which is
``-1/2 w_c (x) q_{k/c}``. ``q'_{c/k}`` is right as printed: it maps from the camera frame.
"""

from __future__ import annotations

import numpy as np

from camnet.geometry.rotations import exp, kinematic_matrix, multiply
from camnet.types import Array

__all__ = [
    "camera_quaternion_rate",
    "direction_rate",
    "distance_rate",
    "key_quaternion_rate",
    "optical_flow",
    "position_rate",
    "translational_flow",
    "turn_key_frame",
]


def distance_rate(u: Array, v_cam: Array) -> Array:
    """``d' = -u^T v_c`` (...,) in m/s, of a stationary point in direction u (..., 3)."""
    return np.asarray(-np.sum(u * v_cam, axis=-1))


def translational_flow(u: Array, v_cam: Array) -> Array:
    """``rho = (u u^T - I) v_c`` (..., 3) in m/s: what the camera's translation moves a direction at distance 1 m."""
    return np.asarray(u * np.sum(u * v_cam, axis=-1)[..., None] - v_cam)


def direction_rate(u: Array, d: Array, v_cam: Array, w_cam: Array) -> Array:
    """``u' = -w_c^x u + rho / d`` (..., 3) in 1/s, of a stationary point at distance d (...,)."""
    return np.asarray(translational_flow(u, v_cam) / np.asarray(d)[..., None] - np.cross(w_cam, u))


def optical_flow(u_rate: Array, u: Array, w_cam: Array) -> Array:
    """``xi = u' + w_c^x u`` (..., 3) in 1/s: the flow with the camera's turning taken out; ``xi d = rho``."""
    return np.asarray(u_rate + np.cross(w_cam, u))


def position_rate(p: Array, v_cam: Array, w_cam: Array) -> Array:
    """``p' = -v_c - w_c^x p`` (..., 3) in m/s of a stationary point in the camera frame."""
    return np.asarray(-v_cam - np.cross(w_cam, p))


def camera_quaternion_rate(q_ck: Array, w_cam: Array) -> Array:
    """``q'_{c/k} = 1/2 B(q_{c/k}) w_c`` (..., 4): camera frame to key frame."""
    return np.asarray(0.5 * np.squeeze(kinematic_matrix(q_ck) @ np.asarray(w_cam)[..., None], -1))


def key_quaternion_rate(q_kc: Array, w_cam: Array) -> Array:
    """``q'_{k/c} = -1/2 w_c (x) q_{k/c}`` (..., 4): key frame to camera frame; corrected."""
    w = np.concatenate([np.zeros_like(w_cam[..., :1]), w_cam], axis=-1)
    return np.asarray(-0.5 * multiply(w, q_kc))


def turn_key_frame(q_kc: Array, w_cam: Array, dt_s: float) -> Array:
    """Exact step of ``q_{k/c}`` (..., 4) over ``dt_s`` at a constant ``w_c`` (..., 3)."""
    return multiply(exp(-dt_s * np.asarray(w_cam)), q_kc)

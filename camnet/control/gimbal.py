"""Three-axis gimbal: joints yaw (about the body's z), pan (about the camera's y), tilt (about the camera's x).

``R_bc = Rz(theta_0) N Ry(theta_1) Rx(theta_2)``, with N the camera that looks straight down, its x axis along
the body's x axis (`camnet.geometry.rotations.STRAIGHT_DOWN`). The gimbal stabilises: the joints turn the camera
by the commanded angular velocity minus what the body's own rotation already does, within the joints' rate limits
and behind a first-order lag.
The joint rates are singular at pan = +-90 degrees, where the yaw and tilt axes meet.
"""

from __future__ import annotations

import numpy as np

from camnet.types import Array

__all__ = ["NADIR", "camera_from_body", "camera_rate", "joint_rates", "step"]

#: columns: the camera's x (right), y (down), z (forward) axes in the body frame when all joints are at zero
NADIR: Array = np.diag([1.0, -1.0, -1.0])

_COS_FLOOR = 0.05


def camera_from_body(theta: Array) -> Array:
    """Rotation matrices (N,3,3) from the camera frame to the body frame at joint angles ``theta`` (N,3), rad."""
    c, s = np.cos(theta).T, np.sin(theta).T
    zero, one = np.zeros(len(theta)), np.ones(len(theta))
    rz = np.array([[c[0], -s[0], zero], [s[0], c[0], zero], [zero, zero, one]])
    ry = np.array([[c[1], zero, s[1]], [zero, one, zero], [-s[1], zero, c[1]]])
    rx = np.array([[one, zero, zero], [zero, c[2], -s[2]], [zero, s[2], c[2]]])
    return np.asarray(np.einsum("ijn,jk,kln,lmn->nim", rz, NADIR, ry, rx))


def camera_rate(theta: Array, theta_rate: Array) -> Array:
    """Angular velocity (N,3) of the camera relative to the body, in the camera frame, rad/s."""
    (_, c1, c2), (_, s1, s2) = np.cos(theta).T, np.sin(theta).T
    yaw, pan, tilt = theta_rate.T
    return np.stack([tilt + s1 * yaw, c2 * pan - s2 * c1 * yaw, -s2 * pan - c2 * c1 * yaw], axis=1)


def joint_rates(theta: Array, w_cam: Array) -> Array:
    """Joint rates (N,3) that turn the camera by ``w_cam`` (N,3) relative to the body: inverse of `camera_rate`.

    Near the singularity the cosine of the pan angle is floored, so that the rates stay finite.
    """
    (_, c1, c2), (_, s1, s2) = np.cos(theta).T, np.sin(theta).T
    c1 = np.where(c1 < 0, -1.0, 1.0) * np.maximum(np.abs(c1), _COS_FLOOR)
    yaw = -(s2 * w_cam[:, 1] + c2 * w_cam[:, 2]) / c1
    pan = c2 * w_cam[:, 1] - s2 * w_cam[:, 2]
    return np.stack([yaw, pan, w_cam[:, 0] - s1 * yaw], axis=1)


def step(
    theta: Array,
    theta_rate: Array,
    w_cam_command: Array,
    w_body: Array,
    dt_s: float,
    rate_max_radps: float,
    lag_s: float,
    pan_max_rad: float,
) -> tuple[Array, Array]:
    """Move the joints for one step; returns angles (N,3) and rates (N,3) after it."""
    carried = np.einsum("nji,nj->ni", camera_from_body(theta), w_body)
    wanted = np.clip(joint_rates(theta, w_cam_command - carried), -rate_max_radps, rate_max_radps)
    decay = np.exp(-dt_s / lag_s) if lag_s > 0 else 0.0
    rate = wanted + (theta_rate - wanted) * decay
    moved = theta + dt_s * rate
    stopped = np.abs(moved[:, 1]) > pan_max_rad
    moved[stopped, 1] = np.clip(moved[stopped, 1], -pan_max_rad, pan_max_rad)
    rate[stopped, 1] = 0.0
    return moved, rate

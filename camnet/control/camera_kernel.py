"""Compiled pose and velocity of gimballed cameras from bodies and joints; oracle: `camnet.control.gimbal`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.geometry.rotations_compiled import multiply, rotate, rotate_inverse
from camnet.types import Array

__all__ = ["body_motion", "camera_motion", "first_unsound", "may_touch"]


@njit(cache=True)
def _gimbal_quaternion(yaw: float, pan: float, tilt: float) -> Array:
    """Camera to body: Rz(yaw), straight down, Ry(pan), Rx(tilt)."""
    turn, down, swing, nod = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    turn[0], turn[3] = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    down[1] = 1.0
    swing[0], swing[2] = math.cos(0.5 * pan), math.sin(0.5 * pan)
    nod[0], nod[1] = math.cos(0.5 * tilt), math.sin(0.5 * tilt)
    return multiply(multiply(turn, down), multiply(swing, nod))


@njit(cache=True)
def camera_motion(bodies: Array, memory: Array, offset_body: Array) -> Array:
    """Cameras (N,13) p, q (scalar first), v in the world frame, w in the camera frame.

    ``bodies`` (N,13) and ``memory`` (N,19) are packed as in `camnet.control.quadrotor_kernel`; ``offset_body`` (3,)
    is the optical centre in the body frame, m.
    """
    out = np.empty((bodies.shape[0], 13))
    q_body = np.empty(4)
    for n in range(bodies.shape[0]):
        body, joint, rate = bodies[n], memory[n, 4:7], memory[n, 7:10]
        q_body[0], q_body[1], q_body[2], q_body[3] = body[6], body[3], body[4], body[5]
        arm = rotate(q_body, offset_body)
        q_bc = _gimbal_quaternion(joint[0], joint[1], joint[2])
        out[n, 3:7] = multiply(q_body, q_bc)
        w = body[10:13]
        out[n, 7] = body[7] + w[1] * arm[2] - w[2] * arm[1]
        out[n, 8] = body[8] + w[2] * arm[0] - w[0] * arm[2]
        out[n, 9] = body[9] + w[0] * arm[1] - w[1] * arm[0]
        c1, s1 = math.cos(joint[1]), math.sin(joint[1])
        c2, s2 = math.cos(joint[2]), math.sin(joint[2])
        carried = rotate_inverse(q_bc, rotate_inverse(q_body, w))
        out[n, 10] = carried[0] + rate[2] + s1 * rate[0]
        out[n, 11] = carried[1] + c2 * rate[1] - s2 * c1 * rate[0]
        out[n, 12] = carried[2] - s2 * rate[1] - c2 * c1 * rate[0]
        for i in range(3):
            out[n, i] = body[i] + arm[i]
    return out


@njit(cache=True)
def first_unsound(bodies: Array, start_p: Array, range_m: float, speed_mps: float) -> int:
    """Index of the first body (N,13) that is not finite, too far from its start (N,3) or too fast; -1 if none is.

    Distances and speeds are judged component by component.
    """
    for n in range(bodies.shape[0]):
        for k in range(13):
            if not np.isfinite(bodies[n, k]):
                return n
        for k in range(3):
            if abs(bodies[n, k] - start_p[n, k]) >= range_m or abs(bodies[n, 7 + k]) >= speed_mps:
                return n
    return -1


@njit(cache=True)
def body_motion(bodies: Array) -> Array:
    """Bodies (N,13): p, q (scalar first), v in the world frame, w in the body frame, from the engine's packing."""
    out = np.empty((bodies.shape[0], 13))
    for n in range(bodies.shape[0]):
        body = bodies[n]
        out[n, 0:3] = body[0:3]
        out[n, 3], out[n, 4:7] = body[6], body[3:6]
        out[n, 7:10] = body[7:10]
        out[n, 10:13] = rotate_inverse(out[n, 3:7], body[10:13])
    return out


@njit(cache=True)
def _gap(p: Array, q: Array) -> float:
    """Distance between two points (3,)."""
    x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True)
def may_touch(bodies: Array, radius: float, balls: Array, reach: float, dt: float) -> bool:
    """Whether any body (N,13) may touch the ground, another body or a ball within ``dt`` s; False is certain.

    Bodies lie in balls of ``radius`` m about their positions. ``balls`` (M,5) are centre, radius and top speed of what
    else moves; ``reach`` is how far an acceleration can carry a body in the time, beyond its present velocity, m.
    """
    n = bodies.shape[0]
    for i in range(n):
        own = radius + reach + dt * _gap(bodies[i, 7:10], np.zeros(3))
        if not bodies[i, 2] > own:
            return True
        for j in range(i):
            other = radius + reach + dt * _gap(bodies[j, 7:10], np.zeros(3))
            if not _gap(bodies[i, :3], bodies[j, :3]) > own + other:
                return True
        for m in range(balls.shape[0]):
            if not _gap(bodies[i, :3], balls[m, :3]) > own + balls[m, 3] + dt * balls[m, 4]:
                return True
    return False

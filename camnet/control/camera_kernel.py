"""Compiled pose and velocity of gimballed cameras from bodies and joints; oracle: `camnet.control.gimbal`."""

from __future__ import annotations

import math

import numpy as np

from camnet.geometry.triples import (
    Quaternion,
    Triple,
    borrowing,
    multiply,
    norm,
    rotate,
    rotate_inverse,
    triple,
)
from camnet.types import Array

__all__ = ["body_motion", "first_unsound", "may_touch", "write_bodies", "write_cameras"]


@borrowing
def _gimbal_quaternion(yaw: float, pan: float, tilt: float) -> Quaternion:
    """Camera to body: Rz(yaw), straight down, Ry(pan), Rx(tilt)."""
    turn = (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
    swing = (math.cos(0.5 * pan), 0.0, math.sin(0.5 * pan), 0.0)
    nod = (math.cos(0.5 * tilt), math.sin(0.5 * tilt), 0.0, 0.0)
    return multiply(multiply(turn, (0.0, 1.0, 0.0, 0.0)), multiply(swing, nod))


@borrowing
def write_cameras(bodies: Array, memory: Array, offset_body: Array, out: Array, first: int) -> None:
    """Write cameras p, q (scalar first), v in the world frame, w in the camera frame to the rows from ``first`` on.

    ``bodies`` (N,13) and ``memory`` (N,19) are packed as in `camnet.control.quadrotor_kernel`; ``offset_body`` (3,)
    is the optical centre in the body frame, m.
    """
    for n in range(bodies.shape[0]):
        q_body = (bodies[n, 6], bodies[n, 3], bodies[n, 4], bodies[n, 5])
        arm = rotate(q_body, (offset_body[0], offset_body[1], offset_body[2]))
        q_bc = _gimbal_quaternion(memory[n, 4], memory[n, 5], memory[n, 6])
        q_camera = multiply(q_body, q_bc)
        w, rate = triple(bodies, n, 10), triple(memory, n, 7)
        lever = (w[1] * arm[2] - w[2] * arm[1], w[2] * arm[0] - w[0] * arm[2], w[0] * arm[1] - w[1] * arm[0])
        c1, s1 = math.cos(memory[n, 5]), math.sin(memory[n, 5])
        c2, s2 = math.cos(memory[n, 6]), math.sin(memory[n, 6])
        carried = rotate_inverse(q_bc, rotate_inverse(q_body, w))
        own = (rate[2] + s1 * rate[0], c2 * rate[1] - s2 * c1 * rate[0], -s2 * rate[1] - c2 * c1 * rate[0])
        row = first + n
        for i in range(3):
            out[row, i] = bodies[n, i] + arm[i]
            out[row, 7 + i] = bodies[n, 7 + i] + lever[i]
            out[row, 10 + i] = carried[i] + own[i]
        for i in range(4):
            out[row, 3 + i] = q_camera[i]


@borrowing
def first_unsound(bodies: Array, start_p: Array, range_m: float, speed_mps: float) -> int:
    """Index of the first body (N,13) that is not finite, too far from its start (N,3) or too fast; -1 if none is.

    Distances and speeds are judged component by component.
    """
    for n in range(bodies.shape[0]):
        for k in range(13):
            if not math.isfinite(bodies[n, k]):
                return n
        for k in range(3):
            if abs(bodies[n, k] - start_p[n, k]) >= range_m or abs(bodies[n, 7 + k]) >= speed_mps:
                return n
    return -1


@borrowing
def write_bodies(bodies: Array, out: Array) -> None:
    """Write p, q (scalar first), v in the world frame, w in the body frame, from the engine's packing (N,13)."""
    for n in range(bodies.shape[0]):
        q = (bodies[n, 6], bodies[n, 3], bodies[n, 4], bodies[n, 5])
        w = rotate_inverse(q, triple(bodies, n, 10))
        for i in range(4):
            out[n, 3 + i] = q[i]
        for i in range(3):
            out[n, i], out[n, 7 + i], out[n, 10 + i] = bodies[n, i], bodies[n, 7 + i], w[i]


def body_motion(bodies: Array) -> Array:
    """Bodies (N,13) as `write_bodies` writes them."""
    out = np.empty_like(bodies)
    write_bodies(bodies, out)
    return out


@borrowing
def _gap(p: Triple, q: Triple) -> float:
    """Distance between two points."""
    return norm((p[0] - q[0], p[1] - q[1], p[2] - q[2]))


@borrowing
def may_touch(bodies: Array, radius: float, balls: Array, reach: float, dt: float) -> bool:
    """Whether any body (N,13) may touch the ground, another body or a ball within ``dt`` s; False is certain.

    Bodies lie in balls of ``radius`` m about their positions. ``balls`` (M,5) are centre, radius and top speed of what
    else moves; ``reach`` is how far an acceleration can carry a body in the time, beyond its present velocity, m.
    """
    n = bodies.shape[0]
    for i in range(n):
        own = radius + reach + dt * norm(triple(bodies, i, 7))
        if not bodies[i, 2] > own:
            return True
        for j in range(i):
            other = radius + reach + dt * norm(triple(bodies, j, 7))
            if not _gap(triple(bodies, i, 0), triple(bodies, j, 0)) > own + other:
                return True
        for m in range(balls.shape[0]):
            if not _gap(triple(bodies, i, 0), triple(balls, m, 0)) > own + balls[m, 3] + dt * balls[m, 4]:
                return True
    return False

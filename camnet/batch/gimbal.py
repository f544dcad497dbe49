"""The gimbal of one quadrotor, and its camera: joints after a period, pose and velocities of the camera.

The gimbal is that of `camnet.control.gimbal`: yaw, then pan, then tilt, the camera looking straight down at rest; the
arrays' rows and ``c`` are those of `camnet.batch.body`. Angles in rad, rates in rad/s; an angle that is turned by many
small steps is kept as (cosine, sine).
"""

from __future__ import annotations

from camnet.batch.compiled import inlined, outer
from camnet.batch.triples import circle, cosine_and_sine, cross
from camnet.geometry.triples import Quaternion, Triple, multiply, rotate, rotate_inverse
from camnet.types import Array

__all__ = ["Constants", "between", "camera_at", "camera_of", "gimbal_goals", "joint", "turn_gimbal", "turned"]

#: of the model: an array, or the same numbers as a tuple
Constants = Array | tuple[float, ...]


@inlined
def joint(angle: float, rate: float, goal: float, c: Constants) -> tuple[float, float]:
    """One gimbal joint after a physics step: angle and rate."""
    fastest = c[20]
    goal = min(max(goal, -fastest), fastest)
    rate = goal + (rate - goal) * c[21]
    return angle + c[0] / c[26] * rate, rate


@inlined
def gimbal_goals(
    yaw: tuple[float, float], pan: tuple[float, float], tilt: tuple[float, float], u: Triple, w: Triple
) -> Triple:
    """Joint rates that turn the camera at ``u`` (camera frame) while the body turns at ``w`` (body frame).

    The joints are given as (cosine, sine); `camnet.control.gimbal.joint_rates` has the same for angles, on arrays.
    """
    c0, s0 = yaw
    c1, s1 = pan
    c2, s2 = tilt
    x, y, z = c0 * w[0] + s0 * w[1], s0 * w[0] - c0 * w[1], -w[2]
    x, z = c1 * x - s1 * z, s1 * x + c1 * z
    y, z = c2 * y + s2 * z, c2 * z - s2 * y
    wx, wy, wz = u[0] - x, u[1] - y, u[2] - z
    safe = -1.0 / (max(abs(c1), 0.05) * (-1.0 if c1 < 0 else 1.0))
    yaw_rate = (s2 * wy + c2 * wz) * safe
    return yaw_rate, c2 * wy - s2 * wz, wx - s1 * yaw_rate


@inlined
def turned(angle: tuple[float, float], by: tuple[float, float]) -> tuple[float, float]:
    """(cosine, sine) of the sum of two angles."""
    return angle[0] * by[0] - angle[1] * by[1], angle[1] * by[0] + angle[0] * by[1]


@inlined
def between(a: Triple, b: Triple, share: float) -> Triple:
    """Point that is ``share`` of the way from ``a`` to ``b``."""
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@outer
def turn_gimbal(
    joints: Triple, rates: Triple, u: Triple, w0: Triple, w1: Triple, c: Constants
) -> tuple[Triple, Triple]:
    """Joints and rates after a period in which the body's angular velocity (body frame) went from ``w0`` to ``w1``.

    ``u`` is the camera's commanded angular velocity in its own frame.
    """
    substeps = int(c[26])
    yaw, pan, tilt = cosine_and_sine(joints[0]), cosine_and_sine(joints[1]), cosine_and_sine(joints[2])
    for k in range(substeps):
        goals = gimbal_goals(yaw, pan, tilt, u, between(w0, w1, (k + 0.5) / substeps))
        a, a_rate = joint(joints[0], rates[0], goals[0], c)
        b, b_rate = joint(joints[1], rates[1], goals[1], c)
        d, d_rate = joint(joints[2], rates[2], goals[2], c)
        if abs(b) > c[22]:
            b, b_rate = min(max(b, -c[22]), c[22]), 0.0
        yaw = turned(yaw, cosine_and_sine(a - joints[0]))
        pan = turned(pan, cosine_and_sine(b - joints[1]))
        tilt = turned(tilt, cosine_and_sine(d - joints[2]))
        joints, rates = (a, b, d), (a_rate, b_rate, d_rate)
    return joints, rates


@inlined
def camera_at(
    p: Triple, q: Quaternion, v: Triple, w: Triple, joints: Triple, rates: Triple, offset: Triple
) -> tuple[Triple, Quaternion, Triple, Triple]:
    """p, q, v (world), w (camera frame) of the camera of a body with p, q, v, w (world) and its gimbal."""
    arm = rotate(q, offset)
    (c0, s0), (c1, s1), (c2, s2) = circle(0.5 * joints[0]), circle(0.5 * joints[1]), circle(0.5 * joints[2])
    # Rz(yaw), straight down, then Ry(pan) Rx(tilt)
    full = multiply(q, multiply((0.0, c0, s0, 0.0), (c1 * c2, c1 * s2, s1 * c2, -s1 * s2)))
    lever = cross(w, arm)
    carried = rotate_inverse(full, w)
    # double angles of pan and tilt
    cp, sp, ct, st = c1 * c1 - s1 * s1, 2.0 * s1 * c1, c2 * c2 - s2 * s2, 2.0 * s2 * c2
    yaw_rate, pan_rate, tilt_rate = rates
    return (
        (p[0] + arm[0], p[1] + arm[1], p[2] + arm[2]),
        full,
        (v[0] + lever[0], v[1] + lever[1], v[2] + lever[2]),
        (
            carried[0] + tilt_rate + sp * yaw_rate,
            carried[1] + ct * pan_rate - st * cp * yaw_rate,
            carried[2] - st * pan_rate - ct * cp * yaw_rate,
        ),
    )


@outer
def camera_of(bodies: Array, memory: Array, e: int, n: int, offset: Array, cameras: Array) -> None:
    """Write p, q (scalar first), v (world), w (camera frame) of the agent's camera to its row of ``cameras``.

    ``offset`` (3,) is the optical centre in the body frame, m; `camnet.control.camera_kernel` is the oracle.
    """
    b, m = bodies, memory
    p, q, v, w = camera_at(
        (b[e, n, 0], b[e, n, 1], b[e, n, 2]),
        (b[e, n, 6], b[e, n, 3], b[e, n, 4], b[e, n, 5]),
        (b[e, n, 7], b[e, n, 8], b[e, n, 9]),
        (b[e, n, 10], b[e, n, 11], b[e, n, 12]),
        (m[e, n, 4], m[e, n, 5], m[e, n, 6]),
        (m[e, n, 7], m[e, n, 8], m[e, n, 9]),
        (offset[0], offset[1], offset[2]),
    )
    for i in range(3):
        cameras[e, n, i], cameras[e, n, 7 + i], cameras[e, n, 10 + i] = p[i], v[i], w[i]
    for i in range(4):
        cameras[e, n, 3 + i] = q[i]

"""Flight of one quadrotor with its gimbal for a control period: inner loop, rotors, air, rigid body, all in registers.

The inner loop is that of `camnet.control.quadrotor` (whose compiled form works on arrays, all agents at once), the
rigid body that of Bullet's multi-body base without joints (Bullet 3, ``btMultiBody``): semi-implicit Euler,

The inner loop runs once in ``substeps`` physics steps, the force and torque it makes are held meanwhile; rotors and
gimbal follow at the physics rate.

    v+ = v + dt (F / m + g)          w+ = w + dt R J^-1 (tau - w_b x J w_b)          gyroscopic term explicit
    p+ = p + dt v+                   q+ = exp(dt w+ / 2) q, normalised               with the new velocities

so a trajectory agrees with PyBullet's to rounding as long as nothing touches. Turning is worked out in the body's
frame, which saves a matrix in every step:

    w_b+ = w_b + dt J^-1 (tau_b - w_b x J w_b)      the step's turn is about w_b+ itself and leaves it as it is
    q+ = q exp(dt w_b+ / 2)                         tau_b+ = R(exp(dt w_b+ / 2))^T tau_b, as tau stays in the world

| array | row of one agent | as in |
| --- | --- | --- |
| ``bodies`` | p (3), q as x y z w (4), v (3), w_world (3) | `camnet.control.quadrotor_kernel` |
| ``memory`` | rotors (4), gimbal angles and rates (3, 3), integral (3), thrust axis and its rate (3, 3) | the same |
| ``command`` | camera velocity (3), acceleration (3), camera angular velocity (3), yaw, wind (3) | the same |
| ``c`` | ``pack_model`` (27,) | the same |
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inlined, outer
from camnet.batch.triples import circle, cosine_and_sine, cross, turn
from camnet.geometry.triples import (
    Matrix,
    Quaternion,
    Triple,
    into,
    matrix,
    multiply,
    out_of,
    rotate,
    rotate_inverse,
    size,
)
from camnet.types import Array

__all__ = ["Constants", "camera_of", "fly"]

_FourRotors = tuple[float, float, float, float]
#: of the model: an array, or the same numbers as a tuple
Constants = Array | tuple[float, ...]


@inlined
def _specific_force(u: Triple, a: Triple, v: Triple, integral: Triple, c: Constants) -> tuple[Triple, Triple]:
    """Commanded acceleration before gravity and drag, and the velocity integral after the step."""
    kv, ki, a_max = c[16], c[17], c[15]
    ex, ey, ez = u[0] - v[0], u[1] - v[1], u[2] - v[2]
    fx, fy, fz = a[0] + kv * ex + integral[0], a[1] + kv * ey + integral[1], a[2] + kv * ez + integral[2]
    length = size(fx, fy, fz)
    if length > a_max:
        scale = a_max / length
        return (fx * scale, fy * scale, fz * scale), integral
    gain = c[0] * ki
    return (fx, fy, fz), (integral[0] + gain * ex, integral[1] + gain * ey, integral[2] + gain * ez)


@inlined
def _axis_rate(old: Triple, axis: Triple, rate: Triple, c: Constants) -> Triple:
    """Angular velocity of the desired thrust direction, filtered and bounded."""
    decay, fastest, per_s = c[24], c[25], 1.0 / c[0]
    tx, ty, tz = (
        (old[1] * axis[2] - old[2] * axis[1]) * per_s,
        (old[2] * axis[0] - old[0] * axis[2]) * per_s,
        (old[0] * axis[1] - old[1] * axis[0]) * per_s,
    )
    x, y, z = tx + (rate[0] - tx) * decay, ty + (rate[1] - ty) * decay, tz + (rate[2] - tz) * decay
    length = size(x, y, z)
    if length > fastest:
        return x * (fastest / length), y * (fastest / length), z * (fastest / length)
    return x, y, z


@inlined
def _torque(
    r: Matrix, axis: Triple, heading: tuple[float, float], w: Triple, rate: Triple, c: Constants
) -> Triple:
    """Body torque towards the attitude with z along ``axis`` and x towards the heading (cosine, sine)."""
    hx, hy = heading
    x, y, z = -axis[2] * hy, axis[2] * hx, axis[0] * hy - axis[1] * hx
    scale = 1.0 / size(x, y, z)
    side = (x * scale, y * scale, z * scale)
    front = (
        side[1] * axis[2] - side[2] * axis[1],
        side[2] * axis[0] - side[0] * axis[2],
        side[0] * axis[1] - side[1] * axis[0],
    )
    f, s, a = into(r, front), into(r, side), into(r, axis)  # rows of E = D^T R
    k_r, k_w = c[18], c[19]
    wanted = into(r, rate)
    jx, jy, jz = c[2], c[3], c[4]
    return (
        jx * (-k_r * 0.5 * (a[1] - s[2]) - k_w * (w[0] - wanted[0])) + (jz - jy) * w[1] * w[2],
        jy * (-k_r * 0.5 * (f[2] - a[0]) - k_w * (w[1] - wanted[1])) + (jx - jz) * w[2] * w[0],
        jz * (-k_r * 0.5 * (s[0] - f[1]) - k_w * (w[2] - wanted[2])) + (jy - jx) * w[0] * w[1],
    )


@inlined
def allocate(thrust: float, tau: Triple, c: Constants) -> _FourRotors:
    """Speeds of the rotors that make thrust and torque, within what they can; rad/s."""
    arm, k, kq = c[5], c[6], c[7]
    t, x, y, z = thrust / k, tau[0] / (arm * k), tau[1] / (arm * k), tau[2] / kq
    most = c[8] * c[8]
    f, g = min(max(0.25 * (t + x - y), 0.0), most), min(max(0.25 * (t + x + y), 0.0), most)
    h, i = min(max(0.25 * (t - x + y), 0.0), most), min(max(0.25 * (t - x - y), 0.0), most)
    low, high = max(-f, g - most, -h, i - most), min(most - f, g, most - h, i)
    turn = min(max(0.25 * z, low), high)  # yaw takes what lift, roll and pitch leave
    return (
        math.sqrt(min(max(f + turn, 0.0), most)),
        math.sqrt(min(max(g - turn, 0.0), most)),
        math.sqrt(min(max(h + turn, 0.0), most)),
        math.sqrt(min(max(i - turn, 0.0), most)),
    )


@inlined
def aim_thrust(
    q: Quaternion,
    v: Triple,
    w: Triple,
    u: Triple,
    a: Triple,
    heading: tuple[float, float],
    integral: Triple,
    axis: Triple,
    axis_rate: Triple,
    c: Constants,
) -> tuple[_FourRotors, Triple, Triple, Triple, Triple]:
    """Speeds asked of the rotors, the body's own angular velocity, and what is remembered: integral, axis, its rate."""
    mass, gravity = c[1], c[13]
    r = matrix(q)
    wb, vb = into(r, w), into(r, v)
    f, integral = _specific_force(_slowed(u, c[14]), a, v, integral, c)
    drag = out_of(r, (c[10] * vb[0], c[11] * vb[1], c[12] * vb[2]))
    fx, fy = mass * f[0] + drag[0], mass * f[1] + drag[1]
    fz = max(mass * (f[2] + gravity) + drag[2], 0.3 * mass * gravity)
    scale = 1.0 / size(fx, fy, fz)
    new_axis = (fx * scale, fy * scale, fz * scale)
    rate = _axis_rate(axis, new_axis, axis_rate, c)
    thrust = fx * r[0][2] + fy * r[1][2] + fz * r[2][2]
    return allocate(thrust, _torque(r, new_axis, heading, wb, rate, c), c), wb, integral, new_axis, rate


@inlined
def _slowed(u: Triple, v_max: float) -> Triple:
    """Velocity ``u``, at most as fast as ``v_max``."""
    speed = size(u[0], u[1], u[2])
    scale = v_max / speed if speed > v_max else 1.0
    return u[0] * scale, u[1] * scale, u[2] * scale


@inlined
def lag_rotor(goal: float, speed: float, c: Constants) -> float:
    """Speed of a rotor after a physics step in which ``goal`` is asked for."""
    driven = min(max(speed + c[23] * (goal - speed), 0.0), c[8])
    return driven + (speed - driven) * c[9]


@inlined
def push(q: Quaternion, v: Triple, wind: Triple, squares: _FourRotors, c: Constants) -> tuple[Triple, Triple]:
    """Gain of velocity in a physics step, and torque on the body; ``squares`` of speeds are summed over a period."""
    mass, gravity, share = c[1], c[13], 1.0 / c[26]
    dt, lever, kq = c[0] * share, c[5] * c[6] * share, c[7] * share
    s = squares
    r = matrix(q)
    lift = c[6] * share * (s[0] + s[1] + s[2] + s[3])
    tau = (
        lever * (s[0] + s[1] - s[2] - s[3]),
        lever * (s[1] + s[2] - s[0] - s[3]),
        kq * (s[0] - s[1] + s[2] - s[3]),
    )
    air = into(r, (v[0] - wind[0], v[1] - wind[1], v[2] - wind[2]))
    force = out_of(r, (-c[10] * air[0], -c[11] * air[1], lift - c[12] * air[2]))
    gain = (dt / mass * force[0], dt / mass * force[1], dt * (force[2] / mass - gravity))
    return gain, tau


@inlined
def shifted(p: Triple, v: Triple, gain: Triple, dt: float) -> tuple[Triple, Triple]:
    """Position and velocity after a physics step in which the velocity gains ``gain``."""
    v = (v[0] + gain[0], v[1] + gain[1], v[2] + gain[2])
    return (p[0] + dt * v[0], p[1] + dt * v[1], p[2] + dt * v[2]), v


@inlined
def spun_up(w: Triple, torque: Triple, dt: float, c: Constants) -> Triple:
    """Angular velocity after a physics step under a torque, both in the body's frame."""
    jx, jy, jz = c[2], c[3], c[4]
    return (
        w[0] + dt / jx * (torque[0] - (jz - jy) * (w[1] * w[2])),
        w[1] + dt / jy * (torque[1] - (jx - jz) * (w[2] * w[0])),
        w[2] + dt / jz * (torque[2] - (jy - jx) * (w[0] * w[1])),
    )


@inlined
def spun(q: Quaternion, by: Quaternion) -> Quaternion:
    """``q by``, normalised: both are of unit length to rounding, so one step of Newton's for the root is exact."""
    q = multiply(q, by)
    scale = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


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
    """Joint rates that turn the camera as commanded, given the joints' (cosine, sine) and the body's rate."""
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
def _turn_gimbal(
    joints: Triple, rates: Triple, u: Triple, w0: Triple, w1: Triple, c: Constants
) -> tuple[Triple, Triple]:
    """Joints and rates after a period in which the body's angular velocity went from ``w0`` to ``w1``."""
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


@outer
def _lag_rotors(goals: _FourRotors, rotors: _FourRotors, c: Constants) -> tuple[_FourRotors, _FourRotors]:
    """Speeds of the rotors after a period, and the sums of their squares on the way."""
    a, b, d, e = rotors
    aa, bb, dd, ee = 0.0, 0.0, 0.0, 0.0
    for _ in range(int(c[26])):
        a, b = lag_rotor(goals[0], a, c), lag_rotor(goals[1], b, c)
        d, e = lag_rotor(goals[2], d, c), lag_rotor(goals[3], e, c)
        aa, bb, dd, ee = aa + a * a, bb + b * b, dd + d * d, ee + e * e
    return (a, b, d, e), (aa, bb, dd, ee)


@outer
def fly(
    bodies: Array,
    memory: Array,
    e: int,
    n: int,
    u: Triple,
    a: Triple,
    w_cam: Triple,
    heading: tuple[float, float],
    wind: Triple,
    c: Constants,
    periods: int,
) -> None:
    """Advance agent ``n`` of environment ``e`` by ``periods`` periods of the inner loop under one command.

    ``bodies`` (E,N,13) and ``memory`` (E,N,19) change in place; the command is the velocity ``u``, the feedforward
    ``a`` and the angular velocity ``w_cam`` of the camera, the body's heading as (cosine, sine), and the wind.
    """
    substeps = int(c[26])
    dt = c[0] / substeps
    p = (bodies[e, n, 0], bodies[e, n, 1], bodies[e, n, 2])
    q: Quaternion = (bodies[e, n, 6], bodies[e, n, 3], bodies[e, n, 4], bodies[e, n, 5])
    v = (bodies[e, n, 7], bodies[e, n, 8], bodies[e, n, 9])
    w = (bodies[e, n, 10], bodies[e, n, 11], bodies[e, n, 12])
    rotors = (memory[e, n, 0], memory[e, n, 1], memory[e, n, 2], memory[e, n, 3])
    joints = (memory[e, n, 4], memory[e, n, 5], memory[e, n, 6])
    rates = (memory[e, n, 7], memory[e, n, 8], memory[e, n, 9])
    integral = (memory[e, n, 10], memory[e, n, 11], memory[e, n, 12])
    axis = (memory[e, n, 13], memory[e, n, 14], memory[e, n, 15])
    rate = (memory[e, n, 16], memory[e, n, 17], memory[e, n, 18])
    for _ in range(periods):
        goals, before, integral, axis, rate = aim_thrust(q, v, w, u, a, heading, integral, axis, rate, c)
        rotors, squares = _lag_rotors(goals, rotors, c)
        gain, torque = push(q, v, wind, squares, c)
        after = before
        for _ in range(substeps):
            p, v = shifted(p, v, gain, dt)
            after = spun_up(after, torque, dt, c)
            by = turn(dt * after[0], dt * after[1], dt * after[2])
            q, torque = spun(q, by), rotate_inverse(by, torque)
        w = rotate(q, after)
        joints, rates = _turn_gimbal(joints, rates, w_cam, before, after, c)
    _store(bodies, memory, e, n, p, q, v, w, rotors, joints, rates)
    for i in range(3):
        memory[e, n, 10 + i], memory[e, n, 13 + i], memory[e, n, 16 + i] = integral[i], axis[i], rate[i]


@outer
def _store(
    bodies: Array,
    memory: Array,
    e: int,
    n: int,
    p: Triple,
    q: Quaternion,
    v: Triple,
    w: Triple,
    rotors: _FourRotors,
    joints: Triple,
    rates: Triple,
) -> None:
    bodies[e, n, 6] = q[0]
    for i in range(3):
        bodies[e, n, i], bodies[e, n, 3 + i] = p[i], q[1 + i]
        bodies[e, n, 7 + i], bodies[e, n, 10 + i] = v[i], w[i]
        memory[e, n, 4 + i], memory[e, n, 7 + i] = joints[i], rates[i]
    for i in range(4):
        memory[e, n, i] = rotors[i]


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

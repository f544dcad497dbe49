"""Flight of one quadrotor with its gimbal for a control period: inner loop, rotors, air, rigid body, all in registers.

The inner loop is that of `camnet.control.quadrotor` (whose compiled form works on arrays, all agents at once), the
rigid body that of Bullet's multi-body base without joints (Bullet 3, ``btMultiBody``). The inner loop runs once in
``substeps`` physics steps, the force and torque it makes are held meanwhile; rotors and gimbal follow at the physics
rate. Semi-implicit Euler:

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
from camnet.batch.gimbal import Constants, turn_gimbal
from camnet.batch.triples import turn
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

__all__ = ["fly"]

_FourRotors = tuple[float, float, float, float]


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
        joints, rates = turn_gimbal(joints, rates, w_cam, before, after, c)
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

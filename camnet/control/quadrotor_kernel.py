"""Compiled twin of `camnet.control.quadrotor` (its test oracle): one call, all agents, packed arrays.

| array | row of one agent |
| --- | --- |
| ``bodies`` (N,13) | p (3), q as x y z w (4; the engine's order), v (3), w_world (3) |
| ``memory`` (N,19), updated in place | rotor speeds (4), gimbal angles (3) and rates (3), velocity integral (3),
| | desired thrust direction (3) and its angular velocity (3) |
| ``command`` (N,13) | camera velocity (3), reference acceleration (3), camera angular velocity (3), yaw, wind (3) |
| ``constants`` (27,) | see `pack_model` |
| ``wrench`` (N,6), written | force (3) and torque (3), world frame |
"""

from __future__ import annotations

import math

import numpy as np

from camnet.control.quadrotor import AXIS_RATE_LAG_S, AXIS_RATE_MAX_RADPS, QuadrotorModel, overdrive
from camnet.geometry.triples import Matrix, Triple, borrowing, into, norm, out_of, triple
from camnet.types import Array

__all__ = ["MEMORY", "hold_command", "pack_model", "step_packed", "turn_gimbals"]

#: columns of ``memory``
MEMORY = {
    "rotor": slice(0, 4),
    "theta": slice(4, 7),
    "theta_rate": slice(7, 10),
    "integral": slice(10, 13),
    "thrust_axis": slice(13, 16),
    "axis_rate": slice(16, 19),
}


def pack_model(model: QuadrotorModel) -> Array:
    """Constants of the kernel, in its order."""
    m = model
    rotor_decay = math.exp(-m.substep_s / m.motor_lag_s) if m.motor_lag_s > 0 else 0.0
    gimbal_decay = math.exp(-m.substep_s / m.gimbal_lag_s) if m.gimbal_lag_s > 0 else 0.0
    scalars = [m.dt_s, m.mass_kg, *m.inertia_kgm2, m.arm_m / math.sqrt(2.0), m.thrust_coefficient]
    scalars += [m.torque_coefficient, m.rotor_max_radps, rotor_decay, *m.drag_n_per_mps, m.gravity_mps2]
    scalars += [m.v_max_mps, m.a_max_mps2, m.velocity_gain_per_s, m.velocity_integral_per_s2]
    scalars += [m.attitude_radps**2, 2 * m.attitude_damping * m.attitude_radps]
    scalars += [m.gimbal_rate_max_radps, gimbal_decay, m.gimbal_pan_max_rad, overdrive(m)]
    scalars += [math.exp(-m.dt_s / AXIS_RATE_LAG_S), AXIS_RATE_MAX_RADPS, float(m.substeps)]
    return np.array(scalars)


@borrowing
def _rotation(bodies: Array, n: int) -> Matrix:
    """Rotation matrix of the engine's x y z w quaternion."""
    x, y, z, w = bodies[n, 3], bodies[n, 4], bodies[n, 5], bodies[n, 6]
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@borrowing
def _commanded_force(n: int, bodies: Array, memory: Array, command: Array, r: Matrix, c: Array) -> Triple:
    """Force that the rotors should make; updates the velocity integral."""
    dt, mass, gravity, v_max, a_max, kv, ki = c[0], c[1], c[13], c[14], c[15], c[16], c[17]
    u, v = triple(command, n, 0), triple(bodies, n, 7)
    speed = norm(u)
    scale = v_max / speed if speed > v_max else 1.0
    e = (scale * u[0] - v[0], scale * u[1] - v[1], scale * u[2] - v[2])
    f = (
        command[n, 3] + kv * e[0] + memory[n, 10],
        command[n, 4] + kv * e[1] + memory[n, 11],
        command[n, 5] + kv * e[2] + memory[n, 12],
    )
    size = norm(f)
    scale = 1.0
    if size > a_max:
        scale = a_max / size
    else:
        for i in range(3):
            memory[n, 10 + i] += dt * ki * e[i]
    along = into(r, v)
    drag = out_of(r, (c[10] * along[0], c[11] * along[1], c[12] * along[2]))
    lift = mass * (f[2] * scale + gravity) + drag[2]
    return (
        mass * (f[0] * scale) + drag[0],
        mass * (f[1] * scale) + drag[1],
        max(lift, 0.3 * mass * gravity),
    )


@borrowing
def _turn_axis(n: int, memory: Array, axis: Triple, c: Array) -> None:
    """Remember the desired thrust direction and its angular velocity, filtered and bounded."""
    dt, decay, fastest = c[0], c[24], c[25]
    old, rate = triple(memory, n, 13), triple(memory, n, 16)
    turned = (
        (old[1] * axis[2] - old[2] * axis[1]) / dt,
        (old[2] * axis[0] - old[0] * axis[2]) / dt,
        (old[0] * axis[1] - old[1] * axis[0]) / dt,
    )
    rate = (
        turned[0] + (rate[0] - turned[0]) * decay,
        turned[1] + (rate[1] - turned[1]) * decay,
        turned[2] + (rate[2] - turned[2]) * decay,
    )
    size = norm(rate)
    scale = fastest / size if size > fastest else 1.0
    for i in range(3):
        memory[n, 13 + i] = axis[i]
        memory[n, 16 + i] = rate[i] * scale


@borrowing
def _attitude_torque(n: int, r: Matrix, f: Triple, yaw: float, w: Triple, memory: Array, c: Array) -> Triple:
    """Body torque towards the attitude whose z axis is along f and whose x axis heads to yaw."""
    size = norm(f)
    up = (f[0] / size, f[1] / size, f[2] / size)
    hx, hy = math.cos(yaw), math.sin(yaw)
    x, y, z = -up[2] * hy, up[2] * hx, up[0] * hy - up[1] * hx  # b3 x heading
    size = norm((x, y, z))
    side = (x / size, y / size, z / size)
    front = (
        side[1] * up[2] - side[2] * up[1],
        side[2] * up[0] - side[0] * up[2],
        side[0] * up[1] - side[1] * up[0],
    )
    e0, e1, e2 = into(r, front), into(r, side), into(r, up)  # rows of R_d^T R
    _turn_axis(n, memory, up, c)
    k_r, k_w = c[18], c[19]
    wanted = into(r, triple(memory, n, 16))
    jx, jy, jz = c[2], c[3], c[4]
    return (
        jx * (-k_r * 0.5 * (e2[1] - e1[2]) - k_w * (w[0] - wanted[0])) + (jz - jy) * w[1] * w[2],
        jy * (-k_r * 0.5 * (e0[2] - e2[0]) - k_w * (w[1] - wanted[1])) + (jx - jz) * w[2] * w[0],
        jz * (-k_r * 0.5 * (e1[0] - e0[1]) - k_w * (w[2] - wanted[2])) + (jy - jx) * w[0] * w[1],
    )


@borrowing
def _level(i: int, thrust: float, tau: Triple, c: Array) -> float:
    """Squared speed of rotor ``i`` that lift, roll and pitch ask for."""
    arm, k, most = c[5], c[6], c[8] * c[8]
    sx = 1.0 if i == 0 or i == 3 else -1.0
    sy = 1.0 if i < 2 else -1.0
    level = 0.25 * (thrust / k + sy * tau[0] / (arm * k) - sx * tau[1] / (arm * k))
    return float(min(max(level, 0.0), most))


@borrowing
def _turn_rotors(n: int, memory: Array, thrust: float, tau: Triple, c: Array) -> tuple[float, Triple]:
    """Allocate, saturate and lag the rotor speeds; returns the mean thrust and body torque they make."""
    arm, k, kq, fastest, decay, substeps = c[5], c[6], c[7], c[8], c[9], int(c[26])
    low, high, most = -math.inf, math.inf, fastest * fastest
    for i in range(4):
        level = _level(i, thrust, tau, c)
        low = max(low, -level if i % 2 == 0 else level - most)
        high = min(high, most - level if i % 2 == 0 else level)
    turn = min(max(0.25 * tau[2] / kq, low), high)
    made, tx, ty, tz = 0.0, 0.0, 0.0, 0.0
    for i in range(4):
        sx = 1.0 if i == 0 or i == 3 else -1.0
        sy = 1.0 if i < 2 else -1.0
        spin = 1.0 if i % 2 == 0 else -1.0
        square = _level(i, thrust, tau, c) + spin * turn
        goal = math.sqrt(min(max(square, 0.0), most))
        speed, mean_square = memory[n, i], 0.0
        for _ in range(substeps):
            command = min(max(speed + c[23] * (goal - speed), 0.0), fastest)
            speed = command + (speed - command) * decay
            mean_square += speed * speed
        memory[n, i] = speed
        mean_square /= substeps
        lift = k * mean_square
        made += lift
        tx += arm * sy * lift
        ty -= arm * sx * lift
        tz += kq * spin * mean_square
    return made, (tx, ty, tz)


@borrowing
def _turn_gimbal(n: int, memory: Array, command: Array, w: Triple, c: Array) -> None:
    """Move the joints for a substep by the commanded rate less what the body's rotation already does."""
    dt, fastest, decay, pan_max = c[0] / c[26], c[20], c[21], c[22]
    c0, s0 = math.cos(memory[n, 4]), math.sin(memory[n, 4])
    c1, s1 = math.cos(memory[n, 5]), math.sin(memory[n, 5])
    c2, s2 = math.cos(memory[n, 6]), math.sin(memory[n, 6])
    # the body's angular velocity after the yaw joint, in the straight-down frame, after pan, after tilt
    x, y, z = c0 * w[0] + s0 * w[1], s0 * w[0] - c0 * w[1], -w[2]
    x, z = c1 * x - s1 * z, s1 * x + c1 * z
    y, z = c2 * y + s2 * z, c2 * z - s2 * y
    wx, wy, wz = command[n, 6] - x, command[n, 7] - y, command[n, 8] - z
    safe = max(abs(c1), 0.05) * (-1.0 if c1 < 0 else 1.0)
    yaw = -(s2 * wy + c2 * wz) / safe
    rates = (yaw, c2 * wy - s2 * wz, wx - s1 * yaw)
    for i in range(3):
        goal = min(max(rates[i], -fastest), fastest)
        memory[n, 7 + i] = goal + (memory[n, 7 + i] - goal) * decay
        memory[n, 4 + i] += dt * memory[n, 7 + i]
    if abs(memory[n, 5]) > pan_max:
        memory[n, 5] = min(max(memory[n, 5], -pan_max), pan_max)
        memory[n, 8] = 0.0


@borrowing
def hold_command(held: Array, v_world: Array, w_cam: Array, a_world: Array, wind: Array) -> bool:
    """Write what is held for a control period into ``command``, all (N,3); False, and nothing done, if not finite."""
    for n in range(held.shape[0]):
        for i in range(3):
            if not math.isfinite(v_world[n, i] + w_cam[n, i] + a_world[n, i]):
                return False
    for n in range(held.shape[0]):
        for i in range(3):
            held[n, i], held[n, 3 + i], held[n, 6 + i] = v_world[n, i], a_world[n, i], w_cam[n, i]
            held[n, 10 + i] = wind[n, i]
    return True


@borrowing
def step_packed(bodies: Array, memory: Array, command: Array, constants: Array, wrench: Array) -> None:
    """One period of the inner loop of all agents; see the module's table. The gimbals move with `turn_gimbals`."""
    c = constants
    for n in range(bodies.shape[0]):
        r = _rotation(bodies, n)
        w = into(r, triple(bodies, n, 10))
        f = _commanded_force(n, bodies, memory, command, r, c)
        thrust = f[0] * r[0][2] + f[1] * r[1][2] + f[2] * r[2][2]
        tau = _attitude_torque(n, r, f, command[n, 9], w, memory, c)
        lift, turning = _turn_rotors(n, memory, thrust, tau, c)
        v = triple(bodies, n, 7)
        air = into(r, (v[0] - command[n, 10], v[1] - command[n, 11], v[2] - command[n, 12]))
        force = out_of(r, (-c[10] * air[0], -c[11] * air[1], -c[12] * air[2] + lift))
        torque = out_of(r, turning)
        for i in range(3):
            wrench[n, i], wrench[n, 3 + i] = force[i], torque[i]


@borrowing
def turn_gimbals(before: Array, after: Array, memory: Array, command: Array, constants: Array) -> None:
    """Move all gimbals through the period in which the bodies (N,13) went from ``before`` to ``after``."""
    c = constants
    substeps = int(c[26])
    for n in range(before.shape[0]):
        w0 = into(_rotation(before, n), triple(before, n, 10))
        w1 = into(_rotation(after, n), triple(after, n, 10))
        for k in range(substeps):
            share = (k + 0.5) / substeps
            w = (
                w0[0] + share * (w1[0] - w0[0]),
                w0[1] + share * (w1[1] - w0[1]),
                w0[2] + share * (w1[2] - w0[2]),
            )
            _turn_gimbal(n, memory, command, w, c)

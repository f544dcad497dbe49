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
from numba import njit

from camnet.control.quadrotor import AXIS_RATE_LAG_S, AXIS_RATE_MAX_RADPS, QuadrotorModel, overdrive
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


@njit(cache=True)
def _norm3(x: float, y: float, z: float) -> float:
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True)
def _rotation(body: Array) -> Array:
    """Rotation matrix of the engine's x y z w quaternion."""
    x, y, z, w = body[3], body[4], body[5], body[6]
    r = np.empty((3, 3))
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return r


@njit(cache=True)
def _commanded_force(body: Array, memory: Array, command: Array, r: Array, c: Array) -> Array:
    """Force that the rotors should make; updates the velocity integral."""
    dt, mass, gravity, v_max, a_max, kv, ki = c[0], c[1], c[13], c[14], c[15], c[16], c[17]
    speed = _norm3(command[0], command[1], command[2])
    scale = v_max / speed if speed > v_max else 1.0
    f = np.empty(3)
    v_err = np.empty(3)
    for i in range(3):
        v_err[i] = scale * command[i] - body[7 + i]
        f[i] = command[3 + i] + kv * v_err[i] + memory[10 + i]
    size = _norm3(f[0], f[1], f[2])
    scale = 1.0
    if size > a_max:
        scale = a_max / size
    else:
        for i in range(3):
            memory[10 + i] += dt * ki * v_err[i]
    for i in range(3):
        drag = 0.0
        for j in range(3):
            along = r[0, j] * body[7] + r[1, j] * body[8] + r[2, j] * body[9]
            drag += r[i, j] * c[10 + j] * along
        f[i] = mass * (f[i] * scale + (gravity if i == 2 else 0.0)) + drag
    f[2] = max(f[2], 0.3 * mass * gravity)
    return f


@njit(cache=True)
def _turn_axis(memory: Array, axis: Array, c: Array) -> None:
    """Remember the desired thrust direction and its angular velocity, filtered and bounded."""
    dt, decay, fastest = c[0], c[24], c[25]
    old, rate = memory[13:16], memory[16:19]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turned = (old[j] * axis[k] - old[k] * axis[j]) / dt
        rate[i] = turned + (rate[i] - turned) * decay
    size = _norm3(rate[0], rate[1], rate[2])
    if size > fastest:
        rate *= fastest / size
    old[:] = axis


@njit(cache=True)
def _attitude_torque(r: Array, f: Array, yaw: float, w: Array, memory: Array, c: Array) -> Array:
    """Body torque towards the attitude whose z axis is along f and whose x axis heads to yaw."""
    size = _norm3(f[0], f[1], f[2])
    d = np.empty((3, 3))
    for i in range(3):
        d[i, 2] = f[i] / size
    hx, hy = math.cos(yaw), math.sin(yaw)
    x, y, z = -d[2, 2] * hy, d[2, 2] * hx, d[0, 2] * hy - d[1, 2] * hx  # b3 x heading
    size = _norm3(x, y, z)
    d[0, 1], d[1, 1], d[2, 1] = x / size, y / size, z / size
    d[0, 0] = d[1, 1] * d[2, 2] - d[2, 1] * d[1, 2]
    d[1, 0] = d[2, 1] * d[0, 2] - d[0, 1] * d[2, 2]
    d[2, 0] = d[0, 1] * d[1, 2] - d[1, 1] * d[0, 2]
    e = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            e[i, j] = d[0, i] * r[0, j] + d[1, i] * r[1, j] + d[2, i] * r[2, j]
    _turn_axis(memory, d[:, 2], c)
    k_r, k_w = c[18], c[19]
    e_w = np.empty(3)
    for i in range(3):
        e_w[i] = w[i] - r[0, i] * memory[16] - r[1, i] * memory[17] - r[2, i] * memory[18]
    jx, jy, jz = c[2], c[3], c[4]
    tau = np.empty(3)
    tau[0] = jx * (-k_r * 0.5 * (e[2, 1] - e[1, 2]) - k_w * e_w[0]) + (jz - jy) * w[1] * w[2]
    tau[1] = jy * (-k_r * 0.5 * (e[0, 2] - e[2, 0]) - k_w * e_w[1]) + (jx - jz) * w[2] * w[0]
    tau[2] = jz * (-k_r * 0.5 * (e[1, 0] - e[0, 1]) - k_w * e_w[2]) + (jy - jx) * w[0] * w[1]
    return tau


@njit(cache=True)
def _turn_rotors(memory: Array, thrust: float, tau: Array, c: Array) -> Array:
    """Allocate, saturate and lag the rotor speeds; returns the mean thrust and body torque they make."""
    arm, k, kq, fastest, decay, substeps = c[5], c[6], c[7], c[8], c[9], int(c[26])
    made, level = np.zeros(4), np.empty(4)
    low, high, most = -math.inf, math.inf, fastest * fastest
    for i in range(4):
        sx = 1.0 if i == 0 or i == 3 else -1.0
        sy = 1.0 if i < 2 else -1.0
        level[i] = 0.25 * (thrust / k + sy * tau[0] / (arm * k) - sx * tau[1] / (arm * k))
        level[i] = min(max(level[i], 0.0), most)
        low = max(low, -level[i] if i % 2 == 0 else level[i] - most)
        high = min(high, most - level[i] if i % 2 == 0 else level[i])
    turn = min(max(0.25 * tau[2] / kq, low), high)
    for i in range(4):
        sx = 1.0 if i == 0 or i == 3 else -1.0
        sy = 1.0 if i < 2 else -1.0
        spin = 1.0 if i % 2 == 0 else -1.0
        square = level[i] + spin * turn
        goal = math.sqrt(min(max(square, 0.0), fastest * fastest))
        speed, mean_square = memory[i], 0.0
        for _ in range(substeps):
            command = min(max(speed + c[23] * (goal - speed), 0.0), fastest)
            speed = command + (speed - command) * decay
            mean_square += speed * speed
        memory[i] = speed
        mean_square /= substeps
        lift = k * mean_square
        made[0] += lift
        made[1] += arm * sy * lift
        made[2] -= arm * sx * lift
        made[3] += kq * spin * mean_square
    return made


@njit(cache=True)
def _turn_gimbal(memory: Array, command: Array, w: Array, c: Array) -> None:
    """Move the joints for a substep by the commanded rate less what the body's rotation already does."""
    dt, fastest, decay, pan_max = c[0] / c[26], c[20], c[21], c[22]
    c0, s0 = math.cos(memory[4]), math.sin(memory[4])
    c1, s1 = math.cos(memory[5]), math.sin(memory[5])
    c2, s2 = math.cos(memory[6]), math.sin(memory[6])
    # the body's angular velocity after the yaw joint, in the straight-down frame, after pan, after tilt
    x, y, z = c0 * w[0] + s0 * w[1], s0 * w[0] - c0 * w[1], -w[2]
    x, z = c1 * x - s1 * z, s1 * x + c1 * z
    y, z = c2 * y + s2 * z, c2 * z - s2 * y
    wx, wy, wz = command[6] - x, command[7] - y, command[8] - z
    safe = max(abs(c1), 0.05) * (-1.0 if c1 < 0 else 1.0)
    yaw = -(s2 * wy + c2 * wz) / safe
    rates = (yaw, c2 * wy - s2 * wz, wx - s1 * yaw)
    for i in range(3):
        goal = min(max(rates[i], -fastest), fastest)
        memory[7 + i] = goal + (memory[7 + i] - goal) * decay
        memory[4 + i] += dt * memory[7 + i]
    if abs(memory[5]) > pan_max:
        memory[5] = min(max(memory[5], -pan_max), pan_max)
        memory[8] = 0.0


@njit(cache=True)
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


@njit(cache=True)
def step_packed(bodies: Array, memory: Array, command: Array, constants: Array, wrench: Array) -> None:
    """One period of the inner loop of all agents; see the module's table. The gimbals move with `turn_gimbals`."""
    c = constants
    w = np.empty(3)
    local = np.empty(3)
    for n in range(bodies.shape[0]):
        body, mem, cmd = bodies[n], memory[n], command[n]
        r = _rotation(body)
        for i in range(3):
            w[i] = r[0, i] * body[10] + r[1, i] * body[11] + r[2, i] * body[12]
        f = _commanded_force(body, mem, cmd, r, c)
        thrust = f[0] * r[0, 2] + f[1] * r[1, 2] + f[2] * r[2, 2]
        made = _turn_rotors(mem, thrust, _attitude_torque(r, f, cmd[9], w, mem, c), c)
        for i in range(3):
            air = 0.0
            for j in range(3):
                air += r[j, i] * (body[7 + j] - cmd[10 + j])
            local[i] = -c[10 + i] * air
        local[2] += made[0]
        for i in range(3):
            wrench[n, i] = r[i, 0] * local[0] + r[i, 1] * local[1] + r[i, 2] * local[2]
            wrench[n, 3 + i] = r[i, 0] * made[1] + r[i, 1] * made[2] + r[i, 2] * made[3]


@njit(cache=True)
def turn_gimbals(before: Array, after: Array, memory: Array, command: Array, constants: Array) -> None:
    """Move all gimbals through the period in which the bodies (N,13) went from ``before`` to ``after``."""
    c = constants
    substeps = int(c[26])
    w, w0, w1 = np.empty(3), np.empty(3), np.empty(3)
    for n in range(before.shape[0]):
        r0, r1 = _rotation(before[n]), _rotation(after[n])
        for i in range(3):
            w0[i] = r0[0, i] * before[n, 10] + r0[1, i] * before[n, 11] + r0[2, i] * before[n, 12]
            w1[i] = r1[0, i] * after[n, 10] + r1[1, i] * after[n, 11] + r1[2, i] * after[n, 12]
        for k in range(substeps):
            for i in range(3):
                w[i] = w0[i] + (k + 0.5) / substeps * (w1[i] - w0[i])
            _turn_gimbal(memory[n], command[n], w, c)

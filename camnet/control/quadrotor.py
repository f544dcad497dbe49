"""Quadrotor with a gimballed camera: inner loop, rotors, aerodynamics, gimbal. Readable NumPy version.

One call is one period of the inner loop of every agent: velocity command -> acceleration -> attitude and thrust ->
rotor speeds -> force and torque on the rigid body. Rotors and gimbal are finer: they take ``substeps`` steps in the
period, the rotors towards the speeds that the inner loop holds; force and torque are their means over the period.
The gimbal moves after the body (`turn_gimbal`): its own loop is much faster than a physics step and answers the
body's mean rate in every substep.
Where the rotors cannot make everything, lift, roll and pitch come before yaw. The compiled twin is
`camnet.control.quadrotor_kernel`.
The attitude law is the geometric one of T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a
quadrotor UAV on SE(3)", CDC 2010, eqs. (10)-(16). The desired angular velocity is the filtered derivative of the
desired thrust direction and its own derivative is left out: what the attitude fails to follow is part of the
disturbance d of harris2020 (4-2), which the outer loop measures.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| p, v | position of the centre of mass, velocity, world frame | (N,3) | m, m/s |
| q, w | body to world; angular velocity in the body frame | (N,4), (N,3) | -, rad/s |
| Omega | rotor speeds | (N,4) | rad/s |
| a | commanded acceleration | (N,3) | m/s^2 |
| h, K | period of the inner loop, substeps of rotors and gimbal in it | | s, - |
| f, T | commanded specific force times mass, its part along the rotors | (N,3), (N,) | N |
| tau | torque in the body frame | (N,3) | N m |
| b3_d, w_d | desired thrust direction, its angular velocity, world frame | (N,3) | -, rad/s |
| theta | gimbal joint angles yaw, pan, tilt | (N,3) | rad |
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camnet.control import gimbal
from camnet.geometry.rotations import to_matrix
from camnet.types import Array

__all__ = ["Command", "Memory", "QuadrotorModel", "RigidState", "mixer", "overdrive", "step", "turn_gimbal"]

#: filter and bound of the desired angular velocity
AXIS_RATE_LAG_S = 0.02
AXIS_RATE_MAX_RADPS = 5.0


@dataclass(frozen=True, eq=False, slots=True)
class QuadrotorModel:
    """Constants of one kind of quadrotor and of its inner loop, in SI units (see `camnet.world.settings`).

    ``dt_s`` is the inner loop's period, in which rotors and gimbal take ``substeps`` steps.
    """

    dt_s: float
    mass_kg: float
    inertia_kgm2: Array
    arm_m: float
    thrust_coefficient: float
    torque_coefficient: float
    rotor_max_radps: float
    motor_lag_s: float
    rotor_response_s: float
    drag_n_per_mps: Array
    gravity_mps2: float
    v_max_mps: float
    a_max_mps2: float
    velocity_gain_per_s: float
    velocity_integral_per_s2: float
    attitude_radps: float
    attitude_damping: float
    gimbal_rate_max_radps: float
    gimbal_lag_s: float
    gimbal_pan_max_rad: float
    substeps: int = 1

    @property
    def substep_s(self) -> float:
        """Step of rotors and gimbal, s."""
        return self.dt_s / self.substeps


@dataclass(frozen=True, eq=False, slots=True)
class RigidState:
    """Pose and velocity of N bodies: ``p``, ``v`` and ``w_world`` in the world frame, ``q`` body to world."""

    p: Array
    q: Array
    v: Array
    w_world: Array


@dataclass(frozen=True, eq=False, slots=True)
class Memory:
    """What rotors, gimbal and inner loop remember.

    ``rotor`` (N,4); ``theta``, ``theta_rate`` of the gimbal, velocity ``integral``, last desired ``thrust_axis`` and
    its angular velocity ``axis_rate``, all (N,3).
    """

    rotor: Array
    theta: Array
    theta_rate: Array
    integral: Array
    thrust_axis: Array
    axis_rate: Array


@dataclass(frozen=True, eq=False, slots=True)
class Command:
    """Input of one period, all (N,3) but ``yaw`` (N,): camera velocity, feedforward acceleration, heading, wind."""

    v_world: Array
    a_world: Array
    w_cam: Array
    yaw: Array
    wind: Array


def mixer(model: QuadrotorModel) -> Array:
    """Matrix (4,4) from squared rotor speeds to ``[T, tau_x, tau_y, tau_z]``; X layout, neighbours counter-turn."""
    k, c, d = model.thrust_coefficient, model.torque_coefficient, model.arm_m / np.sqrt(2.0)
    x = d * np.array([1.0, -1.0, -1.0, 1.0])
    y = d * np.array([1.0, 1.0, -1.0, -1.0])
    spin = np.array([1.0, -1.0, 1.0, -1.0])
    return np.stack([np.full(4, k), k * y, -k * x, c * spin])


def _limit(vector: Array, largest: float) -> Array:
    size = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.where(size > largest, vector * (largest / np.maximum(size, 1e-12)), vector)


def _commanded_force(
    model: QuadrotorModel, state: RigidState, memory: Memory, command: Command, r: Array
) -> tuple[Array, Array]:
    """Force f (N,3) that the rotors should make, and the velocity integral after the step."""
    v_err = _limit(command.v_world, model.v_max_mps) - state.v
    wanted = command.a_world + model.velocity_gain_per_s * v_err + memory.integral
    a = _limit(wanted, model.a_max_mps2)
    # the integral waits while the acceleration saturates
    free = (np.linalg.norm(wanted, axis=1, keepdims=True) <= model.a_max_mps2).astype(float)
    integral = memory.integral + model.dt_s * model.velocity_integral_per_s2 * v_err * free
    still_air_drag = np.einsum("nij,j,nkj,nk->ni", r, model.drag_n_per_mps, r, state.v)
    f = model.mass_kg * (a + np.array([0.0, 0.0, model.gravity_mps2])) + still_air_drag
    f[:, 2] = np.maximum(f[:, 2], 0.3 * model.mass_kg * model.gravity_mps2)
    return f, integral


def _axis_rate(model: QuadrotorModel, memory: Memory, axis: Array) -> Array:
    """Angular velocity (N,3) of the desired thrust direction: filtered difference, bounded."""
    turned = np.cross(memory.thrust_axis, axis) / model.dt_s
    rate = _lag(memory.axis_rate, turned, model.dt_s, AXIS_RATE_LAG_S)
    return _limit(rate, AXIS_RATE_MAX_RADPS)


def _attitude_torque(model: QuadrotorModel, r: Array, r_desired: Array, w: Array, w_desired: Array) -> Array:
    """Body torque (N,3) that turns R towards R_d, which turns with ``w_desired`` (world frame)."""
    error = np.einsum("nji,njk->nik", r_desired, r)
    e_r = 0.5 * np.stack(
        [error[:, 2, 1] - error[:, 1, 2], error[:, 0, 2] - error[:, 2, 0], error[:, 1, 0] - error[:, 0, 1]],
        axis=1,
    )
    k_r, k_w = model.attitude_radps**2, 2 * model.attitude_damping * model.attitude_radps
    j = model.inertia_kgm2
    e_w = w - np.einsum("nji,nj->ni", r, w_desired)
    return np.asarray(j * (-k_r * e_r - k_w * e_w) + np.cross(w, j * w))


def _desired_attitude(f: Array, yaw: Array) -> Array:
    """Rotation (N,3,3) whose z axis is along f and whose x axis heads to ``yaw``."""
    b3 = f / np.linalg.norm(f, axis=1, keepdims=True)
    heading = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1)
    b2 = np.cross(b3, heading)
    b2 /= np.linalg.norm(b2, axis=1, keepdims=True)
    return np.stack([np.cross(b2, b3), b2, b3], axis=2)


def _lag(value: Array, goal: Array, dt_s: float, lag_s: float) -> Array:
    """Exact step of ``lag_s * value' = goal - value``."""
    return goal + (value - goal) * (np.exp(-dt_s / lag_s) if lag_s > 0 else 0.0)


def overdrive(model: QuadrotorModel) -> float:
    """Factor by which the inner loop overdrives the rotors, so that they answer in ``rotor_response_s``."""
    response = min(model.rotor_response_s, model.motor_lag_s)
    if response <= 0:
        return 1.0
    return float(np.expm1(-model.substep_s / response) / np.expm1(-model.substep_s / model.motor_lag_s))


def _turn_rotors(model: QuadrotorModel, rotor: Array, wanted: Array) -> tuple[Array, Array]:
    """Rotor speeds after a period and their mean square: the motors' lag, driven beyond the goal within its limits."""
    mean_square = np.zeros_like(rotor)
    for _ in range(model.substeps):
        command = np.clip(rotor + overdrive(model) * (wanted - rotor), 0.0, model.rotor_max_radps)
        rotor = _lag(rotor, command, model.substep_s, model.motor_lag_s)
        mean_square = mean_square + rotor**2 / model.substeps
    return rotor, mean_square


def _allocate(model: QuadrotorModel, allocation: Array, thrust: Array, tau: Array) -> Array:
    """Squared rotor speeds (N,4): lift, roll and pitch first; yaw takes what they leave.

    Rotors make little yaw torque: asked for all of it at once they would all saturate, and the body tumble.
    """
    most, spin = model.rotor_max_radps**2, np.sign(allocation[3])
    asked = np.concatenate([thrust[:, None], tau], axis=1)
    asked[:, 3] = 0.0
    level = np.clip(np.linalg.solve(allocation, asked.T).T, 0.0, most)
    low = np.where(spin > 0, -level, level - most).max(axis=1)
    high = np.where(spin > 0, most - level, level).min(axis=1)
    turn = np.clip(0.25 * tau[:, 2] / model.torque_coefficient, low, high)
    return np.asarray(np.clip(level + spin * turn[:, None], 0.0, most))


def step(
    model: QuadrotorModel, state: RigidState, memory: Memory, command: Command
) -> tuple[Array, Array, Memory]:
    """One period of the inner loop of N agents.

    Returns the force (N,3) without gravity and the torque (N,3), both in the world frame, to be held on the
    bodies during the period, and the memory after it; its gimbal has yet to move with `turn_gimbal`.
    """
    r = to_matrix(state.q)
    w = np.einsum("nji,nj->ni", r, state.w_world)
    f, integral = _commanded_force(model, state, memory, command, r)
    thrust = np.einsum("ni,ni->n", f, r[:, :, 2])
    r_desired = _desired_attitude(f, command.yaw)
    axis_rate = _axis_rate(model, memory, r_desired[:, :, 2])
    tau = _attitude_torque(model, r, r_desired, w, axis_rate)
    allocation = mixer(model)
    rotor_command = np.sqrt(_allocate(model, allocation, thrust, tau))
    rotor, mean_square = _turn_rotors(model, memory.rotor, rotor_command)
    made = mean_square @ allocation.T
    air = np.einsum("nji,nj->ni", r, state.v - command.wind)
    body_force = -model.drag_n_per_mps * air
    body_force[:, 2] += made[:, 0]
    force_world = np.einsum("nij,nj->ni", r, body_force)
    torque_world = np.einsum("nij,nj->ni", r, made[:, 1:])
    after = Memory(rotor, memory.theta, memory.theta_rate, integral, r_desired[:, :, 2], axis_rate)
    return force_world, torque_world, after


def turn_gimbal(
    model: QuadrotorModel, memory: Memory, w_cam: Array, w_before: Array, w_after: Array
) -> Memory:
    """Move the gimbals of N agents through one period in which the body's rate went from one value to the other.

    ``w_cam`` (N,3) is the commanded rate in the camera frame; ``w_before``, ``w_after`` (N,3) are in the body frame.
    Under constant torque the rate changes almost linearly; each substep sees its mean.
    """
    theta, rate = memory.theta, memory.theta_rate
    limits = (model.gimbal_rate_max_radps, model.gimbal_lag_s, model.gimbal_pan_max_rad)
    for k in range(model.substeps):
        w = w_before + (k + 0.5) / model.substeps * (w_after - w_before)
        theta, rate = gimbal.step(theta, rate, w_cam, w, model.substep_s, *limits)
    return replace(memory, theta=theta, theta_rate=rate)

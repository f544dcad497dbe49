"""The compiled inner loop against the readable one; mixer and gimbal against first principles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from camnet.control import gimbal
from camnet.control.quadrotor import Command, Memory, QuadrotorModel, RigidState, mixer, step, turn_gimbal
from camnet.control.quadrotor_kernel import MEMORY, pack_model, step_packed, turn_gimbals
from camnet.geometry.rotations import exp, multiply, normalise, to_matrix


def make_model(**changes) -> QuadrotorModel:
    values = {
        "dt_s": 1 / 240,
        "mass_kg": 1.1,
        "inertia_kgm2": np.array([0.01, 0.012, 0.018]),
        "arm_m": 0.2,
        "thrust_coefficient": 6e-6,
        "torque_coefficient": 1e-7,
        "rotor_max_radps": 900.0,
        "motor_lag_s": 0.03,
        "rotor_response_s": 0.01,
        "drag_n_per_mps": np.array([0.15, 0.1, 0.2]),
        "gravity_mps2": 9.81,
        "v_max_mps": 2.5,
        "a_max_mps2": 5.0,
        "velocity_gain_per_s": 5.0,
        "velocity_integral_per_s2": 3.0,
        "attitude_radps": 18.0,
        "attitude_damping": 0.9,
        "gimbal_rate_max_radps": 3.0,
        "gimbal_lag_s": 0.02,
        "gimbal_pan_max_rad": 1.4,
    }
    return QuadrotorModel(**{**values, **changes})


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
@pytest.mark.parametrize(("lags", "substeps"), [((0.03, 0.02), 1), ((0.0, 0.0), 2), ((0.03, 0.005), 4)])
def test_kernel_equals_numpy(scale, lags, substeps):
    rng = np.random.default_rng(1)
    n = 40
    model = make_model(dt_s=substeps / 240, substeps=substeps, motor_lag_s=lags[0], gimbal_lag_s=lags[1])
    state = RigidState(
        rng.normal(size=(n, 3)),
        normalise(rng.normal(size=(n, 4))),
        scale * rng.normal(size=(n, 3)),
        scale * rng.normal(size=(n, 3)),
    )
    memory = Memory(*(scale * rng.normal(size=(n, k)) for k in (4, 3, 3, 3, 3, 3)))
    command = Command(*(scale * rng.normal(size=s) for s in ((n, 3), (n, 3), (n, 3), n, (n, 3))))
    force, torque, after = step(model, state, memory, command)
    moved = replace(state, q=normalise(rng.normal(size=(n, 4))), w_world=scale * rng.normal(size=(n, 3)))
    rates = [np.einsum("nji,nj->ni", to_matrix(s.q), s.w_world) for s in (state, moved)]
    after = turn_gimbal(model, after, command.w_cam, *rates)

    bodies = np.hstack([state.p, np.roll(state.q, -1, axis=1), state.v, state.w_world])
    packed = np.hstack([getattr(memory, name) for name in MEMORY])
    packed_command = np.hstack(
        [command.v_world, command.a_world, command.w_cam, command.yaw[:, None], command.wind]
    )
    wrench = np.full((n, 6), np.nan)
    step_packed(bodies, packed, packed_command, pack_model(model), wrench)
    bodies_after = np.hstack([moved.p, np.roll(moved.q, -1, axis=1), moved.v, moved.w_world])
    turn_gimbals(bodies, bodies_after, packed, packed_command, pack_model(model))
    np.testing.assert_allclose(wrench, np.hstack([force, torque]), rtol=1e-9, atol=1e-9)
    for name in MEMORY:
        np.testing.assert_allclose(packed[:, MEMORY[name]], getattr(after, name), rtol=1e-9, atol=1e-9)


def test_substeps_are_the_rotors_and_gimbals_own_steps():
    """A period of four substeps turns rotors and gimbal as four periods of one do while the goal stays the same."""
    hover = np.sqrt(1.1 * 9.81 / 4 / 6e-6)
    memory = Memory(np.full((1, 4), 0.9 * hover), *np.zeros((2, 1, 3)), *np.zeros((3, 1, 3)))
    memory = replace(memory, thrust_axis=np.array([[0.0, 0.0, 1.0]]))
    state = RigidState(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3)), np.zeros((1, 3)))
    command = Command(*np.zeros((3, 1, 3)), np.zeros(1), np.zeros((1, 3)))
    coarse = make_model(dt_s=4 / 240, substeps=4, velocity_integral_per_s2=0.0)
    fine = make_model(velocity_integral_per_s2=0.0)
    force, _, once = step(coarse, state, memory, command)
    forces = []
    for _ in range(4):
        f, _, memory = step(fine, state, memory, command)
        forces.append(f)
    np.testing.assert_allclose(force, np.mean(forces, axis=0), rtol=1e-12)
    np.testing.assert_allclose(once.rotor, memory.rotor, rtol=1e-12)
    turn = np.array([[0.3, -0.4, 0.2]])
    once = turn_gimbal(coarse, once, turn, *np.zeros((2, 1, 3)))
    for _ in range(4):
        memory = turn_gimbal(fine, memory, turn, *np.zeros((2, 1, 3)))
    np.testing.assert_allclose(once.theta, memory.theta, rtol=1e-12)


def test_mixer_is_cross_product_of_arms_and_lifts():
    model = make_model()
    rng = np.random.default_rng(2)
    squares = rng.uniform(0, 8e5, size=4)
    angles = np.deg2rad([45.0, 135.0, 225.0, 315.0])
    arms = 0.2 * np.stack([np.cos(angles), np.sin(angles), np.zeros(4)], axis=1)
    lifts = np.stack([np.zeros(4), np.zeros(4), 6e-6 * squares], axis=1)
    torque = np.cross(arms, lifts).sum(axis=0)
    torque[2] = 1e-7 * (squares * [1, -1, 1, -1]).sum()
    np.testing.assert_allclose(mixer(model) @ squares, [lifts[:, 2].sum(), *torque])


def test_camera_rate_by_differentiation():
    rng = np.random.default_rng(3)
    theta, rate, h = rng.uniform(-1.2, 1.2, (20, 3)), rng.normal(size=(20, 3)), 1e-6
    before, after = (gimbal.camera_from_body(theta + s * h * rate) for s in (-1, 1))
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", before, after)).as_rotvec() / (2 * h)
    np.testing.assert_allclose(gimbal.camera_rate(theta, rate), turn, atol=1e-8)
    np.testing.assert_allclose(gimbal.joint_rates(theta, gimbal.camera_rate(theta, rate)), rate, atol=1e-9)


def test_gimbal_holds_the_camera_while_the_body_turns():
    """Without lag the camera's orientation stays still whatever the body does within the rate limits."""
    theta, rate, q = np.array([[0.3, 0.4, -0.5]]), np.zeros((1, 3)), np.array([1.0, 0, 0, 0])
    start = to_matrix(q) @ gimbal.camera_from_body(theta)[0]
    dt = 1 / 2400
    for k in range(2400):
        w = np.array([np.sin(3 * k * dt), np.cos(2 * k * dt), 0.5])
        theta, rate = gimbal.step(theta, rate, np.zeros((1, 3)), w[None], dt, 5.0, 0.0, 1.4)
        q = multiply(q, exp(w * dt))
    turned = start.T @ to_matrix(q) @ gimbal.camera_from_body(theta)[0]
    assert np.linalg.norm(Rotation.from_matrix(turned).as_rotvec()) < 2e-3


def test_gimbal_rates_and_pan_are_limited():
    theta, rate = np.zeros((1, 3)), np.zeros((1, 3))
    fastest = 0.0
    for _ in range(500):
        theta, rate = gimbal.step(
            theta, rate, np.array([[9.0, 9.0, 0.0]]), np.zeros((1, 3)), 1 / 240, 3.0, 0.02, 1.4
        )
        fastest = max(fastest, np.abs(rate).max())
        assert np.abs(rate).max() <= 3.0
        assert abs(theta[0, 1]) <= 1.4
    assert fastest > 2.9

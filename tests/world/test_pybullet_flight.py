"""Rigid-body flight: torque frames against an integrator of our own, hover, steps, wind, camera velocity."""

from __future__ import annotations

import numpy as np
import pybullet as pb
import pytest
from scipy.integrate import solve_ivp
from world_parts import describe

from camnet.control.camera_kernel import may_touch
from camnet.control.gimbal import camera_from_body
from camnet.errors import WorldError
from camnet.geometry.rotations import conjugate, kinematic_matrix, log, multiply, rotate, to_matrix
from camnet.world import CameraCommand
from camnet.world.pybullet.engine import Engine, xyzw
from camnet.world.pybullet.shapes import cylinder
from camnet.world.settings import GimbalSettings, PhysicsSettings, QuadrotorSettings, WindSettings


def test_free_flight_follows_newton_and_euler():
    """World-frame force and torque on a tumbling body of unequal inertia, against RK45 of the equations."""
    mass, inertia = 1.3, np.array([0.01, 0.02, 0.03])
    force = lambda t: np.array([0.5 * np.sin(3 * t), 0.4, 1.3 * 9.81 - 0.5])  # noqa: E731
    torque = lambda t: np.array([0.02 * np.cos(2 * t), -0.01, 0.015 * np.sin(t)])  # noqa: E731
    q0 = np.array([0.8, 0.4, -0.2, 0.4]) / np.linalg.norm([0.8, 0.4, -0.2, 0.4])
    step_hz = 960
    engine = Engine(PhysicsSettings(step_hz=step_hz))
    body = engine.add("b", cylinder(0.2, 0.1, np.zeros(3)), (0, 0, 10), q0, (1, 1, 1, 1), mass)
    engine.make_free(body, mass, inertia.tolist())
    engine.place(body, (0, 0, 10), xyzw(q0))
    w0 = rotate(q0, np.array([0.5, -0.8, 1.0]))
    pb.resetBaseVelocity(body, (0.3, 0, 0), w0.tolist(), engine.client)
    for k in range(step_hz):
        p, _ = pb.getBasePositionAndOrientation(body, engine.client)
        pb.applyExternalForce(body, -1, force(k / step_hz), p, pb.WORLD_FRAME, engine.client)
        pb.applyExternalTorque(body, -1, torque(k / step_hz), pb.WORLD_FRAME, engine.client)
        pb.stepSimulation(engine.client)

    def rates(t, x):
        q, w = x[6:10] / np.linalg.norm(x[6:10]), x[10:]
        body_torque = to_matrix(q).T @ torque(t)
        spin = (body_torque - np.cross(w, inertia * w)) / inertia
        return np.concatenate([x[3:6], force(t) / mass - [0, 0, 9.81], 0.5 * kinematic_matrix(q) @ w, spin])

    start = np.concatenate([[0, 0, 10], [0.3, 0, 0], q0, [0.5, -0.8, 1.0]])
    end = solve_ivp(rates, (0, 1), start, rtol=1e-9, atol=1e-9).y[:, -1]
    p, q = pb.getBasePositionAndOrientation(body, engine.client)
    v, w = pb.getBaseVelocity(body, engine.client)
    engine.close()
    q_engine = np.roll(q, 1)
    np.testing.assert_allclose(p, end[:3], atol=2e-3)
    np.testing.assert_allclose(v, end[3:6], atol=2e-3)
    assert np.linalg.norm(log(multiply(conjugate(end[6:10]), q_engine))) < 0.02
    np.testing.assert_allclose(w, rotate(end[6:10], end[10:]), atol=0.03)


@pytest.mark.parametrize("substeps", [1, 2, 4])
def test_wrench_and_gravity_act_in_every_substep(substeps):
    """One call of the engine with substeps moves a body exactly as the same wrench held over as many single steps.

    The oracle integrates as the engine says it does, velocity first, position with the new velocity.
    """
    physics, inertia, dt = PhysicsSettings(), np.array([0.01, 0.012, 0.018]), 1 / 240
    engine = Engine(physics, substeps)
    body = engine.add(
        "b", cylinder(0.2, 0.1, np.zeros(3)), (0, 0, 10), np.array([1.0, 0, 0, 0]), (1,) * 4, 1.1
    )
    engine.make_free(body, 1.1, inertia.tolist())
    v, p, force, spin, turn = np.zeros(3), np.array([0, 0, 10.0]), np.array([0.4, -0.3, 12.0]), 0.0, 0.0
    for _ in range(24 // substeps):
        where, _ = pb.getBasePositionAndOrientation(body, engine.client)
        pb.applyExternalForce(body, -1, force, where, pb.WORLD_FRAME, engine.client)
        pb.applyExternalTorque(body, -1, (0, 0, 0.02), pb.WORLD_FRAME, engine.client)
        pb.stepSimulation(engine.client)
    for _ in range(24):
        v = v + dt * (force / 1.1 - [0, 0, 9.81])
        p = p + dt * v
        spin += dt * 0.02 / inertia[2]
        turn += dt * spin
    where, q = pb.getBasePositionAndOrientation(body, engine.client)
    speed, rate = pb.getBaseVelocity(body, engine.client)
    engine.close()
    np.testing.assert_allclose(where, p, atol=1e-9)
    np.testing.assert_allclose(speed, v, atol=1e-9)
    np.testing.assert_allclose(rate, [0, 0, spin], atol=1e-9)
    assert 2 * np.arctan2(q[2], q[3]) == pytest.approx(turn, abs=1e-6)


@pytest.mark.parametrize(("flight_hz", "substeps"), [(None, 4), (60, 4), (120, 2), (240, 1)])
def test_inner_loop_rate(flight_hz, substeps):
    assert describe(flight_hz=flight_hz).flight_substeps == substeps


def test_inner_loop_rate_fits_a_slow_controller():
    assert describe(control_hz=30).flight_substeps == 4
    assert describe(control_hz=24).flight_substeps == 2  # 120 Hz: 72 Hz does not divide 240 Hz


@pytest.mark.parametrize("flight_hz", [30, 80, 480])
def test_inner_loop_rate_that_does_not_fit(flight_hz):
    with pytest.raises(WorldError, match=f"flight_hz = {flight_hz}.*60, 120, 240"):
        describe(flight_hz=flight_hz)


@pytest.mark.parametrize("flight_hz", [60, 240])
def test_slow_inner_loop_flies_like_the_fast_one(open_world, flight_hz):
    """A camera follows a changing velocity within a few mm/s whatever the inner loop's rate, and turns as told."""
    world, before = open_world(flight_hz=flight_hz)
    turn, slips = np.array([[0.3, -0.2, 0.1]] * 2), []
    for k in range(120):
        v = np.array([[0.5 * np.sin(k / 20), 0.3 * np.cos(k / 30), 0.0]] * 2)
        a = np.array([[1.5 * np.cos(k / 20), -0.6 * np.sin(k / 30), 0.0]] * 2)
        before, now = world._snapshot, world.step(CameraCommand(v, turn, a))
        slips.append(np.linalg.norm(now.camera_v_world - v, axis=1).max())
        rate = 60 * log(multiply(conjugate(before.camera_q_world), now.camera_q_world))
        assert k < 30 or np.abs(rate - turn).max() < 0.08
    assert max(slips[60:]) < 0.05


def test_watching_for_contacts_changes_nothing_where_there_are_none(open_world, monkeypatch):
    """Physics step by step with contacts looked up, or all substeps in one call: the same flight."""
    ends = []
    for forced in (False, True):
        world, _ = open_world(wind=WindSettings(mean_mps=(1.0, 0, 0)))
        if forced:
            monkeypatch.setattr(world, "_can_always_touch", True)
        watched: list[int] = []
        monkeypatch.setattr(world._engine, "contacts", lambda seen=watched: seen.append(1) or set())
        for k in range(60):
            v = np.array([[0.6 * np.sin(k / 9), 0.4, 0.2 * np.cos(k / 7)]] * 2)
            now = world.step(CameraCommand(v, np.array([[0.2, -0.1, 0.3]] * 2)))
        assert len(watched) == (240 if forced else 0)
        ends.append(np.hstack([now.camera_p_world, now.camera_q_world, now.camera_v_world, now.camera_w_cam]))
    np.testing.assert_allclose(*ends, rtol=1e-9, atol=1e-12)


def test_what_may_touch_is_never_overlooked():
    """Straight flight at the present velocities, sampled finely: a contact of balls on the way must be announced."""
    rng, told, touched = np.random.default_rng(4), 0, 0
    for _ in range(400):
        bodies, balls = np.zeros((3, 13)), np.zeros((2, 5))
        bodies[:, :3] = rng.uniform([-2, -2, 0.3], [2, 2, 4], (3, 3))
        bodies[:, 7:10] = rng.normal(scale=8.0, size=(3, 3))
        balls[:, :3], balls[:, 3] = rng.uniform([-2, -2, 0], [2, 2, 0.1], (2, 3)), 0.4
        drift = rng.normal(size=(2, 3)) * [1, 1, 0]
        balls[:, 4] = np.linalg.norm(drift, axis=1)
        hit = False
        for t in np.linspace(0, 1 / 60, 20):
            p, q = bodies[:, :3] + t * bodies[:, 7:10], balls[:, :3] + t * drift
            apart = np.linalg.norm(p[:, None] - p, axis=2)[np.triu_indices(3, 1)]
            hit |= bool((apart <= 0.4).any() or (p[:, 2] <= 0.2).any())
            hit |= bool((np.linalg.norm(p[:, None] - q, axis=2) <= 0.6).any())
        said = may_touch(bodies, 0.2, balls, 0.0, 1 / 60)
        assert said or not hit
        told, touched = told + said, touched + hit
    assert 10 < touched <= told < 380
    bodies[1, 0] = np.nan
    assert may_touch(bodies, 0.2, balls, 0.0, 1 / 60)


@pytest.mark.parametrize(("v", "a", "tilt_deg"), [(5.0, 4.0, 60.0), (6.0, 6.0, 70.0)])
def test_hard_references_in_all_directions_do_not_tumble(open_world, v, a, tilt_deg):
    """Fast climbs, dives and turns: yaw may not take from the rotors what roll and pitch need."""
    world, _ = open_world(
        n=1, height=100.0, targets=(), quadrotor=QuadrotorSettings(v_max_mps=8.0, a_max_mps2=8.0)
    )
    rng, now, goal, least = np.random.default_rng(1), np.zeros(3), np.zeros(3), 1.0
    for k in range(600):
        if k % 60 == 0:
            goal = rng.normal(size=3)
            goal *= v / np.linalg.norm(goal)
        missing = goal - now
        rate = missing * min(a / max(np.linalg.norm(missing), 1e-9), 60.0)
        now = now + rate / 60
        seen = world.step(CameraCommand(now[None], np.zeros((1, 3)), rate[None]))
        least = min(least, to_matrix(seen.agent_q_world)[0, 2, 2])
        assert np.linalg.norm(seen.camera_v_world[0] - now) < 2.5
    assert np.degrees(np.arccos(least)) < tilt_deg


def test_hovers_without_moving(open_world):
    world, start = open_world()
    for _ in range(120):
        now = world.step(CameraCommand.zeros(2))
    np.testing.assert_allclose(now.camera_p_world, start.camera_p_world, atol=1e-6)
    assert now.t_s == pytest.approx(2.0)
    assert now.step == 480


def test_velocity_step_response(open_world):
    world, _ = open_world()
    wanted = np.array([[0.8, -0.3, 0.2], [0.0, 0.0, 0.5]])
    speeds = []
    for _ in range(480):
        speeds.append(world.step(CameraCommand(wanted, np.zeros((2, 3)))).camera_v_world)
    np.testing.assert_allclose(speeds[-1], wanted, atol=0.01)
    assert np.linalg.norm(speeds[40] - wanted, axis=1).max() < 0.3
    assert np.abs(speeds).max() < 1.25 * 0.8  # overshoot


def test_camera_turns_while_the_body_flies(open_world):
    world, before = open_world()
    turn = np.array([[0.3, -0.2, 0.1]] * 2)
    for k in range(90):
        v = np.array([[0.5 * np.sin(k / 10), 0.3, 0.0]] * 2)
        before, now = world._snapshot, world.step(CameraCommand(v, turn))
    for i in range(2):
        turned = log(multiply(conjugate(before.camera_q_world[i]), now.camera_q_world[i])) * 60
        np.testing.assert_allclose(turned, turn[i], atol=0.1)
        np.testing.assert_allclose(now.camera_w_cam[i], turn[i], atol=0.1)


def test_camera_pose_and_velocity_of_an_offset_camera(open_world):
    offset = (0.05, -0.02, -0.1)
    world, now = open_world(gimbal=GimbalSettings(offset_m=offset))
    for k in range(40):
        v = np.array([[np.sin(k / 3), 0.5, 0.1]] * 2)
        before, now = now, world.step(CameraCommand(v, np.array([[0.5, 0.4, -0.3]] * 2)))
    r = to_matrix(now.agent_q_world)
    np.testing.assert_allclose(now.camera_p_world, now.agent_p_world + r @ np.array(offset), atol=1e-12)
    w_world = np.einsum("nij,nj->ni", r, now.agent_w_body)
    np.testing.assert_allclose(
        now.camera_v_world, now.agent_v_world + np.cross(w_world, r @ np.array(offset)), atol=1e-12
    )
    theta = world._flight.memory[:, 4:7]
    np.testing.assert_allclose(
        to_matrix(now.camera_q_world), np.einsum("nij,njk->nik", r, camera_from_body(theta)), atol=1e-12
    )
    # positions really move as the velocities say
    moved = (now.camera_p_world - before.camera_p_world) * 60
    np.testing.assert_allclose(moved, 0.5 * (now.camera_v_world + before.camera_v_world), atol=0.05)


def test_gimbal_rate_limit_in_the_world(open_world):
    world, _ = open_world(gimbal=GimbalSettings(rate_max_radps=1.0))
    for _ in range(60):
        now = world.step(CameraCommand(np.zeros((2, 3)), np.array([[2.5, 0.0, 0.0]] * 2)))
        assert np.abs(now.camera_w_cam).max() <= 1.0 + 1e-6
    assert np.abs(now.camera_w_cam[:, 0]).min() > 0.99


def test_agents_lean_into_the_wind_and_gusts_push_them_apart(open_world):
    world, now = open_world(wind=WindSettings(mean_mps=(2.0, 0, 0), gust_std_mps=0.5))
    drag = world.description.physics.quadrotor.drag_n_per_mps[0]
    lean = np.arctan2(2.0 * drag, world.description.physics.quadrotor.mass_kg * 9.81)
    up = to_matrix(now.agent_q_world)[:, :, 2]
    np.testing.assert_allclose(np.arcsin(-up[:, 0]), lean, rtol=0.01)
    for _ in range(60):
        now = world.step(CameraCommand.zeros(2))
    drift = now.camera_p_world - world._camera_p
    assert np.abs(drift[0] - drift[1]).max() > 1e-4


@pytest.mark.parametrize("std", [0.7])
def test_gusts_have_the_variance_and_time_asked(open_world, std):
    world, _ = open_world(n=40, wind=WindSettings(gust_std_mps=std, gust_time_s=0.5))
    flight = world._flight
    gusts = np.array([flight._wind(world.description.physics.wind, 1 / 60) for _ in range(3000)])
    assert gusts.std() == pytest.approx(std, rel=0.05)
    lagged = (gusts[:-30] * gusts[30:]).mean() / gusts.var()
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.06)

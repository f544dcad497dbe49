"""Agents that begin in a wind stand still in it, on both back ends and however their drag differs by axis."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.batch.network import Shown, pack_network
from camnet.batch.state import allocate, restart
from camnet.config.load import load_scenario
from camnet.control.quadrotor_kernel import pack_model
from camnet.control.trim import trimmed
from camnet.geometry.rotations import STRAIGHT_DOWN, angle_between, from_yaw, multiply
from camnet.simulation.network import build_network
from camnet.simulation.run import run_network
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet import PyBulletWorld
from camnet.world.pybullet.flight import model_from_settings
from camnet.world.settings import PhysicsSettings, QuadrotorSettings

_WIND = "physics.wind.mean_mps=[5.0, -3.0, 0.5]"
_DRAG = "physics.quadrotor.drag_n_per_mps=[0.5, 0.35, 0.2]"
_SHOWN = Shown(0.5, 0, 1.0, (0.0,) * 6, terminate_on_collision=False, lost_limit_s=np.inf, in_world=True)


@pytest.fixture(scope="module")
def network():
    return build_network(load_scenario("mobile_certified", [_WIND, _DRAG, "physics.wind.gust_std_mps=0"]))


def test_agents_that_are_asked_to_stand_still_do(network):
    world = PyBulletWorld(network.description)
    try:
        first = now = world.reset(np.random.default_rng(0))
        yaw = [a.start_yaw_rad for a in network.description.agents]
        down = multiply(from_yaw(yaw).reshape(-1, 4), STRAIGHT_DOWN)
        np.testing.assert_allclose(angle_between(now.camera_q_world, down), 0.0, atol=1e-6)
        starts = [a.start_p_world for a in network.description.agents]
        np.testing.assert_allclose(now.camera_p_world, starts, atol=1e-9)
        for _ in range(120):
            now = world.step(CameraCommand.zeros(network.n_agents))
    finally:
        world.close()
    np.testing.assert_allclose(now.camera_p_world, first.camera_p_world, atol=1e-3)
    np.testing.assert_allclose(angle_between(now.camera_q_world, down), 0.0, atol=1e-3)


def test_the_batch_back_end_begins_the_same(network):
    world = PyBulletWorld(network.description)
    try:
        now = world.reset(np.random.default_rng(0))
    finally:
        world.close()
    model = pack_network(network, _SHOWN)
    state = allocate(model, 1)
    restart(model, [t.motion for t in network.description.targets], state, 0, 0)
    np.testing.assert_allclose(state.bodies[0, :, :3], now.agent_p_world, atol=1e-12)
    np.testing.assert_allclose(np.roll(state.bodies[0, :, 3:7], 1, axis=1), now.agent_q_world, atol=1e-12)


def test_a_trimmed_body_has_no_force_on_it():
    physics = PhysicsSettings(quadrotor=QuadrotorSettings(drag_n_per_mps=(0.5, 0.3, 0.1)))
    constants = pack_model(model_from_settings(physics))
    wind = np.array([4.0, 2.0, -1.0])
    heading = np.array([[1.0, 0.0], [0.6, 0.8]])
    q, memory = trimmed(constants, heading, wind)
    w, x, y, z = q.T
    up = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    lift = 4.0 * physics.quadrotor.thrust_n_per_rad2ps2 * memory[:, :1] ** 2
    for n in range(2):
        # conjugation by quaternion algebra, apart from the matrices of the module
        back = multiply(multiply([w[n], -x[n], -y[n], -z[n]], [0.0, *wind]), q[n])
        drag = np.array([0.0, *(constants[10:13] * back[1:])])
        push = multiply(multiply(q[n], drag), [w[n], -x[n], -y[n], -z[n]])[1:]
        weight = np.array([0.0, 0.0, -constants[1] * constants[13]])
        np.testing.assert_allclose(lift[n] * up[n] + push + weight, 0.0, atol=1e-9)


def test_the_bound_of_the_disturbance_holds_from_the_first_period_on():
    scenario = load_scenario("mobile_certified", ["run.duration_s=4"], seed=3)
    controller = run_network(scenario, 3).summary["controller"]
    assert controller["disturbance_exceeded"] == 0

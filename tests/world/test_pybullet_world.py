"""The world as its protocol promises: determinism, errors, collisions, kinematic mode, closed loop."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from world_parts import Straight, describe

from camnet.control.monitor import DisturbanceMonitor
from camnet.control.references import ReferenceGenerator
from camnet.control.settings import ControllerSettings
from camnet.control.sliding_mode import SlidingModeController
from camnet.errors import SimulationError, WorldError
from camnet.geometry.regions import build_region
from camnet.geometry.rotations import exp, multiply
from camnet.geometry.settings import Box
from camnet.world import CameraCommand
from camnet.world.settings import WindSettings

WINDY = WindSettings(mean_mps=(1.0, 0.5, 0), gust_std_mps=0.5)


def fingerprint(world, snapshot, steps=60):
    digest = hashlib.sha256()
    for k in range(steps):
        v = np.array([[0.5, 0.1, 0.1 * np.sin(k)], [-0.3, 0.2, 0.0]])
        snapshot = world.step(CameraCommand(v, np.array([[0.1, 0.2, 0.0]] * 2)))
        for name in snapshot.__slots__[2:-1]:
            digest.update(np.ascontiguousarray(getattr(snapshot, name)).tobytes())
    return digest.hexdigest()


@pytest.mark.parametrize("actuation", ["quadrotor", "kinematic"])
def test_same_seed_same_bits(open_world, actuation):
    options = {"actuation": actuation, "wind": WINDY}
    first = fingerprint(*open_world(7, **options))
    world, start = open_world(7, **options)
    assert fingerprint(world, start) == first
    assert fingerprint(world, world.reset(np.random.default_rng(7))) == first
    assert fingerprint(world, world.reset(np.random.default_rng(8))) != first


def test_reset_after_a_collision_gives_the_same_bits(open_world):
    world, start = open_world(7)
    first = fingerprint(world, start)
    world.reset(np.random.default_rng(7))
    for _ in range(200):
        world.step(CameraCommand(np.array([[2.0, 0, 0], [-2.0, 0, 0]]), np.zeros((2, 3))))
    assert fingerprint(world, world.reset(np.random.default_rng(7))) == first


def test_same_bits_in_another_process(open_world):
    here = fingerprint(*open_world(7, wind=WINDY))
    code = (
        "import sys, numpy as np; sys.path.insert(0, sys.argv[1])\n"
        "from test_pybullet_world import WINDY, fingerprint\n"
        "from world_parts import describe\n"
        "from camnet.world.pybullet import PyBulletWorld\n"
        "world = PyBulletWorld(describe(wind=WINDY))\n"
        "print(fingerprint(world, world.reset(np.random.default_rng(7))))"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == here


def test_nan_command_names_the_agent_and_the_step(open_world):
    world, _ = open_world()
    world.step(CameraCommand.zeros(2))
    bad = CameraCommand(np.array([[0, 0, 0], [np.nan, 0, 0]]), np.zeros((2, 3)))
    with pytest.raises(SimulationError, match=r"step 4.*'a1'"):
        world.step(bad)


@pytest.mark.parametrize("actuation", ["quadrotor", "kinematic"])
def test_divergence_names_the_agent_and_the_step(open_world, actuation):
    world, _ = open_world(actuation=actuation, range_limit_m=0.5)

    def fly_away():
        for _ in range(200):
            world.step(CameraCommand(np.array([[0, 0, 0], [1.0, 0, 0]]), np.zeros((2, 3))))

    with pytest.raises(SimulationError, match=r"step \d+: agent 'a1' diverged: position"):
        fly_away()


def test_nan_in_the_engine_names_the_agent(open_world):
    world, _ = open_world()
    world._flight.memory[1, 0] = np.nan
    with pytest.raises(SimulationError, match="agent 'a1' diverged"):
        world.step(CameraCommand.zeros(2))


def test_nan_target_is_named(open_world):
    class Broken(Straight):
        def step(self, state, t_s, dt_s, rng):
            state.p_world = np.full(3, np.nan)
            return state

    world, _ = open_world(targets=(Broken(),))
    with pytest.raises(SimulationError, match="target 't0' is not finite"):
        world.step(CameraCommand.zeros(2))


@pytest.mark.parametrize("actuation", ["quadrotor", "kinematic"])
def test_collisions_are_reported_by_name(open_world, actuation):
    world, _ = open_world(
        n=2, spacing=1.5, actuation=actuation, occluders=[("wall", Box(min_m=(-2, -1, 0), max_m=(-1, 1, 6)))]
    )
    seen = set()
    for _ in range(90):
        now = world.step(CameraCommand(np.array([[1.0, 0, 0], [0.0, 0, 0]]), np.zeros((2, 3))))
        seen |= set(now.collisions)
    assert seen == {("a0", "a1")}
    world.reset(np.random.default_rng(0))
    seen = set()
    for _ in range(120):
        now = world.step(CameraCommand(np.array([[-1.0, 0, 0], [0.0, 0, 0]]), np.zeros((2, 3))))
        seen |= set(now.collisions)
    assert seen == {("a0", "wall")}


def test_landing_on_a_target_and_on_the_ground(open_world):
    world, _ = open_world(spacing=1.0, height=0.8, targets=(Straight(start=(1.0, 0, 0), speed=0.0),))
    seen = set()
    for _ in range(150):
        seen |= set(world.step(CameraCommand(np.array([[0, 0, -0.8]] * 2), np.zeros((2, 3)))).collisions)
    assert {("a1", "t0"), ("a0", "ground")} <= seen
    assert ("ground", "t0") not in seen


def test_kinematic_mode_is_the_integral_of_the_command(open_world):
    """Without disturbance: p' = u, q' = 1/2 B(q) w for a constant command, in closed form."""
    world, start = open_world(actuation="kinematic", disturbance=0.0)
    v, w = np.array([[0.3, 0.1, -0.2]] * 2), np.array([[0.5, -0.4, 0.3]] * 2)
    for _ in range(90):
        now = world.step(CameraCommand(v, w))
    np.testing.assert_allclose(now.camera_p_world, start.camera_p_world + 1.5 * v, atol=1e-9)
    turned = multiply(start.camera_q_world, exp(1.5 * w))
    np.testing.assert_allclose(np.abs(np.sum(turned * now.camera_q_world, axis=1)), 1.0, atol=1e-12)


def test_kinematic_disturbance_is_bounded_and_present(open_world):
    world, _ = open_world(actuation="kinematic", disturbance=0.1)
    linear, angular = [], []
    for _ in range(300):
        now = world.step(CameraCommand.zeros(2))
        linear.append(np.linalg.norm(now.camera_v_world, axis=1))
        angular.append(np.linalg.norm(now.camera_w_cam, axis=1))
    for norms in (np.array(linear), np.array(angular)):
        assert norms.max() <= 0.1 + 1e-12
        assert norms.max() > 0.05


def closed_loop(world, start, settings, seconds, error=0.0, seed=0):
    n = len(world.agent_names)
    regions = [
        build_region(f"r{i}", Box(min_m=(*(p[:2] - 1.9), 1.0), max_m=(*(p[:2] + 1.9), 5.0)))
        for i, p in enumerate(start.camera_p_world[:n])
    ]
    generator = ReferenceGenerator(settings, regions, world._yaw, world.control_dt_s)
    state, now = generator.start(start.camera_p_world[:n] + error), start
    controller, monitor = SlidingModeController(settings), DisturbanceMonitor(settings, n)
    rng, setpoint, gaze = np.random.default_rng(seed), start.camera_p_world[:n].copy(), np.zeros((n, 2))
    depth = np.inf
    for k in range(round(seconds * 60)):
        if k % 45 == 0:
            setpoint = start.camera_p_world[:n] + rng.uniform(-3, 3, (n, 3))
            gaze = rng.uniform(-0.8, 0.8, (n, 2))
        control = controller.control(
            now.camera_p_world[:n], now.camera_q_world[:n], generator.reference(state)
        )
        before, now = now, world.step(CameraCommand(control.v_world, control.w_cam, control.a_world))
        monitor.update(before, now, control)
        state = generator.step(state, setpoint, gaze)
        depth = min(depth, *(-r.signed_distance(p) for r, p in zip(regions, now.agent_p_world, strict=True)))
    return monitor.summary(), depth


@pytest.mark.parametrize("switching", ["sign", "sat", "tanh"])
def test_kinematic_loop_stays_in_its_envelope(open_world, switching):
    settings = ControllerSettings(switching=switching)
    world, start = open_world(actuation="kinematic", disturbance=0.25)
    figures, _ = closed_loop(world, start, settings, 10.0, error=0.4)
    assert figures["disturbance_exceeded"] == 0
    assert figures["bound_exceeded"] == 0
    assert figures["disturbance_max"] > 0.2


def test_envelope_is_left_when_the_model_is_wrong(open_world):
    """The monitor can fail: it is told a gain that the controller does not have."""
    world, start = open_world(actuation="kinematic", disturbance=0.0)
    n, slow = 2, ControllerSettings(k1_per_s=0.5, d_bar_mps=0.0, d_bar_radps=0.0)
    generator = ReferenceGenerator(slow, [None] * n, np.zeros(n), 1 / 60)
    state = generator.start(start.camera_p_world[:n] + 0.4)
    monitor = DisturbanceMonitor(slow.model_copy(update={"k1_per_s": 2.0}), n)
    controller, now = SlidingModeController(slow), start
    for _ in range(60):
        control = controller.control(
            now.camera_p_world[:n], now.camera_q_world[:n], generator.reference(state)
        )
        before, now = now, world.step(CameraCommand(control.v_world, control.w_cam))
        monitor.update(before, now, control)
    assert monitor.summary()["bound_exceeded"] > 30


@pytest.mark.parametrize("wind", [WindSettings(), WindSettings(mean_mps=(2.0, 0, 0), gust_std_mps=0.5)])
def test_quadrotors_track_inside_their_regions(open_world, wind):
    world, start = open_world(wind=wind)
    figures, depth = closed_loop(world, start, ControllerSettings(), 15.0)
    assert figures["max_error"] < 0.1
    assert figures["max_error_rad"] < 0.1
    assert figures["bound_exceeded"] == 0
    assert figures["disturbance_exceeded"] == 0
    assert depth > 0.1


def test_wrong_shapes_and_closed_worlds_are_refused(open_world):
    world, _ = open_world()
    with pytest.raises(WorldError, match=r"command.v_world has shape \(3, 3\), should be \(2, 3\)"):
        world.step(CameraCommand.zeros(3))
    world.close()
    with pytest.raises(WorldError, match="closed"):
        world.reset(np.random.default_rng(0))


def test_description_refuses_double_names_and_broken_rates():
    with pytest.raises(WorldError, match=r"twice: \['a0'\]"):
        describe(occluders=[("a0", Box(min_m=(0, 0, 0), max_m=(1, 1, 1)))])
    with pytest.raises(WorldError, match=r"step_hz = 250 .*multiple of controller.rate_hz = 60"):
        describe(step_hz=250)

"""Estimators by name in the loop: shared models, the oracle, and names that are none."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import assert_rounded_alike

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env import handoff_v0
from camnet.errors import ConfigError
from camnet.experiments.kinematic_world import KinematicWorld
from camnet.simulation.filters import TargetTruth, build_filter
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.simulation.network import build_network
from camnet.types import Twist
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet import PyBulletWorld

NOBODY = Setpoints(np.zeros((0, 3)), np.zeros((0, 2)))


def fixed_cameras(*overrides: str) -> tuple[Scenario, NetworkSimulation]:
    scenario = load_scenario("stationary_loop", overrides)
    assert isinstance(scenario, Scenario)
    network = build_network(scenario)
    world = KinematicWorld(network.description)
    return scenario, NetworkSimulation(network, world, ("learned", "learned_shared", "oracle", "ukf"), seed=4)


def test_with_one_target_shared_equals_private_and_the_oracle_is_right() -> None:
    _, simulation = fixed_cameras()
    futures, unseen, compared = [], 0, 0
    for k in range(250):
        simulation.advance(NOBODY)
        learned, shared = (simulation.filters[n][0].estimate for n in ("learned", "learned_shared"))
        assert_rounded_alike(learned.p_world, shared.p_world, scale=10.0, steps=k + 1)
        assert_rounded_alike(learned.q_world, shared.q_world, scale=1.0, steps=k + 1)
        oracle = simulation.filters["oracle"][0]
        if learned.region < 0:
            assert np.isnan(oracle.rollout(2.0, 0.2).p_world).all()
            continue
        assert oracle.estimate.seen == learned.seen
        truth = simulation.snapshot.target_p_world[0]
        np.testing.assert_array_equal(oracle.estimate.p_world, truth)
        unseen += not learned.seen
        if k == 150:
            rollout = oracle.rollout(9.0, 0.1)
            futures = list(zip(rollout.t_s, rollout.p_world, rollout.q_world, strict=True))
        for t_s, p, q in futures:
            if abs(t_s - simulation.snapshot.t_s) < 1e-6:
                compared += 1
                assert_rounded_alike(p, truth, scale=10.0, steps=k)
                assert_rounded_alike(q, simulation.snapshot.target_q_world[0], scale=1.0, steps=k)
    assert compared > 80
    assert unseen > 20


def test_the_future_of_random_turns_is_foreseen_in_the_engine() -> None:
    """Two vehicles that draw speeds and turns: what the engine shows later is what was foreseen."""
    scenario = load_scenario("patrol", ["targets.vehicle.motion.speed_mps=[0.8,1.2]"])
    assert isinstance(scenario, Scenario)
    extra = scenario.targets[0].model_copy(update={"name": "other"})
    scenario = scenario.model_copy(update={"targets": (*scenario.targets, extra)})
    world = PyBulletWorld(build_network(scenario).description)
    world.reset(np.random.default_rng(3))
    times = np.arange(0.0, 13.0, 3.0)
    foreseen = [world.foresee(m, times) for m in range(2)]
    assert np.linalg.norm(foreseen[0][0][-1] - foreseen[1][0][-1]) > 0.5  # at different speeds at least
    for k in range(1, 721):
        now = world.step(CameraCommand.zeros(0))
        if k % 180 == 0:
            for m in range(2):
                assert_rounded_alike(foreseen[m][0][k // 180], now.target_p_world[m], scale=10.0, steps=k)
    world.close()


def test_shared_models_drive_the_environment() -> None:
    env = handoff_v0.parallel_env(filter_name="learned_shared", max_cycles=3)
    observations, _ = env.reset(seed=0)
    assert all(np.isfinite(o).all() for o in observations.values())
    env.close()


def test_unknown_names_and_worlds_without_a_future_are_refused() -> None:
    scenario, simulation = fixed_cameras()
    network = simulation.network
    rest = (scenario.estimator, network.basis, 6, 30.0, network.bounds)
    blind = TargetTruth(lambda t: Twist(np.zeros(3), np.zeros(3)))
    with pytest.raises(ConfigError, match="'learnt': expected one of learned"):
        build_filter("learnt", *rest, blind)
    with pytest.raises(ConfigError, match="cannot tell"):
        build_filter("oracle", *rest, blind)

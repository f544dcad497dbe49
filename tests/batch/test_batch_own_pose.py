"""Agents that dead-reckon: the batch back end flies, looks and measures as the rigid-body engine's loop does."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.batch.network import Shown
from camnet.batch.simulation import BatchSimulation
from camnet.batch.state import ESTIMATE
from camnet.config.load import load_scenario
from camnet.errors import ConfigError
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.simulation.network import build_network
from camnet.world.pybullet import PyBulletWorld

_BOUNDS = "bounds: {scale: 0.01, gyro_bias_radps: 0.001}"
#: fixes for a while, an outage, fixes again; the first calibrates, the next takes images too, the last does neither
DENIED = (
    "agents.camera_0.pose={source: dead_reckoning, outages_s: [[2.5, 6.5]], velocity: {gyro_bias_radps: 0.01}, "
    f"{_BOUNDS}}}",
    f"agents.camera_1.pose={{source: key_frames, outages_s: [[1, 3], [5, 9]], {_BOUNDS}}}",
    f"agents.camera_3.pose={{source: dead_reckoning, outages_s: [[3, 7]], calibrate: false, {_BOUNDS}}}",
    "physics.wind.gust_std_mps=0.3",
)
SHOWN = Shown(
    0.5,
    0,
    1.0,
    (0.0,) * 6,
    terminate_on_collision=False,
    lost_limit_s=np.inf,
    in_world=True,
    by_believed=True,
)
SEED = 5


def test_both_back_ends_fly_by_the_same_estimates() -> None:
    network = build_network(load_scenario("quickstart", DENIED))
    one = NetworkSimulation(network, PyBulletWorld(network.description), ("ekf",), SEED)
    many = BatchSimulation(network, SHOWN, 3, "ekf", threads=1)
    many.reset(np.arange(3), [SEED + 7, SEED, SEED + 9])
    rng = np.random.default_rng(0)
    own = one.own
    assert own is not None
    largest = 0.0
    for k in range(80):
        if k % 15 == 0:
            p = np.array(
                [r.project(r.center + rng.uniform(-1.5, 1.5, 3), 0.3) for r in network.flight_regions]
            )
            gaze = rng.uniform(-0.4, 0.4, (4, 2))
        one.advance(Setpoints(p, gaze))
        many.step(np.broadcast_to(np.concatenate([p, gaze], axis=1), (3, 4, 5)))
        np.testing.assert_allclose(many.gather("cameras")[1, :, :3], one.snapshot.camera_p_world, atol=1e-6)
        np.testing.assert_allclose(many.believed()[1], one.believed_p_world, atol=1e-6)
        np.testing.assert_allclose(many.gather("own_x")[1], own.x, atol=1e-6)
        np.testing.assert_allclose(many.gather("own_cov")[1], own.cov, rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(many.gather("own_turn")[1], own.turn_rad[list(own.agents)], atol=1e-7)
        largest = max(largest, float(own.error_m.max()))
        estimate, row = one.driving[0].estimate, many.gather("estimate")[1, 0]
        if np.isfinite(estimate.last_seen_s):
            np.testing.assert_allclose(row[ESTIMATE["p"]], estimate.p_world, atol=1e-5)
            np.testing.assert_allclose(row[ESTIMATE["radius"]], estimate.radius_m, rtol=1e-4)
    assert np.isfinite(one.driving[0].estimate.last_seen_s)
    assert largest > 0.05  # there was something to agree on
    assert not np.allclose(many.gather("own_errors")[0], many.gather("own_errors")[1])
    one.world.close()
    many.close()


def test_other_estimators_and_observers_are_refused() -> None:
    network = build_network(load_scenario("quickstart", DENIED))
    with pytest.raises(ConfigError, match="has 'ekf'"):
        BatchSimulation(network, SHOWN, 1, "frozen")
    with pytest.raises(ConfigError, match=r"agents\[0\].pose.source"):
        BatchSimulation(network, SHOWN._replace(by_believed=False), 1, "ekf")

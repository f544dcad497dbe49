"""The certified layout, confirmed by closed-loop runs of the real estimator."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.errors import WorldError
from camnet.experiments.certified_layout import _coverage, run, run_mobile
from camnet.experiments.kinematic_world import KinematicWorld
from camnet.simulation.network import build_network
from camnet.world.protocol import CameraCommand


def test_a_world_without_physics_moves_targets_by_their_own_law():
    network = build_network(load_scenario("stationary_certified"))
    world = KinematicWorld(network.description)
    before = world.reset(np.random.default_rng(0))
    now = before
    for _ in range(60):
        now = world.step(CameraCommand.zeros(0))
    assert now.t_s == pytest.approx(1.0)
    moved = np.linalg.norm(now.target_p_world - before.target_p_world)
    assert 0.3 < moved < 0.45  # 0.4 m/s give or take the modulation
    with pytest.raises(WorldError, match="physics"):
        KinematicWorld(build_network(load_scenario("quickstart")).description)


def test_coverage_of_exchangeable_drifts_is_inside_its_interval_and_of_others_is_not():
    rng = np.random.default_rng(3)
    inside = [_coverage(rng.exponential(size=100))["inside"] for _ in range(100)]
    assert sum(inside) >= 96
    shifted = np.concatenate([rng.exponential(size=50), 3.0 + rng.exponential(size=50)])
    assert not _coverage(shifted)["inside"]


@pytest.mark.slow
def test_no_target_is_lost_and_a_moved_camera_loses_them():
    result = run(seeds=6)
    assert result["certified"]["verdict"] == "certified"
    assert result["runs"]["lost"] == 0
    assert result["runs"]["violations"] == 0
    assert result["falsified"]["violations"] == {"sound": 0, "learned": 0}
    assert result["moved"]["verdict"] == "not certified"
    assert result["moved"]["falsifier"]["lost"] > 0


@pytest.mark.slow
def test_quadrotors_lose_no_target_and_a_moved_region_loses_the_certificate():
    result = run_mobile(seeds=2)
    assert result["certified"]["verdict"] == "certified"
    assert result["runs"]["lost"] == 0
    assert result["runs"]["violations"] == 0
    assert result["falsified"]["violations"]["learned"] == 0
    assert result["falsified"]["closest_fraction"]["learned"] > 0.5
    assert result["moved"]["verdict"] == "not certified"

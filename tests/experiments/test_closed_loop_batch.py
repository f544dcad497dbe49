"""Attacks side by side on the batch back end: what each would be alone on the engine."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.experiments.closed_loop.attack import falsify_closed_loop, prepare, replay
from camnet.experiments.closed_loop.claims import Claims
from camnet.experiments.closed_loop.flight import fly
from camnet.experiments.closed_loop.flight_batch import can_fly_together, fly_together
from camnet.experiments.closed_loop.plan import Plan, PlanSpace
from camnet.simulation.network import build_network

WINDY = ["physics.wind.mean_mps=[0.6,0,0]", "physics.wind.gust_std_mps=0.2"]


@pytest.mark.parametrize(
    ("world", "settings", "seconds"),
    [
        ("mobile_certified", WINDY, 30),
        ("loop_8", [], 12),
        ("patrol", [], 60),
        ("stationary_certified", [], 30),
        ("courtyard", [], 30),
    ],
)
def test_flights_are_those_of_the_engine(world, settings, seconds):
    network = build_network(load_scenario(world, [f"run.duration_s={seconds}", *settings]))
    space = PlanSpace(network.n_targets, float(seconds), 2.0, 1.2)
    plans = [space.plan(genes) for genes in space.random(3, np.random.default_rng(3))]
    assert can_fly_together(network, "learned")
    together = fly_together(network, plans, "learned")[2]
    alone = fly(network, plans[2], "learned")
    np.testing.assert_allclose(together.t_s, alone.t_s, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(together.p_world, alone.p_world, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(together.seen, alone.seen)
    np.testing.assert_array_equal(together.lap, alone.lap)
    assert 0.0 < together.seen.mean() < 1.0
    assert len(together.gaps) == len(alone.gaps) > 0
    for a, b in zip(together.gaps, alone.gaps, strict=True):
        assert (a.target, a.from_camera) == (b.target, b.from_camera)
        assert (a.lost_s, a.seen_s, a.error_m) == pytest.approx((b.lost_s, b.seen_s, b.error_m), abs=1e-6)


def test_a_search_side_by_side_replays_and_its_batches_do_not_matter():
    scenario = load_scenario("mobile_certified", ["run.duration_s=30"])
    attack = prepare(scenario, Claims(unseen_max_s=4.0), {})
    found = falsify_closed_loop(attack, 8, 2, stop_when_broken=False)
    assert found["back_end"] == "batch"
    assert (found["trials"], found["violations"]) == (8, 8)
    record = found["attack"]
    assert replay(attack, Plan.from_dict(record["plan"])).as_dict() == record["figures"]


def test_what_the_batch_back_end_has_not_is_flown_on_the_engine():
    occluded = build_network(load_scenario("obstacle_course"))
    assert not can_fly_together(occluded, "learned")
    assert not can_fly_together(build_network(load_scenario("mobile_certified")), "adate")

"""The compiled observation against the readable one, on running networks and on states drawn at random."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.env.observe import Observer
from camnet.env.observe_kernel import NEIGHBOUR_FIELDS, OWN_FIELDS, TARGET_FIELDS
from camnet.env.settings import EnvSettings
from camnet.geometry.rotations import normalise
from camnet.simulation.entries import Entry
from camnet.simulation.run import decide, open_simulation, setpoints_for
from camnet.types import TargetEstimate


class _Told:
    """A filter whose estimate is given."""

    def __init__(self, estimate):
        self.estimate = estimate


def _equal(observer, simulation, entries):
    fast = np.array(observer.observe(simulation, entries))
    slow = np.array(observer.readable(simulation, entries))
    np.testing.assert_allclose(fast, slow, rtol=1e-6, atol=1e-6)
    return fast


@pytest.fixture(scope="module")
def simulation():
    simulation = open_simulation(load_scenario("quickstart"), 3, ("learned",))
    yield simulation
    simulation.world.close()


def test_sizes_are_those_of_the_layout(simulation):
    layout = Observer(simulation, EnvSettings()).layout
    assert layout.slices["target_0.known"].start == OWN_FIELDS
    assert layout.slices["neighbour_0.present"].start == OWN_FIELDS + TARGET_FIELDS
    assert layout.size == OWN_FIELDS + TARGET_FIELDS + 2 * NEIGHBOUR_FIELDS


def test_equal_while_the_network_runs(simulation):
    observer, unseen = Observer(simulation, EnvSettings(communication_range_m=6.0)), 0
    for _ in range(120):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
        unseen += not _equal(observer, simulation, simulation.entries())[:, OWN_FIELDS + 12].any()
    assert 0 < unseen < 120  # both cases occurred


def test_equal_for_any_estimate_and_entry(simulation):
    rng = np.random.default_rng(0)
    observer, kept = Observer(simulation, EnvSettings(neighbours=3)), simulation.filters["learned"]
    try:
        for k in range(40):
            known = k % 4 > 0
            estimate = TargetEstimate(
                t_s=0.0,
                p_world=rng.normal(scale=6.0, size=3),
                q_world=normalise(rng.normal(size=4)),
                v_world=rng.normal(size=3),
                w_body=np.zeros(3),
                seen=False,
                last_seen_s=simulation.snapshot.t_s - 2.0 if known else -np.inf,
                region=0,
                radius_m=np.inf if k % 3 == 0 else float(rng.uniform(0, 30)),
            )
            simulation.filters["learned"] = [_Told(estimate)]
            row = [
                Entry(j, rng.uniform(0, 30), rng.normal(size=3), rng.normal(size=3), rng.uniform(0, 9), j > 1)
                for j in range(4)
            ]
            entries = [[entry if known and rng.random() < 0.6 else None for entry in row]]
            fields = _equal(observer, simulation, entries)
            assert bool(fields[0, OWN_FIELDS]) == known
    finally:
        simulation.filters["learned"] = kept

"""Flying in compiled code does what the parts do when they are asked one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rounding import assert_records_alike, assert_rounded_alike

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.run import decide, open_simulation, setpoints_for
from camnet.types import Array
from camnet.world.targets import Targets

WIND = ("physics.wind.gust_std_mps=0.5",)
#: so low that agents, targets and the ground may touch, and the engine is watched
LOW = ("controller.min_height_m=0.6", "controller.target_extent_m=0.1")
#: length of a flight, and the control periods in it
_DECISIONS, _PERIODS = 40, 240


def _history(simulation: NetworkSimulation, decisions: int) -> tuple[Array, dict[str, Any]]:
    rows = []
    for _ in range(decisions):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
        now = simulation.snapshot
        parts = (now.agent_p_world, now.agent_q_world, now.camera_v_world, now.camera_w_cam)
        rows.append(np.concatenate([x.ravel() for x in (*parts, now.target_p_world, now.target_w_body)]))
    statistics = simulation.statistics
    counted = {"collisions": statistics.collisions, "effort": statistics.effort, "count": simulation.count}
    return np.array(rows), {**counted, **simulation.disturbance.summary()}


@pytest.mark.parametrize("overrides", [(), WIND, LOW])
def test_compiled_flight_is_the_loop_of_single_parts(overrides: tuple[str, ...]) -> None:
    scenario = load_scenario("quickstart", overrides)
    assert isinstance(scenario, Scenario)
    results = []
    for compiled in (True, False):
        simulation = open_simulation(scenario, 3, ("ekf",))
        assert simulation._autopilot is not None
        if not compiled:
            simulation._autopilot = None
        results.append(_history(simulation, _DECISIONS))
        simulation.world.close()
    (fast, counted), (slow, expected) = results
    assert_rounded_alike(fast, slow, scale=10.0, steps=_PERIODS)
    assert_records_alike(counted, expected, scale=1.0, steps=_PERIODS)


def test_targets_ahead_are_targets_step_by_step() -> None:
    scenario = load_scenario("quickstart")
    assert isinstance(scenario, Scenario)
    simulation = open_simulation(scenario, 1, ("ekf",))
    target = simulation.network.description.targets[0]
    simulation.world.close()
    dt, rng = 1.0 / 60.0, np.random.default_rng(0)
    ahead = Targets(("t",), (target.motion,), dt)
    (state,) = ahead.reset([np.random.default_rng(0)])
    for k in range(200):
        state = target.motion.step(state, k * dt, dt, rng)
        row = np.concatenate([state.p_world, state.q_world, state.v_world, state.w_body])
        assert_rounded_alike(ahead.advance(k * dt, 4 * k)[0], row, scale=10.0, steps=k + 1)

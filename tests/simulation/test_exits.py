"""Agents that leave their regions for a bounded time, to keep sight of a target."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.control.settings import ControllerSettings
from camnet.errors import WorldError
from camnet.simulation.exits import back_s
from camnet.simulation.network import build_network
from camnet.simulation.own_certificate import own_pose_report
from camnet.simulation.run import run_network

#: a region whose agent loses its target early, which has ways off to both sides
NARROW = (
    "regions.east.shape.min_m=[3.4,-1.8,0.0]",
    "agents.camera_0.start_m=[4.3,0,2.5]",
    "agents.camera_0.exit_reach_m=1.0",
    "run.duration_s=22",
)


def outside_of_box(p: np.ndarray) -> np.ndarray:
    """Whether places (n,3) are outside the eastern region."""
    return ((p < [3.4, -1.8, 0.0]) | (p > [5.8, 1.8, 3.5])).any(axis=1)


@pytest.mark.parametrize("budget_s", [8.0, 6.0])
def test_an_exit_is_used_and_never_exceeded(budget_s: float) -> None:
    result = run_network(
        load_scenario("quickstart", (*NARROW, f"agents.camera_0.exit_budget_s={budget_s}")), 1, ("learned",)
    )
    columns, values = result.log.columns, result.log.values
    p = values[:, [columns.index(f"camera_0.p_{axis}_m") for axis in "xyz"]]
    outside, t = outside_of_box(p), values[:, 0]
    assert outside.any()
    edges = np.flatnonzero(np.diff(np.r_[False, outside, False].astype(int)))
    longest = max(t[min(b, len(t) - 1)] - t[a] for a, b in edges.reshape(-1, 2))
    assert longest <= budget_s + 0.1  # of the log
    found = result.summary["exits"]["camera_0"]
    assert found["exceeded"] == 0
    assert found["exits"] >= 1
    assert found["longest_s"] == pytest.approx(longest, abs=0.2)
    assert result.summary["region_exits"] == 0  # of those that must stay
    reach = np.maximum(p[:, :2] - [5.8, 1.8], [3.4, -1.8] - p[:, :2]).max()
    assert reach <= 1.0 + 1e-6


def test_an_exit_keeps_the_target_in_view_for_longer() -> None:
    shares = []
    for budget_s in (0.0, 8.0):
        scenario = load_scenario("quickstart", (*NARROW, f"agents.camera_0.exit_budget_s={budget_s}"))
        shares.append(run_network(scenario, 1, ("learned",)).summary["time_in_view"])
    assert shares[1] > shares[0] + 0.02


def test_a_budget_too_short_to_come_back_is_not_used() -> None:
    scenario = load_scenario("quickstart", (*NARROW, "agents.camera_0.exit_budget_s=1"))
    report = own_pose_report(build_network(scenario))["exits"]["camera_0"]
    assert not report["leaves"]
    assert run_network(scenario, 1, ("learned",)).summary["exits"]["camera_0"]["exits"] == 0


def test_the_way_back_is_flown_in_time_by_the_slowest_account() -> None:
    control = ControllerSettings()
    v, a, j = control.reference_v_max_mps, control.reference_a_max_mps2, control.reference_jerk_max_mps3
    # a trapezoid with ramps of acceleration, at a speed less the disturbance, from full speed the wrong way
    for away in (0.0, 0.5, 3.0):
        x, u, acceleration, t, dt = away, v, 0.0, 0.0, 1e-3
        while x > 0.0 or t == 0.0:
            wanted = -a if u > -(v - control.d_bar_mps) else 0.0
            acceleration += max(-j * dt, min(j * dt, wanted - acceleration))
            u = max(u + acceleration * dt, -(v - control.d_bar_mps))
            x, t = x + u * dt, t + dt
        assert t <= back_s(away, control)
        assert math.isfinite(t)


def test_reaches_into_others_regions_are_refused() -> None:
    with pytest.raises(WorldError, match=r"exit_reach_m.*reaches into region 'north'"):
        load_scenario("quickstart", ("agents.camera_0.exit_budget_s=5", "agents.camera_0.exit_reach_m=2"))

"""Certificates during a run: time left, margin, and violations that are logged as errors and counted."""

from __future__ import annotations

import logging
import math

import pytest

from camnet.config.load import load_scenario
from camnet.experiments.kinematic_world import KinematicWorld
from camnet.simulation.coordination import Task
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import build_network
from camnet.simulation.recorder import Recorder
from camnet.simulation.run import setpoints_for
from camnet.simulation.summary import summarise

#: noise far beyond the bound that is stated: `sound` accepts the settings, and the run breaks what it says
FALSE_BOUNDS = (
    "certificate.position_error_m=0.001",
    "certificate.orientation_error_rad=0.001",
    "certificate.eps_bar=0.05",
    "sensing.position_noise_m=20.0",
    "targets.robot.v_max_mps=0.45",
    "targets.robot.w_max_radps=0.5",
    "estimator.weight_bound=0.2",
    "estimator.gamma=2.0",
    "estimator.kcl=0.1",
    "estimator.stack.size=10",
    "estimator.stack.forgetting=false",
    "estimator.gap.learn_across=false",
)


def simulate(seconds: float, *overrides: str) -> tuple[NetworkSimulation, Recorder]:
    scenario = load_scenario("stationary_certified", ["controller.rate_hz=30", *overrides])
    network = build_network(scenario)
    simulation = NetworkSimulation(network, KinematicWorld(network.description), ("learned",), 0)
    recorder = Recorder(simulation)
    tasks: list[Task] = []
    for _ in range(round(seconds * scenario.run.decision_hz)):
        setpoints = setpoints_for(simulation, tasks)
        recorder.record(setpoints, tasks)
        simulation.advance(setpoints)
    simulation.statistics.finish()
    return simulation, recorder


def test_a_forced_violation_is_an_error_and_counted(caplog):
    with caplog.at_level(logging.ERROR):
        simulation, recorder = simulate(20.0, *FALSE_BOUNDS)
    errors = [r.getMessage() for r in caplog.records if r.levelno == logging.ERROR]
    assert any("robot: sound certificate violated" in words for words in errors)
    summary = summarise(simulation, 1.0, False)
    assert summary["certificate_violations"] == summary["dwell"]["certificate_violations"] >= 1
    assert summary["dwell"]["certificate_violations"] == sum("violated" in w for w in errors)
    table = recorder.log.table().to_pydict()
    left, margin = table["robot.off_left_s"], table["robot.off_margin_m"]
    out = [k for k, x in enumerate(left) if not math.isnan(x)]
    assert out
    assert left[out[0]] > left[out[1]]  # it runs down
    assert margin[out[0]] > margin[out[1]]
    assert table["robot.violations"][-1] >= 1
    assert table["robot.violations"][0] == 0


def test_a_target_out_of_view_for_longer_than_stated_is_an_error(caplog):
    with caplog.at_level(logging.ERROR):
        simulation, _ = simulate(12.0, "certificate.off_max_s=2.0")
    assert simulation.statistics.episode(simulation)["overdue"] == 1
    assert any("out of view since" in r.getMessage() for r in caplog.records)


def test_an_honest_run_logs_nothing_and_tells_the_time_left(caplog):
    with caplog.at_level(logging.WARNING):
        simulation, recorder = simulate(12.0)
    assert not caplog.records
    figures = simulation.statistics.episode(simulation)
    assert (figures["certificate_violations"], figures["overdue"]) == (0, 0)
    left = [x for x in recorder.log.table().to_pydict()["robot.off_left_s"] if not math.isnan(x)]
    assert max(left) == pytest.approx(20.0, abs=0.2)  # the stated 20 s
    assert min(left) > 10.0
    now = simulation.statistics.certificate(simulation.snapshot.t_s)
    assert set(now) == {"time_left_s", "margin_m", "violations", "overdue", "targets"}
    assert set(now["targets"]) == {"robot"}

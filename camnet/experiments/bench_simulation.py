"""Speed of the closed loop and the environment of ``quickstart``, beside real time and bare PyBullet in the same run.

Every case and the baseline run by turns in one process, and CPU time is counted, so that other work on the machine
disturbs the ratios little. ``bare`` is PyBullet with as many bodies and calls and nothing computed.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from camnet.agents import make_policies
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env.handoff_v0 import HandoffEnv
from camnet.errors import WorldError
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.run import decide, open_simulation, setpoints_for
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet.raw import raw_seconds

__all__ = ["measure_environment", "run"]

#: the shipped estimators side by side, as ``camnet simulate`` runs them; and the driving one alone
CASES = {"all estimators": ("learned", "printed", "ekf", "ideal"), "learned alone": ("learned",)}
_CHUNK_S, _ROUNDS = 10.0, 6
#: turns of the environment and of bare PyBullet, and decisions in each
_TURNS, _DECISIONS = 12, 50


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Measure.

    Returns
    -------
    dict
        ``{"agents", "step_hz", "bare": {"real_time_factor"}, "cases": [{"name", "real_time_factor",
        "share_of_bare"}], "environment"}``; medians over rounds. The last is `measure_environment`.
    """
    scenario = load_scenario("quickstart")
    if not isinstance(scenario, Scenario):
        raise WorldError("quickstart is no network")
    agents, step_hz = len(scenario.agents), scenario.physics.step_hz
    loops = {name: open_simulation(scenario, seed, filters) for name, filters in CASES.items()}
    flights = {"world alone": open_simulation(scenario, seed, ("learned",))}
    for simulation in loops.values():
        _fly(simulation, 2.0)  # compiled code is loaded
    times: dict[str, list[float]] = {name: [] for name in ("bare", *flights, *loops)}
    for k in range(_ROUNDS):
        times["bare"].append(raw_seconds(agents, _CHUNK_S, step_hz))
        for name, simulation in flights.items():
            times[name].append(_step_world(simulation, _CHUNK_S))
        for name, simulation in loops.items():
            times[name].append(_fly(simulation, _CHUNK_S))
        if progress is not None:
            progress((k + 1) / _ROUNDS)
    for simulation in (*loops.values(), *flights.values()):
        simulation.world.close()
    return {
        "agents": agents,
        "step_hz": step_hz,
        "bare": {"real_time_factor": _CHUNK_S / statistics.median(times["bare"])},
        "cases": [_case(name, times) for name in (*flights, *loops)],
        "environment": measure_environment(seed),
    }


def measure_environment(seed: int = 0, turns: int = _TURNS, decisions: int = _DECISIONS) -> dict[str, float]:
    """Measure the handoff environment with the built-in ``learned`` policies, learning on, beside bare PyBullet.

    Each turn is so many decisions of one and the same running episode, its policies included, and as many body-steps of
    bare PyBullet; CPU time of one core counts.

    Returns
    -------
    dict
        ``env_steps_per_s`` (decisions of all agents), ``drone_control_steps_per_s`` (control periods of single
        agents), ``raw_body_steps_per_s`` (bare PyBullet) and ``raw_limit_fraction``: time of bare PyBullet for the same
        body-steps over the time taken; medians over turns.
    """
    env = HandoffEnv("quickstart", max_cycles=(turns + 1) * decisions)
    policies, (observations, _) = make_policies("learned", env), env.reset(seed=seed)
    scenario = env.simulation.network.scenario
    agents, per_s, step_hz = len(scenario.agents), scenario.run.decision_hz, scenario.physics.step_hz
    times: list[tuple[float, float]] = []
    for turn in range(turns + 1):
        start = time.process_time()
        for _ in range(decisions):
            actions = {name: policies[name](np.asarray(observations[name])) for name in env.agents}
            observations, *_ = env.step(actions)
        spent = time.process_time() - start
        if turn > 0:  # in the first one compiled code is loaded
            times.append((raw_seconds(agents, decisions / per_s, step_hz), spent))
    env.close()
    bare, taken = (statistics.median(column) for column in zip(*times, strict=True))
    return {
        "env_steps_per_s": decisions / taken,
        "drone_control_steps_per_s": agents * decisions / per_s * scenario.controller.rate_hz / taken,
        "raw_body_steps_per_s": agents * decisions / per_s * step_hz / bare,
        "raw_limit_fraction": statistics.median(raw / spent for raw, spent in times),
    }


def _fly(simulation: NetworkSimulation, seconds: float) -> float:
    """CPU time of the built-in system for ``seconds`` of simulated time."""
    start = time.process_time()
    for _ in range(round(seconds * simulation.network.scenario.run.decision_hz)):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
    return time.process_time() - start


def _step_world(simulation: NetworkSimulation, seconds: float) -> float:
    """CPU time of the world alone, its agents hovering."""
    command = CameraCommand.zeros(simulation.network.n_agents)
    start = time.process_time()
    for _ in range(round(seconds / simulation.control_dt_s)):
        simulation.world.step(command)
    return time.process_time() - start


def _case(name: str, times: dict[str, list[float]]) -> dict[str, Any]:
    ratios = [bare / spent for bare, spent in zip(times["bare"], times[name], strict=True)]
    return {
        "name": name,
        "real_time_factor": _CHUNK_S / statistics.median(times[name]),
        "share_of_bare": statistics.median(ratios),
    }

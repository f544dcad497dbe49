"""Speed of the closed loop of ``quickstart``, beside real time and beside bare PyBullet on the same machine.

Every case and the baseline run by turns in one process, and CPU time is counted, so that other work on the machine
disturbs the ratios little. ``bare`` is PyBullet with as many bodies and calls and nothing computed.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.errors import WorldError
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.run import decide, open_simulation, setpoints_for
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet.raw import raw_seconds

__all__ = ["run"]

#: the shipped estimators side by side, as ``camnet simulate`` runs them; and the driving one alone
CASES = {"all estimators": ("learned", "printed", "ekf", "ideal"), "learned alone": ("learned",)}
_CHUNK_S, _ROUNDS = 10.0, 6


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Measure.

    Returns
    -------
    dict
        ``{"agents", "step_hz", "bare": {"real_time_factor"}, "cases": [{"name", "real_time_factor",
        "share_of_bare"}]}``; medians over rounds.
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

"""Run the built-in system on a network from start to end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.config.models import Scenario
from camnet.control.setpoints import Setpoint, at_ease, intercept, loiter, sway, track
from camnet.estimation.own_pose import SIGMAS
from camnet.estimation.persistence import LearnedModel
from camnet.simulation.coordination import Role, Task, assign
from camnet.simulation.events import EventRecorder
from camnet.simulation.handoff import Handoff
from camnet.simulation.log import RunLog
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.simulation.models import check_learning, collect_learned
from camnet.simulation.network import Network, build_network
from camnet.simulation.recorder import Recorder
from camnet.simulation.summary import summarise
from camnet.types import Array, TargetEstimate
from camnet.world.pybullet import PyBulletWorld

__all__ = ["RunResult", "open_simulation", "run_network", "setpoint_for", "setpoints_for"]

#: agents sway about a target until they know its size to this share
KNOWN_SIZE = 0.005
#: called with the simulated time after every decision
Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class RunResult:
    """What a run leaves behind.

    Attributes
    ----------
    summary : figures of the run, ready for JSON
    log : the whole log
    handoffs : one record per attempted handoff
    events : the table of events (`camnet.simulation.events`)
    network : the network that ran
    interrupted : whether it was stopped before its end
    learned : what the first learning estimator has learned, where that was asked for
    """

    summary: dict[str, Any]
    log: RunLog
    handoffs: list[dict[str, Any]]
    events: list[dict[str, Any]]
    network: Network
    interrupted: bool
    learned: list[LearnedModel]


def open_simulation(
    scenario: Scenario, seed: int, filters: tuple[str, ...] | None = None
) -> NetworkSimulation:
    """Build network and world and put them at their start."""
    network = build_network(scenario)
    chosen = scenario.run.estimators if filters is None else filters
    return NetworkSimulation(network, PyBulletWorld(network.description), chosen, seed)


def run_network(
    scenario: Scenario,
    seed: int,
    filters: tuple[str, ...] | None = None,
    progress: Progress | None = None,
    keep_models: bool = False,
) -> RunResult:
    """Simulate ``scenario`` for its duration under the built-in handoff rule.

    A keyboard interrupt ends the run early; its result is valid up to there and marked. With ``keep_models`` the result
    holds what was learned.

    Raises
    ------
    ConfigError
        ``keep_models`` without an estimator that learns.
    SimulationError
        The physics diverged; the message names body and step.
    """
    if keep_models:
        check_learning(scenario.run.estimators if filters is None else filters)
    simulation = open_simulation(scenario, seed, filters)
    recorder, events = Recorder(simulation), EventRecorder(simulation)
    interrupted, start = False, time.perf_counter()
    try:
        _loop(simulation, recorder, scenario.run.duration_s, progress)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        simulation.world.close()
    wall_s = time.perf_counter() - start
    simulation.statistics.finish()
    recorder.finish()
    network = simulation.network
    learned = collect_learned(simulation.filters, network.basis, network.n_models) if keep_models else []
    summary = summarise(simulation, wall_s, interrupted)
    handoffs = [_handoff_record(simulation, h) for t in simulation.trackers for h in t.handoffs]
    happened = events.table(handoffs, simulation.statistics.collisions)
    return RunResult(summary, recorder.log, handoffs, happened, network, interrupted, learned)


def _loop(
    simulation: NetworkSimulation, recorder: Recorder, duration_s: float, progress: Progress | None
) -> None:
    run = simulation.network.scenario.run
    log_every = max(1, round(run.decision_hz / run.log_hz))
    for k in range(round(duration_s * run.decision_hz)):
        tasks = decide(simulation)
        setpoints = setpoints_for(simulation, tasks)
        if k % log_every == 0:
            recorder.record(setpoints, tasks)
        simulation.advance(setpoints)
        if progress is not None:
            progress(simulation.snapshot.t_s)


def decide(simulation: NetworkSimulation) -> list[Task]:
    """Give every agent its task from the driving estimates."""
    if simulation.network.n_agents == 0:
        return []
    estimates = [f.estimate for f in simulation.driving]
    regions = simulation.network.regions[: simulation.network.n_agents]
    points = np.array([e.p_world for e in estimates])
    inside = simulation.network.containment(points)[:, : len(regions)]
    known = np.array([np.isfinite(e.last_seen_s) for e in estimates])  # an image may be on its way still
    limits = simulation.network.half_widths[: len(regions)]
    seen = simulation.visible[: len(regions)] & known
    return assign(estimates, simulation.entries(), inside & known[:, None], seen, limits)


def setpoints_for(simulation: NetworkSimulation, tasks: list[Task]) -> Setpoints:
    """Turn tasks into setpoints."""
    estimates = [f.estimate for f in simulation.driving]
    own, exits, p_world = simulation.own, simulation.exits, simulation.believed_p_world
    chosen = [
        setpoint_for(
            simulation.network,
            j,
            task,
            estimates,
            p_world[j],
            simulation.snapshot.t_s,
            own_m=0.0 if own is None else SIGMAS * own.spread_m(j),
            may_leave=exits is not None and exits.free(j),
        )
        for j, task in enumerate(tasks)
    ]
    for j, task in enumerate(tasks):
        size = simulation.sizes.get(task.target) if task.role is Role.TRACK else None
        if size is not None and size.sd > KNOWN_SIZE:
            region, control = simulation.network.flight_regions[j], simulation.network.scenario.controller
            chosen[j] = sway(chosen[j], simulation.snapshot.t_s, region, control)
    p_world = np.array([s.p_world for s in chosen]).reshape(-1, 3)
    return Setpoints(p_world, np.array([s.gaze for s in chosen]).reshape(-1, 2))


def setpoint_for(
    network: Network,
    j: int,
    task: Task,
    estimates: Sequence[TargetEstimate],
    camera_p: Array,
    t_s: float,
    own_m: float = 0.0,
    may_leave: bool = False,
) -> Setpoint:
    """Turn the task of agent ``j``, whose camera is (or is believed to be) at ``camera_p`` (3,), into its setpoint.

    ``own_m`` is the radius of what the agent may be off by: it is added to the ball in which it expects a target that
    others saw. ``may_leave``: it may follow a target out of its region.
    """
    region, camera, settings = network.flight_regions[j], network.cameras[j], network.scenario.controller
    free = network.viewpoints.get(j)  # among occluders alone
    if task.role is Role.TRACK:
        estimate = estimates[task.target]
        wanted = track(estimate, None if may_leave else region, camera, settings, camera_p)
        return wanted if free is None else free.seeing(wanted, estimate.p_world, camera_p)
    if task.role is Role.INTERCEPT and task.entry is not None:
        entry = task.entry
        late_s = t_s - entry.t_s
        radius_m = entry.radius_m + own_m
        goal = intercept(entry.p_world, entry.v_world, radius_m, region, camera, settings, late_s)
        left_s = max(-late_s, 0.0)
        if free is None:
            return at_ease(goal, camera_p, settings, left_s)
        return free.on_the_way(free.seeing(goal, entry.p_world), camera_p, left_s)
    if free is None:
        return at_ease(loiter(region, camera, settings), camera_p, settings)
    return free.on_the_way(free.rest, camera_p)


def _handoff_record(simulation: NetworkSimulation, handoff: Handoff) -> dict[str, Any]:
    names = simulation.world.camera_names
    grace = simulation.network.scenario.handoff.grace_s
    seen = bool(np.isfinite(handoff.t_seen_s))
    lost_for = simulation.network.lost_for_s
    return {
        "target": simulation.world.target_names[handoff.target],
        "from": names[handoff.from_region],
        "to": names[handoff.to_region],
        "lost_s": handoff.t_lost_s,
        "entered_s": handoff.t_enter_s,
        "seen_s": handoff.t_seen_s if seen else None,
        "delay_s": handoff.delay_s if seen else None,
        "completed": handoff.completed(grace),
        "from_lost_for_s": lost_for(handoff.from_region, handoff.t_lost_s),
        "to_lost_for_s": lost_for(handoff.to_region, handoff.t_enter_s),
    }

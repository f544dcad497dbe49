"""Fly one attack and keep the log of the truth: which target was in some camera's view when.

This is what flies where the batch back end cannot (`camnet.experiments.closed_loop.flight_batch`), one plan at a time:

| what is promised | what flies |
| --- | --- |
| how long targets are out of view of fixed cameras | targets alone, and the simulator's visibility along their ways |
| an estimate's error before fixed cameras | the closed loop without physics, where nothing can hide anything |
| anything of agents, or among occluders | the whole closed loop on the rigid-body engine |
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from camnet.experiments.closed_loop.arena import hostile
from camnet.experiments.closed_loop.plan import Plan
from camnet.experiments.kinematic_world import KinematicWorld
from camnet.motion.planned import PlannedField
from camnet.motion.protocol import TargetMotion
from camnet.sensing.visibility import VisibilityTest
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import Network
from camnet.simulation.run import decide, setpoints_for
from camnet.types import Array, BoolArray, IntArray
from camnet.world.description import WorldDescription
from camnet.world.protocol import CameraCommand, World
from camnet.world.pybullet import PyBulletWorld

__all__ = ["GapRecord", "TruthLog", "fly", "laps_of"]


@dataclass(frozen=True, slots=True)
class GapRecord:
    """A gap of a target that ended: who saw it before, from when to when, and the estimate's error at its end, m."""

    target: int
    from_camera: int
    lost_s: float
    seen_s: float
    error_m: float


@dataclass(frozen=True, eq=False)
class TruthLog:
    """What is judged.

    Attributes
    ----------
    t_s : (T,) sensing instants, s
    seen : (T, M) whether some camera sees the target
    p_world : (T, M, 3) where it is, m
    lap : (T, M) which lap of its tour through the regions it is on, seen or not, from 1 (0 where nobody counts)
    gaps : gaps that ended, with the estimate's errors; empty where no estimator ran
    use : by assumption, the largest share of what is assumed that occurred
    region : (T, M) the region that it is in, -1 in none; None where nobody asked
    """

    t_s: Array
    seen: BoolArray
    p_world: Array
    lap: IntArray
    gaps: list[GapRecord] = field(default_factory=list)
    use: dict[str, float] = field(default_factory=dict)
    region: IntArray | None = None


def laps_of(region: IntArray) -> IntArray:
    """Return the lap (T, M), from 1, of targets that are truly in ``region`` (T, M), -1 in none.

    A lap ends where a target comes back to the region that it was in first. Whoever is lost goes on counting: a promise
    that waits for a lap is not put off by a network that sees nothing.
    """
    out = np.ones(region.shape, dtype=np.int64)
    for m in range(region.shape[1]):
        inside = np.flatnonzero(region[:, m] >= 0)
        if len(inside) == 0:
            continue
        visited = region[inside, m]
        back = (visited[1:] == visited[0]) & (visited[:-1] != visited[0])
        for k in inside[1:][back].tolist():
            out[k:, m] += 1
    return out


def fly(network: Network, plan: Plan, estimator: str | None) -> TruthLog:
    """Fly ``plan`` for ``run.duration_s``; without an estimator (fixed cameras alone) only the targets move."""
    description = hostile(network, plan)
    if estimator is None and network.n_agents == 0:
        return _watch(network, description, plan)
    bare = network.n_agents == 0 and not network.occluders and network.n_targets == 1
    world: World = KinematicWorld(description) if bare else PyBulletWorld(description)
    try:
        with _overdue_unsaid():
            return _fly(NetworkSimulation(network, world, (estimator or "learned",), plan.seed))
    finally:
        world.close()


@contextmanager
def _overdue_unsaid() -> Iterator[None]:
    """Keep the run's own monitor from logging what the attack is about."""
    logger = logging.getLogger("camnet.certification.monitor")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _watch(network: Network, description: WorldDescription, plan: Plan) -> TruthLog:
    """Move the targets alone and ask the simulator's visibility at every sensing instant."""
    scenario = network.scenario
    if not network.occluders and network.n_targets == 1:
        return _watch_alone(network, description, plan)
    world: World = PyBulletWorld(description)
    every = max(1, round(scenario.controller.rate_hz / scenario.sensing.rate_hz))
    features = [target.features_m for target in description.targets]
    test = VisibilityTest(network.cameras, features, [None] * len(network.cameras))
    t_s, seen, places = [], [], []
    try:
        snapshot = world.reset(np.random.default_rng(plan.seed))
        still = CameraCommand.zeros(0)
        for k in range(round(scenario.run.duration_s * scenario.controller.rate_hz) + 1):
            if k % every == 0:
                t_s.append(snapshot.t_s)
                seen.append(test(snapshot, world.rays_clear).any(axis=0))
                places.append(snapshot.target_p_world.copy())
            snapshot = world.step(still)
    finally:
        world.close()
    return TruthLog(np.array(t_s), np.array(seen), np.array(places), np.zeros(np.shape(seen), dtype=np.int64))


def _watch_alone(network: Network, description: WorldDescription, plan: Plan) -> TruthLog:
    """Do the same where nothing can hide the one target: all instants are looked at at once."""
    scenario, target = network.scenario, description.targets[0]
    rate_hz = scenario.controller.rate_hz
    every = max(1, round(rate_hz / scenario.sensing.rate_hz))
    states = _poses(target.motion, round(scenario.run.duration_s * rate_hz), 1.0 / rate_hz, plan.seed)[
        ::every
    ]
    world = KinematicWorld(description)
    now = world.reset(np.random.default_rng(plan.seed))
    place = replace(now, target_p_world=states[:, :3].copy(), target_q_world=states[:, 3:].copy())
    test = VisibilityTest(network.cameras, [target.features_m] * len(states), [None] * len(network.cameras))
    seen = np.asarray(test.in_view(place).any(axis=0)).reshape(-1, 1)
    t_s = np.arange(len(states)) * every / rate_hz
    return TruthLog(t_s, seen, states[:, None, :3], np.zeros(seen.shape, dtype=np.int64))


def _poses(motion: TargetMotion, steps: int, dt_s: float, seed: int) -> Array:
    """Return the poses (steps + 1, 7) of a target that moves by itself: p, q."""
    if isinstance(motion, PlannedField):
        return motion.poses(dt_s, steps)
    rng = np.random.default_rng(seed)
    state = motion.reset(rng)
    rows = [np.concatenate([state.p_world, state.q_world])]
    for k in range(steps):
        state = motion.step(state, k * dt_s, dt_s, rng)
        rows.append(np.concatenate([state.p_world, state.q_world]))
    return np.array(rows)


class _Keeper:
    """Writes the truth down at every sensing instant."""

    def __init__(self) -> None:
        self.t_s: list[float] = []
        self.seen: list[Any] = []
        self.places: list[Array] = []
        self.regions: list[IntArray] = []
        self.at_once = 0

    def __call__(self, simulation: NetworkSimulation) -> None:
        self.t_s.append(simulation.snapshot.t_s)
        self.seen.append(simulation.visible.any(axis=0))
        self.places.append(simulation.snapshot.target_p_world.copy())
        self.regions.append(simulation.target_region.copy())
        inside = simulation.target_region[simulation.target_region >= 0]
        self.at_once = max(self.at_once, int(np.bincount(inside).max(initial=0)))


def _fly(simulation: NetworkSimulation) -> TruthLog:
    keeper = _Keeper()
    keeper(simulation)  # the first instant was sensed before anybody could watch
    simulation.watchers.append(keeper)
    run = simulation.network.scenario.run
    for _ in range(round(run.duration_s * run.decision_hz)):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
    name = simulation.filter_names[0]
    gaps = [
        GapRecord(m, g.from_camera, g.lost_s, g.seen_s, g.error_m[name])
        for m, recorder in enumerate(simulation.gaps)
        for g in recorder.gaps
    ]
    regions = np.array(keeper.regions)
    return TruthLog(
        np.array(keeper.t_s),
        np.array(keeper.seen),
        np.array(keeper.places),
        laps_of(regions),
        gaps,
        _use(simulation, keeper),
        regions,
    )


def _use(simulation: NetworkSimulation, keeper: _Keeper) -> dict[str, float]:
    """Return how much of each assumption about agents was used up."""
    out = {}
    if simulation.network.n_agents:
        out["one target in a region at a time"] = float(keeper.at_once) if keeper.at_once > 1 else 0.0
        seen = simulation.disturbance.summary()
        out["bound of the disturbance"] = max(
            float(seen["disturbance_max"]) / float(seen["d_bar"]),
            float(seen["disturbance_max_radps"]) / float(seen["d_bar_radps"]),
        )
        out["agents stay in their regions"] = float(simulation.statistics.region_exits > 0)
        out["no collisions"] = float(len(simulation.statistics.collisions) > 0)
    return out

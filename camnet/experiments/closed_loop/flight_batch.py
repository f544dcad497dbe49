"""Fly many attacks side by side on the batch back end: the same plans, rules and judge, hundreds of times faster.

The batch back end has the flight, sensors, estimators and random numbers of the rigid-body engine, but no contacts, and
its agents fly in the open (docs/batch.md); what it lacks is flown on the engine, one plan at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camnet.batch.loop import DIVERGED
from camnet.batch.network import Shown, pack_network
from camnet.batch.simulation import BatchSimulation
from camnet.batch.state import COLLISIONS, ESTIMATE, EXITS, SLIP
from camnet.env.batch_handoff import batch_filter
from camnet.env.batch_messages import Present, shared_rows
from camnet.env.batch_modes import AssignRows
from camnet.errors import ConfigError, SimulationError
from camnet.experiments.closed_loop.arena import hostile
from camnet.experiments.closed_loop.flight import GapRecord, TruthLog, laps_of
from camnet.experiments.closed_loop.plan import Plan, PlanSpace
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray, IntArray

__all__ = ["can_fly_together", "fly_together"]

#: runs where nobody asks what is believed
_CHEAPEST = "ekf"
#: nobody is shown or rewarded anything
_SHOWN = Shown(0.5, 0, 1.0, (0.0,) * 6, terminate_on_collision=False, lost_limit_s=np.inf, in_world=True)


def can_fly_together(network: Network, estimator: str | None) -> bool:
    """Whether the batch back end has everything that this world and estimator need."""
    scenario = network.scenario
    if estimator is not None and scenario.run.model is not None:
        return False
    plan = PlanSpace(network.n_targets, 1.0).plan(np.zeros(PlanSpace(network.n_targets, 1.0).size))
    try:
        pack_network(_every_sensing(network, plan), _SHOWN)
        batch_filter(estimator or _CHEAPEST, network)
    except ConfigError:
        return False
    return True


def fly_together(
    network: Network, plans: Sequence[Plan], estimator: str | None, threads: int = 1
) -> list[TruthLog]:
    """Fly ``plans`` for ``run.duration_s``, all at once; the logs are those that each would have alone.

    Without an ``estimator``, which fixed cameras allow, logs have no gaps with errors.
    """
    run = network.scenario.run
    simulation = BatchSimulation(
        _every_sensing(network, plans[0]),
        _SHOWN,
        len(plans),
        batch_filter(estimator or _CHEAPEST, network),
        threads=threads,
        duration_s=run.duration_s,
    )
    try:
        logs = _fly(network, simulation, plans)
    finally:
        simulation.close()
    return logs if estimator is not None else [replace(log, gaps=[]) for log in logs]


def _every_sensing(network: Network, plan: Plan) -> Network:
    """Return the network under an attack, with a step of the back end from sensing to sensing: all is looked at."""
    scenario = network.scenario
    run = scenario.run.model_copy(update={"decision_hz": scenario.sensing.rate_hz})
    scenario = scenario.model_copy(update={"run": run})
    return replace(network, scenario=scenario, description=hostile(network, plan))


def _fly(network: Network, simulation: BatchSimulation, plans: Sequence[Plan]) -> list[TruthLog]:
    settings = network.scenario
    worlds = [hostile(network, plan) for plan in plans]
    motions = [[target.motion for target in world.targets] for world in worlds]
    winds = np.array([world.physics.wind.mean_mps for world in worlds])
    simulation.reset(np.arange(len(plans)), [plan.seed for plan in plans], motions, winds)
    keeper, rules = _Keeper(simulation), _Rules(network, simulation)
    every = round(settings.sensing.rate_hz / settings.run.decision_hz)
    for k in range(round(settings.run.duration_s * settings.run.decision_hz) * every):
        if k % every == 0:
            asked = rules.setpoints()
        try:
            simulation.step(asked)
        except SimulationError:  # those that fell out of the sky see nothing any more
            keeper.gone |= simulation.outcome[:, DIVERGED] > 0.0
        keeper.note()
    return keeper.logs()


class _Rules:
    """The handoff rule of the built-in system (`camnet.simulation.coordination`), for all environments at once."""

    def __init__(self, network: Network, simulation: BatchSimulation) -> None:
        e, n, m = simulation.environments, network.n_agents, network.n_targets
        self._network, self._simulation = network, simulation
        self._mode = AssignRows(network, e) if n else None
        self._limits = network.half_widths[:n]
        self._alive = np.ones((e, n), dtype=bool)
        self._working = np.ones((e, len(network.cameras)), dtype=bool)
        self._loiter, self._shape = 2 * m, (e, n, m)

    def setpoints(self) -> Array:
        """Return the setpoints (E, N, 5) of all agents."""
        simulation, (e, n, _) = self._simulation, self._shape
        if self._mode is None:
            return np.zeros((e, 0, 5))
        cameras = simulation.gather("cameras")
        now = Present(
            t_s=simulation.outcome[:, 3].copy(),
            estimate=simulation.gather("estimate"),
            entries=simulation.gather("entries"),
            visible=simulation.gather("visible") > 0,
            cameras_p=cameras[..., :3],
            working=self._working,
        )
        return self._mode.ask(self._tasks(now), self._alive, cameras, shared_rows(now, n))

    def _tasks(self, now: Present) -> IntArray:
        """Return each agent's task (E, N): target to follow, M + target to meet, or 2 M to wait."""
        e, n, m = self._shape
        p, radius = now.estimate[..., ESTIMATE["p"]], now.estimate[..., ESTIMATE["radius"]]
        known = np.isfinite(now.estimate[..., ESTIMATE["last_seen"]])
        inside = self._network.containment(p.reshape(-1, 3))[:, :n].reshape(e, m, n) & known[..., None]
        inside = inside.transpose(0, 2, 1)
        seen = now.visible[:, :n] & known[:, None]
        within = radius[:, None] <= self._limits[:, None]
        present = (inside | seen) & (seen | within)
        follow = _least(present, ~seen, np.broadcast_to(radius[:, None], present.shape))
        entry = now.entries[:, :, :n].transpose(0, 2, 1, 3)
        coming = (entry[..., 0] > 0.0) & (entry[..., 8] <= self._limits[:, None])
        meet = _least(coming, entry[..., 0] < 1.0, entry[..., 1])
        tasks = np.where(coming.any(axis=2), m + meet, self._loiter)
        return np.where(present.any(axis=2), follow, tasks)


def _least(among: BoolArray, later: BoolArray, value: Array) -> IntArray:
    """Return which of the last axis is least, of those ``among``: those not ``later`` first, then by ``value``."""
    key = np.where(among & ~later, value, np.inf)
    rest = np.where(among, value, np.inf)
    first = (among & ~later).any(axis=-1)
    chosen: IntArray = np.where(first, key.argmin(axis=-1), rest.argmin(axis=-1)).astype(np.int64)
    return chosen


class _Keeper:
    """Writes the truth of all environments down at every sensing instant."""

    def __init__(self, simulation: BatchSimulation) -> None:
        self.gone: BoolArray = np.zeros(simulation.environments, dtype=bool)
        self._simulation = simulation
        self._t_s: list[float] = []
        self._rows: list[tuple[BoolArray, Array, IntArray, IntArray, Array]] = []
        self._before: Array | None = None
        self._at_once = np.zeros(simulation.environments, dtype=np.int64)
        self.note()

    def note(self) -> None:
        """Take in the present instant."""
        simulation = self._simulation
        t_s = float(simulation.outcome[0, 3])
        places, estimate = simulation.gather("target")[..., :3], simulation.gather("estimate")
        seen = simulation.gather("visible").any(axis=1) & ~self.gone[:, None]
        camera = np.where(seen, simulation.gather("measured")[..., 7], -1.0).astype(np.int64)
        region = simulation.gather("region")
        missed = np.full(seen.shape, np.nan)
        if self._before is not None:
            p, v = self._before[..., ESTIMATE["p"]], self._before[..., ESTIMATE["v"]]
            missed = np.linalg.norm(p + (t_s - self._t_s[-1]) * v - places, axis=-1)
        self._t_s.append(t_s)
        self._rows.append((seen, places, region, camera, missed))
        self._before = estimate
        for j in range(simulation.network.n_agents):
            self._at_once = np.maximum(self._at_once, (region == j).sum(axis=1))

    def logs(self) -> list[TruthLog]:
        """Return the log of each environment."""
        t_s = np.array(self._t_s)
        seen, places, region, camera, missed = (np.array([row[i] for row in self._rows]) for i in range(5))
        counts = self._simulation.gather("count")
        return [
            TruthLog(
                t_s,
                seen[:, e],
                places[:, e],
                laps_of(region[:, e]),
                [g for m in range(seen.shape[2]) for g in _gaps(m, t_s, camera[:, e, m], missed[:, e, m])],
                self._use(e, counts[e]),
                region[:, e],
            )
            for e in range(seen.shape[1])
        ]

    def _use(self, e: int, count: Array) -> dict[str, float]:
        if self._simulation.network.n_agents == 0:
            return {}
        at_once = float(self._at_once[e])
        control = self._simulation.network.scenario.controller
        bounds = np.maximum([control.d_bar_mps, control.d_bar_radps], 1e-9)
        return {
            "one target in a region at a time": at_once if at_once > 1.0 else 0.0,
            "bound of the disturbance": float((np.sqrt(count[SLIP : SLIP + 2]) / bounds).max()),
            "agents stay in their regions": float(count[EXITS] > 0.0),
            "no collisions": float(count[COLLISIONS] > 0.0),
            "agents keep flying": float(self.gone[e]),
        }


def _gaps(target: int, t_s: Array, camera: IntArray, missed: Array) -> list[GapRecord]:
    """Return the gaps that ended, as `camnet.simulation.gaps.GapRecorder` has them."""
    sighted = np.flatnonzero(camera >= 0)
    ends = np.flatnonzero(np.diff(sighted) > 1)
    return [
        GapRecord(target, int(camera[i]), float(t_s[i + 1]), float(t_s[j]), float(missed[j]))
        for i, j in zip(sighted[ends].tolist(), sighted[ends + 1].tolist(), strict=True)
    ]

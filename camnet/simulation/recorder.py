"""Which quantities of a simulation are logged, and one row of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camnet.simulation.coordination import Task
from camnet.simulation.instruments import Instruments
from camnet.simulation.log import RunLog
from camnet.simulation.log_columns import columns_of
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.types import Array

__all__ = ["Recorder"]


class Recorder:
    """Appends one row of a simulation to a `RunLog`."""

    def __init__(self, simulation: NetworkSimulation) -> None:
        self._simulation = simulation
        self._uncertain = sorted({*simulation.network.own_poses, *simulation.network.exits})
        wanted = simulation.network.scenario.run.instruments
        self._instruments = Instruments(simulation) if wanted else None
        self.log = RunLog(columns_of(simulation.network.scenario, simulation.filter_names))

    def finish(self) -> None:
        """Fill in what is known only when the run is over."""
        if self._instruments is not None:
            self._instruments.finish(self.log)

    def record(self, setpoints: Setpoints, tasks: Sequence[Task]) -> None:
        """Log the present instant, with the setpoints and tasks just decided."""
        s = self._simulation
        parts: list[Array | list[float]] = [[s.snapshot.t_s]]
        for m in range(s.network.n_targets):
            parts += self._target(m)
        for j in range(s.network.n_agents):
            parts += self._agent(j, setpoints, tasks)
        self.log.append(np.concatenate(parts))

    def _target(self, m: int) -> list[Array | list[float]]:
        s, truth = self._simulation, self._simulation.snapshot
        parts: list[Array | list[float]] = [
            truth.target_p_world[m],
            truth.target_q_world[m],
            truth.target_v_world[m],
            [float(s.target_region[m]), float(s.seen_by(m)), float(s.trackers[m].lap), *self._certificate(m)],
        ]
        if m in s.sizes:
            parts.append([s.sizes[m].scale, s.sizes[m].sd])
        for name in s.filter_names:
            e = s.filters[name][m].estimate
            parts += [e.p_world, e.q_world, e.v_world, [e.radius_m]]
        if self._instruments is not None:
            parts.append(self._instruments.row(m))
        return parts

    def _certificate(self, m: int) -> list[float]:
        now = self._simulation.statistics.dwell[m].certificate(self._simulation.snapshot.t_s)
        known = [float("nan") if x is None else x for x in (now.time_left_s, now.margin_m)]
        return [*known, float(now.violations)]

    def _agent(self, j: int, setpoints: Setpoints, tasks: Sequence[Task]) -> list[Array | list[float]]:
        s, truth = self._simulation, self._simulation.snapshot
        return [
            truth.agent_p_world[j],
            truth.agent_q_world[j],
            truth.agent_v_world[j],
            truth.camera_p_world[j],
            truth.camera_q_world[j],
            setpoints.p_world[j],
            s.reference_p_world(j),
            [float(tasks[j].role)],
            *([self._own(j)] if j in self._uncertain else []),
        ]

    def _own(self, j: int) -> list[float]:
        s = self._simulation
        exits = 0.0 if s.exits is None or j not in s.exits.agents else s.exits.agents[j].outside_s
        x, y = s.believed_p_world[j, :2].tolist()
        if s.own is None:
            return [x, y, 0.0, 0.0, 0.0, 0.0, exits]
        own = s.own
        return [
            x,
            y,
            float(own.error_m[j]),
            own.spread_m(j),
            float(own.turn_rad[j]),
            float(own.lost[j]),
            exits,
        ]

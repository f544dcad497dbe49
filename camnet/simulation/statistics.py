"""What is counted while a simulation runs: view time, errors, dwell times, collisions, control."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from camnet.certification.monitor import DwellMonitor
from camnet.certification.network import DwellCertificates
from camnet.estimation.delayed import underlying
from camnet.estimation.protocol import Learns, TargetFilter
from camnet.simulation.metrics import ErrorRecord, delay_summary
from camnet.simulation.outages import OutageMonitor
from camnet.types import Snapshot
from camnet.world.protocol import Flown

if TYPE_CHECKING:
    from camnet.simulation.loop import NetworkSimulation

__all__ = ["RunStatistics"]


class RunStatistics:
    """Counters of one run; fed by the loop after every control and every sensing step.

    Parameters
    ----------
    simulation : the loop that feeds it
    certificates : dwell times that every interval is checked against
    """

    def __init__(self, simulation: NetworkSimulation, certificates: DwellCertificates) -> None:
        network = simulation.network
        targets = range(network.n_targets)
        self.errors = {name: [ErrorRecord() for _ in targets] for name in simulation.filter_names}
        self.dwell = [
            DwellMonitor(
                len(network.regions),
                certificates.published,
                certificates.sound,
                network.scenario.targets[m].name,
                network.scenario.certificate.off_max_s,
            )
            for m in targets
        ]
        self._driving = self.errors[simulation.filter_names[0]]
        self._learns = [_learner(f) for f in simulation.driving]
        self._certificate: tuple[float, dict[str, Any]] = (-math.inf, {})
        self.collisions: list[tuple[float, str, str]] = []
        self.region_exits = 0
        self.effort = 0.0
        self.least_distance_m = math.inf
        #: what becomes of agents' own poses, where any may be lost
        self.outages = OutageMonitor(network) if network.own_poses else None
        self._outside = np.zeros(network.n_agents, dtype=bool)
        self._must_stay = np.array([j not in network.exits for j in range(network.n_agents)], dtype=bool)
        self._touching: set[tuple[str, str]] = set()
        self._seen = self._senses = self._inside = self._decisions = 0
        # a fixed camera sees beyond its region
        self._has_fixed = len(network.cameras) > network.n_agents

    def after_control(self, simulation: NetworkSimulation) -> None:
        """Count collisions and exits (each once, when it starts), effort and distances between agents."""
        snapshot: Snapshot = simulation.snapshot
        self._touch(snapshot.t_s, snapshot.collisions)
        if simulation.network.n_agents:
            self.effort += simulation.control_dt_s * float(
                np.vdot(snapshot.agent_v_world, snapshot.agent_v_world)
            )

    def after_flight(self, simulation: NetworkSimulation, flown: Flown) -> None:
        """Do what `after_control` does, for several periods."""
        for t_s, pairs in flown.contacts:
            self._touch(t_s, pairs)
        if not flown.contacts:
            self._touch(simulation.snapshot.t_s, ())
        self.effort += simulation.control_dt_s * flown.square_m2ps2

    def _touch(self, t_s: float, pairs: tuple[tuple[str, str], ...]) -> None:
        """Count the collisions that begin now."""
        if pairs or self._touching:
            touching = set(pairs)
            self.collisions += [(t_s, a, b) for a, b in sorted(touching - self._touching)]
            self._touching = touching

    def after_sense(self, simulation: NetworkSimulation) -> None:
        """Record errors, view time and the switching signals of every target."""
        self._count_agents(simulation)
        for m, tracker in enumerate(simulation.trackers):
            camera = simulation.seen_by(m)
            seen = camera >= 0
            self._seen += seen
            self._senses += 1
            self._compare(simulation, m, tracker.lap, seen)
            self._watch(simulation, m, camera if seen else int(simulation.target_region[m]), seen)

    def after_decision(self, simulation: NetworkSimulation) -> None:
        """Count the targets that a camera could see at the end of a decision."""
        inside = simulation.target_region >= 0
        self._inside += len(inside) if self._has_fixed else int(np.count_nonzero(inside))
        self._decisions += len(inside)

    def _compare(self, simulation: NetworkSimulation, m: int, lap: int, seen: bool) -> None:
        """Record the errors of all estimators of target ``m``."""
        if simulation.perceived is not None:
            errors = simulation.perceived.errors[m]
            if errors is not None:
                self._driving[m].note(lap, seen, errors)
            return
        p_world, q_world = simulation.snapshot.target_p_world[m], simulation.snapshot.target_q_world[m]
        for name, records in self.errors.items():
            records[m].add(lap, seen, simulation.filters[name][m].estimate, p_world, q_world)

    def _watch(self, simulation: NetworkSimulation, m: int, region: int, seen: bool) -> None:
        """Record the switching signals of target ``m``."""
        dwell, t_s = self.dwell[m], simulation.snapshot.t_s
        excited = seen and _excited(self._learns[m], region)
        dwell.update(t_s, region, seen, excited, self._driving[m].latest_m)

    def _count_agents(self, simulation: NetworkSimulation) -> None:
        outside = simulation.agents_outside()
        if simulation.exits is not None:
            simulation.exits.watch(simulation.snapshot.t_s, outside)
            outside = outside & self._must_stay
        if self.outages is not None and simulation.own is not None:
            self.outages.watch(simulation.snapshot.t_s, simulation.own)
        if True in outside.tolist():
            self.region_exits += int(np.count_nonzero(outside & ~self._outside))
        self._outside = outside
        self.least_distance_m = min(self.least_distance_m, simulation.spacing_m)

    @property
    def time_in_view(self) -> float:
        """Share of target-seconds during which some camera saw the target."""
        return self._seen / max(self._senses, 1)

    def certificate(self, t_s: float) -> dict[str, Any]:
        """Return what ``sound`` and the stated dwell time certify now: the tightest of all targets, and each of them.

        ``time_left_s`` and ``margin_m`` are None while everybody is in view, or where nothing is certified. Asked again
        at the same instant, the same object is returned.
        """
        if self._certificate[0] != t_s:
            self._certificate = (t_s, self._certified(t_s))
        return self._certificate[1]

    def _certified(self, t_s: float) -> dict[str, Any]:
        now = {m.name: m.certificate(t_s) for m in self.dwell}
        return {
            "time_left_s": min(
                (c.time_left_s for c in now.values() if c.time_left_s is not None), default=None
            ),
            "margin_m": min((c.margin_m for c in now.values() if c.margin_m is not None), default=None),
            "violations": sum(c.violations for c in now.values()),
            "overdue": sum(m.overdue for m in self.dwell),
            "targets": {
                name: {"seen": c.seen, "time_left_s": c.time_left_s, "margin_m": c.margin_m}
                for name, c in now.items()
            },
        }

    def finish(self) -> None:
        """End the run: close the dwell intervals in progress."""
        for monitor in self.dwell:
            monitor.close()

    def episode(self, simulation: NetworkSimulation) -> dict[str, Any]:
        """Return the figures of an episode of the environment, ready for JSON (unknown ones are None)."""
        trackers = simulation.trackers
        delays = np.concatenate([t.delays_s() for t in trackers])
        driving = ErrorRecord.pooled(self.errors[simulation.filter_names[0]])
        return {
            "duration_s": simulation.snapshot.t_s,
            "time_in_view": self.time_in_view,
            "time_inside": self._inside / max(self._decisions, 1),
            "entries": sum(t.entries for t in trackers),
            "handoffs": {
                "attempted": sum(t.attempted for t in trackers),
                "completed": sum(t.completed for t in trackers),
            },
            "reacquisition_delay_s": delay_summary(delays),
            **driving.summary(),
            "collisions": len(self.collisions),
            "region_exits": self.region_exits,
            "control_effort_m2ps": self.effort,
            "least_agent_distance_m": self.least_distance_m if math.isfinite(self.least_distance_m) else None,
            "laps": [t.lap for t in trackers],
            "dwell_violations": sum(m.dwell_violations for m in self.dwell),
            "certificate_violations": sum(m.violations for m in self.dwell),
            "overdue": sum(m.overdue for m in self.dwell),
        }

    def baselines(self, simulation: NetworkSimulation) -> dict[str, Any]:
        """Error rows of the estimators that ran beside the driving one."""
        return {name: ErrorRecord.pooled(self.errors[name]).summary() for name in simulation.filter_names[1:]}


def _learner(filter_: TargetFilter) -> Learns | None:
    """Return what learns in a filter, if anything does."""
    inner = underlying(filter_)
    return inner if isinstance(inner, Learns) else None


def _excited(learner: Learns | None, camera: int) -> bool:
    """Whether the excited cases of the certificates are open in the region of ``camera``: a stack of full rank now.

    Excitation of the visited places alone opens none: no Lyapunov function of a part of the weights survives a change
    of the stack.
    """
    return learner is not None and math.isfinite(learner.excitation(camera)[0])

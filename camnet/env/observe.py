"""From a simulation to what each agent observes: estimates, never the truth (except the agent's own state).

`Observer.readable` says field by field what is shown; `Observer.observe` does the same in one compiled call.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.env.layout import Observation, ObservationLayout
from camnet.env.observe_kernel import SHOWN, Shown, write_observations
from camnet.env.settings import EnvSettings
from camnet.geometry.rotations import gaze_angles, rotate, yaw_of
from camnet.simulation.certificates import view_radius
from camnet.simulation.entries import Entry
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["Observer"]

_FORWARD = np.array([0.0, 0.0, 1.0])
_NOBODY = np.empty((0, 3))


class Observer:
    """Encodes observations of all agents of one network.

    Parameters
    ----------
    simulation : the running network
    settings : how it is shown
    """

    def __init__(self, simulation: NetworkSimulation, settings: EnvSettings) -> None:
        network = simulation.network
        self.settings = settings
        self.neighbours = min(settings.neighbours, network.n_agents - 1)
        self.layout = ObservationLayout(network.n_targets, self.neighbours)
        bounds = np.stack([region.bounds for region in network.regions])
        self.centers, self.half_sizes = bounds.mean(axis=1), np.ptp(bounds, axis=1) / 2
        corners = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
        self._network_center, self._network_half = corners.mean(axis=0), np.ptp(corners, axis=0) / 2
        self._speeds = np.array([target.v_max_mps for target in network.scenario.targets])
        self._view_radius = np.array([view_radius(network, j) for j in range(network.n_agents)])
        self._pack(network)

    def _pack(self, network: Network) -> None:
        """Lay out the constants of the compiled observation."""
        n = network.n_agents
        in_network = (self.centers[:n] - self._network_center) / self._network_half
        size = self.half_sizes[:n] / self._network_half
        self._agents = np.hstack(
            [self.centers[:n], self.half_sizes[:n], in_network, size, self._view_radius[:, None]]
        )
        self._scales = np.array(
            [
                network.scenario.controller.reference_v_max_mps,
                self.settings.gaze_max_rad,
                network.scenario.handoff.lookahead_s,
                self.settings.communication_range_m,
                0.0,
            ]
        )
        self._estimates = np.zeros((network.n_targets, 14))
        self._estimates[:, 13] = self._speeds
        self._entries = np.zeros((network.n_targets, n, 9))
        self._entries_of: list[list[Entry | None]] | None = None
        low, high = network.boxes
        self._pinned = SHOWN.pin(
            Shown(
                agents=self._agents,
                estimates=self._estimates,
                entries=self._entries,
                scales=self._scales,
                low=low,
                high=high,
                least=self.layout.low,
                most=self.layout.high,
                flat=np.empty(len(self.layout.low)),
                distance=np.empty(n),
                neighbours=self.neighbours,
            )
        )

    def observe(self, simulation: NetworkSimulation, entries: list[list[Entry | None]]) -> list[Observation]:
        """Observations of all N agents; ``entries[m][j]`` are the predicted entries."""
        truth, rows = simulation.snapshot, self._estimates
        for m, filter_ in enumerate(simulation.driving):
            e, row = filter_.estimate, rows[m]
            row[:3], row[3:6], row[6:10] = e.p_world, e.v_world, e.q_world
            row[10], row[11], row[12] = e.radius_m, e.last_seen_s, float(math.isfinite(e.last_seen_s))
        if entries is not self._entries_of:  # they are renewed less often than they are shown
            self._entries_of = entries
            self._pack_entries(entries)
        self._scales[4] = truth.t_s
        out = np.empty((len(self._agents), len(self.layout.low)), dtype=np.float32)
        write_observations(
            self._pinned.at,
            truth.camera_p_world,
            truth.camera_q_world,
            truth.camera_v_world,
            simulation.network.exceptions(rows[:, :3], _NOBODY),
            simulation.visible,
            out,
        )
        return list(out)

    def _pack_entries(self, entries: list[list[Entry | None]]) -> None:
        packed = self._entries
        packed[...] = 0.0
        for m, row in enumerate(entries):
            for j, entry in enumerate(row[: packed.shape[1]]):
                if entry is not None:
                    packed[m, j, 0] = 1.0 if entry.direct else 0.5
                    packed[m, j, 1:4], packed[m, j, 4:7] = entry.p_world, entry.v_world
                    packed[m, j, 7], packed[m, j, 8] = entry.t_s, entry.radius_m

    def readable(self, simulation: NetworkSimulation, entries: list[list[Entry | None]]) -> list[Observation]:
        """Do what `observe` does, one named field at a time."""
        return [self._agent(simulation, entries, j) for j in range(simulation.network.n_agents)]

    def _agent(self, simulation: NetworkSimulation, entries: list[list[Entry | None]], j: int) -> Observation:
        values = self._own(simulation, j)
        for m in range(simulation.network.n_targets):
            values |= {f"target_{m}.{name}": value for name, value in self._target(simulation, m, j).items()}
            entry = entries[m][j]
            if entry is not None:
                about = self._entry(simulation, entry, m, j)
                values |= {f"target_{m}.{name}": value for name, value in about.items()}
        values |= self._near(simulation, j)
        return self.layout.encode(values)

    def _own(self, simulation: NetworkSimulation, j: int) -> dict[str, float | Array]:
        truth = simulation.snapshot
        pan, tilt = gaze_angles(rotate(truth.camera_q_world[j], _FORWARD))
        return {
            "own.position": (truth.camera_p_world[j] - self.centers[j]) / self.half_sizes[j],
            "own.velocity": truth.camera_v_world[j]
            / simulation.network.scenario.controller.reference_v_max_mps,
            "own.gaze": np.array([pan, tilt]) / self.settings.gaze_max_rad,
            "own.region_center": (self.centers[j] - self._network_center) / self._network_half,
            "own.region_size": self.half_sizes[j] / self._network_half,
        }

    def _target(self, simulation: NetworkSimulation, m: int, j: int) -> dict[str, float | Array]:
        estimate = simulation.driving[m].estimate
        if not np.isfinite(estimate.last_seen_s):
            return {}
        lookahead = simulation.network.scenario.handoff.lookahead_s
        yaw = float(yaw_of(estimate.q_world))
        return {
            "known": 1.0,
            "position": (estimate.p_world - self.centers[j]) / self.half_sizes[j],
            "velocity": estimate.v_world / self._speeds[m],
            "heading": np.array([np.cos(yaw), np.sin(yaw)]),
            "radius": estimate.radius_m / self.half_sizes[j, :2].min(),
            "unseen_time": (simulation.snapshot.t_s - estimate.last_seen_s) / lookahead,
            "seen_by_me": float(simulation.visible[j, m]),
            "seen": float(simulation.visible[:, m].any()),
            "inside": float(simulation.network.regions[j].contains(estimate.p_world)),
        }

    def _entry(self, simulation: NetworkSimulation, entry: Entry, m: int, j: int) -> dict[str, float | Array]:
        lookahead = simulation.network.scenario.handoff.lookahead_s
        return {
            "coming": 1.0 if entry.direct else 0.5,
            "entry_position": (entry.p_world - self.centers[j]) / self.half_sizes[j],
            "entry_velocity": entry.v_world / self._speeds[m],
            "entry_time": (entry.t_s - simulation.snapshot.t_s) / lookahead,
            "entry_radius": entry.radius_m / self.half_sizes[j, :2].min(),
            "entry_margin": 1.0 - entry.radius_m / self._view_radius[j],
        }

    def _near(self, simulation: NetworkSimulation, j: int) -> dict[str, float | Array]:
        offsets = simulation.snapshot.camera_p_world[: simulation.network.n_agents]
        offsets = offsets - simulation.snapshot.camera_p_world[j]
        distance = np.linalg.norm(offsets, axis=1)
        distance[j] = np.inf
        values: dict[str, float | Array] = {}
        for k, other in enumerate(np.argsort(distance, kind="stable")[: self.neighbours]):
            if distance[other] <= self.settings.communication_range_m:
                values[f"neighbour_{k}.present"] = 1.0
                values[f"neighbour_{k}.position"] = offsets[other] / self.half_sizes[j]
        return values

"""What every agent believes at one instant: of the targets, of their entries into its region, of the other agents.

With perfect messages all agents share one belief; otherwise `camnet.env.messages` gives each its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.simulation.coordination import Task, assign
from camnet.simulation.entries import Entry
from camnet.simulation.loop import NetworkSimulation
from camnet.types import Array, BoolArray, TargetEstimate

__all__ = ["Beliefs", "shared_beliefs", "tasks"]


@dataclass(frozen=True, eq=False, slots=True)
class Beliefs:
    """Beliefs of N agents about M targets and about each other, all at time ``t_s``.

    Attributes
    ----------
    t_s : now, s
    p_world, v_world : (N,M,3) position, m, and velocity, m/s
    q_world : (N,M,4) orientation, body to world
    radius_m : (N,M) error radius
    last_seen_s : (N,M) when anybody saw the target, as far as the agent knows (-inf: never)
    region : (N,M) region whose model predicts (-1: none)
    seen : (N,M) whether some camera saw the target at the time of the agent's news of it
    seen_by_me : (N,M) whether the agent's own camera sees it now
    entries : ``entries[j][m]``, predicted entry of target m into agent j's region
    peers_p_world : (N,N,3) where agent j (first index) believes the others to be, m
    peers_known : (N,N) which of the others it has heard of; never itself
    """

    t_s: float
    own_p_world: Array
    p_world: Array
    v_world: Array
    q_world: Array
    radius_m: Array
    last_seen_s: Array
    region: Array
    seen: BoolArray
    seen_by_me: BoolArray
    entries: list[list[Entry | None]]
    peers_p_world: Array
    peers_known: BoolArray

    def estimates(self, j: int) -> list[TargetEstimate]:
        """Agent ``j``'s estimates of all targets."""
        return [
            TargetEstimate(
                t_s=self.t_s,
                p_world=self.p_world[j, m],
                q_world=self.q_world[j, m],
                v_world=self.v_world[j, m],
                w_body=np.zeros(3),
                seen=bool(self.seen[j, m]),
                last_seen_s=float(self.last_seen_s[j, m]),
                region=int(self.region[j, m]),
                radius_m=float(self.radius_m[j, m]),
            )
            for m in range(self.p_world.shape[1])
        ]


def shared_beliefs(simulation: NetworkSimulation, communication_range_m: float) -> Beliefs:
    """Return what all agents believe while messages arrive at once: the driving estimates, and everybody in range."""
    n, m = simulation.network.n_agents, simulation.network.n_targets
    estimates = [f.estimate for f in simulation.driving]
    seen = simulation.visible.any(axis=0)
    entries = simulation.entries()
    p_agents = simulation.snapshot.camera_p_world[:n]
    distance = np.linalg.norm(p_agents[:, None] - p_agents, axis=2)
    known = (distance <= communication_range_m) & simulation.working[:n]
    np.fill_diagonal(known, False)
    return Beliefs(
        t_s=simulation.snapshot.t_s,
        own_p_world=p_agents,
        p_world=_everybody([e.p_world for e in estimates], n),
        v_world=_everybody([e.v_world for e in estimates], n),
        q_world=_everybody([e.q_world for e in estimates], n),
        radius_m=_everybody([e.radius_m for e in estimates], n),
        last_seen_s=_everybody([e.last_seen_s for e in estimates], n),
        region=_everybody([float(e.region) for e in estimates], n),
        seen=np.broadcast_to(seen, (n, m)),
        seen_by_me=simulation.visible[:n],
        entries=[[row[j] for row in entries] for j in range(n)],
        peers_p_world=np.broadcast_to(p_agents, (n, n, 3)),
        peers_known=known,
    )


def _everybody(values: list[Array] | list[float], n: int) -> Array:
    """One value (...) per target as the belief (N,M,...) of all N agents."""
    array = np.array(values, dtype=float)
    return np.broadcast_to(array, (n, *array.shape))


def tasks(simulation: NetworkSimulation, beliefs: Beliefs) -> list[Task]:
    """Apply the handoff rule of the built-in system: every agent decides on its own beliefs."""
    network = simulation.network
    chosen = []
    for j in range(network.n_agents):
        inside = network.containment(beliefs.p_world[j])[:, [j]]
        inside &= np.isfinite(beliefs.last_seen_s[j])[:, None]
        entries = [[entry] for entry in beliefs.entries[j]]
        seen, limit = beliefs.seen_by_me[[j]], network.half_widths[[j]]
        chosen += assign(beliefs.estimates(j), entries, inside, seen, limit)
    return chosen

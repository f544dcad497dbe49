"""Where agents believe themselves to be: those without a lasting external pose fly, look and measure by an estimate.

The believed world is the true one turned by the heading's error and moved by the position's. A velocity that an agent
wants in its world becomes one in the true world by the opposite turn; what its camera sees is relative and stays as it
is. The inner loop holds the body's heading; what drifts is what the agent believes of it. Height and tilt are known.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from camnet.estimation.own_pose import draw_errors, own_model, start_own
from camnet.estimation.own_pose.sources import DRAWS, pack_sources, step_source
from camnet.sensing.own_pose_settings import PoseSource
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray, CameraMotion, PoseMeasurement, Snapshot

__all__ = ["OwnPoses", "OwnResiduals", "heading_of", "own_poses", "true_poses"]

#: believed poses kept for measurements that come late
_KEPT = 1024
_SAME_S = 1e-9


class OwnResiduals(NamedTuple):
    """True errors of what an agent knows: position, m, heading, rad, scale and gyro bias, rad/s, not learned."""

    position_m: float
    heading_rad: float
    scale: float
    gyro_bias_radps: float


class OwnPoses:
    """Believed poses of N agents, of which those in ``sources`` dead-reckon.

    Parameters
    ----------
    sources : pose sources by the agent's number; only such as may be lost
    n_agents : N
    dt_s : control period
    now : the truth at the start
    rng : source of all noise; every step draws the same count of numbers, whatever is lost
    """

    def __init__(
        self,
        sources: dict[int, PoseSource],
        n_agents: int,
        dt_s: float,
        now: Snapshot,
        rng: np.random.Generator,
    ) -> None:
        self.agents = tuple(sorted(sources))
        self.n_agents, self._dt, self._rng = n_agents, dt_s, rng
        chosen = [sources[j] for j in self.agents]
        count = len(self.agents)
        self._numbers, self._outages = pack_sources(chosen, dt_s)
        #: scale and gyro bias of this run (A,2)
        self.errors = np.array([draw_errors(source, rng) for source in chosen])
        #: filters' states (A,9) and covariances (A,9,9), see `camnet.estimation.own_pose.dead_reckoning`
        self.x, self.cov = np.zeros((count, 9)), np.zeros((count, 9, 9))
        #: which agents (N,) have no external pose now, and since when, s; who is beyond its region
        self.lost: BoolArray = np.zeros(n_agents, dtype=bool)
        self.lost_since_s = np.full(n_agents, math.nan)
        self.outside: BoolArray = np.zeros(n_agents, dtype=bool)
        #: errors (N,) of the believed position on the ground, m, and heading, rad
        self.error_m, self.turn_rad = np.zeros(n_agents), np.zeros(n_agents)
        self._past: deque[tuple[float, Array, Array, Array]] = deque(maxlen=_KEPT)
        draws, poses = rng.standard_normal((count, 3)), true_poses(now, self.agents)
        self._truth = np.column_stack([poses, poses[:, 2]])
        for a, source in enumerate(chosen):
            start_own(self.x[a], self.cov[a], own_model(source, dt_s), poses[a], draws[a])
            self.turn_rad[self.agents[a]] = math.remainder(self.x[a, 2] - poses[a, 2], 2.0 * math.pi)
        self._believe(now)

    def step(self, after: Snapshot) -> None:
        """Take one control period."""
        poses = true_poses(after, self.agents)
        draws = self._rng.standard_normal((len(self.agents), DRAWS))
        for a, j in enumerate(self.agents):
            self.turn_rad[j], lost = step_source(
                self.x[a],
                self.cov[a],
                self._truth[a],
                self.errors[a],
                self._numbers[a],
                self._outages,
                a,
                poses[a],
                draws[a],
                bool(self.outside[j]),
                after.t_s,
                self._dt,
            )
            if lost != self.lost[j]:
                self.lost_since_s[j] = after.t_s if lost else math.nan
                self.lost[j] = lost
        self._believe(after)

    def _believe(self, now: Snapshot) -> None:
        """Place the cameras in the agents' worlds."""
        self.p_world, self.q_world = now.camera_p_world.copy(), now.camera_q_world.copy()
        for a, j in enumerate(self.agents):
            x, y = self.x[a, 0], self.x[a, 1]
            self.error_m[j] = math.hypot(x - self.p_world[j, 0], y - self.p_world[j, 1])
            self.p_world[j, 0], self.p_world[j, 1] = x, y
            half = 0.5 * float(self.turn_rad[j])
            c, s = math.cos(half), math.sin(half)
            q0, q1, q2, q3 = self.q_world[j].tolist()
            self.q_world[j] = c * q0 - s * q3, c * q1 - s * q2, c * q2 + s * q1, c * q3 + s * q0

    def report(
        self, t_s: float, outside: BoolArray, measurements: list[PoseMeasurement]
    ) -> list[PoseMeasurement]:
        """Return measurements as their agents report them at ``t_s``, when images are taken.

        ``outside`` (N,) are the agents beyond their regions, where they have no external pose.
        """
        self._past.append((t_s, self.p_world, self.q_world, self.turn_rad.copy()))
        self.outside[:] = outside
        return [self.as_believed(z) for z in measurements]

    def residuals(self, j: int) -> OwnResiduals:
        """Return the true errors of agent ``j`` now."""
        a = self.agents.index(j)
        scale = (1.0 + float(self.errors[a, 0])) / (1.0 + float(self.x[a, 3])) - 1.0
        bias = float(self.errors[a, 1] - self.x[a, 4])
        return OwnResiduals(float(self.error_m[j]), float(self.turn_rad[j]), scale, bias)

    def turned_back(self, vectors: Array) -> Array:
        """Turn vectors (N,3) from the agents' worlds into the true one."""
        out = vectors.copy()
        for j in self.agents:
            c, s = math.cos(self.turn_rad[j]), math.sin(self.turn_rad[j])
            x, y = vectors[j, 0], vectors[j, 1]
            out[j, 0], out[j, 1] = c * x + s * y, c * y - s * x
        return out

    def pose_cov(self, j: int) -> Array | None:
        """Covariance (3,3) of x and y, m, and heading, rad, of agent ``j``; None: its pose is known."""
        return self.cov[self.agents.index(j)][:3, :3].copy() if j in self.agents else None

    def spread_m(self, j: int) -> float:
        """Return the standard deviation of the worst direction of agent ``j``'s position, m; 0: known."""
        cov = self.pose_cov(j)
        return 0.0 if cov is None else math.sqrt(float(np.linalg.eigvalsh(cov[:2, :2])[-1]))

    def as_believed(self, z: PoseMeasurement) -> PoseMeasurement:
        """Return a measurement as its agent reports it: by the pose that it believed in when the image was taken."""
        cov = self.pose_cov(z.camera)
        if cov is None:
            return z
        known = (past for past in reversed(self._past) if past[0] <= z.t_s + _SAME_S)
        _, p_world, q_world, turn = next(known, self._past[0])
        c, s = math.cos(turn[z.camera]), math.sin(turn[z.camera])
        vx, vy, vz = z.motion.v_world.tolist()
        v_world = np.array([c * vx - s * vy, s * vx + c * vy, vz])
        motion = CameraMotion(
            p_world[z.camera].copy(), q_world[z.camera].copy(), v_world, z.motion.w_cam, cov
        )
        return replace(z, motion=motion)


def own_poses(network: Network, dt_s: float, now: Snapshot, rng: np.random.Generator) -> OwnPoses | None:
    """Return the believed poses of a network's agents; None where all of them know theirs."""
    sources = network.own_poses
    return OwnPoses(sources, network.n_agents, dt_s, now, rng) if sources else None


def heading_of(q_world: Array) -> float:
    """Heading of a body, rad, from its orientation (4,)."""
    w, x, y, z = q_world.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def true_poses(now: Snapshot, agents: tuple[int, ...]) -> Array:
    """Return x and y of the agents' cameras, m, and headings of their bodies, rad, (A,3)."""
    p, q = now.camera_p_world, now.agent_q_world
    return np.array([[p[j, 0], p[j, 1], heading_of(q[j])] for j in agents])

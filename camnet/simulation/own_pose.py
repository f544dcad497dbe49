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

from camnet.estimation.own_pose import (
    OwnErrors,
    OwnModel,
    advance_own,
    draw_errors,
    fix_own,
    own_model,
    start_own,
)
from camnet.geometry.rotations import multiply
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array, BoolArray, CameraMotion, PoseMeasurement, Snapshot

__all__ = ["OwnPoses", "OwnResiduals", "PoseNoise", "heading_of", "true_poses"]

#: believed poses kept for measurements that come late
_KEPT = 1024
_SAME_S = 1e-9
#: times within this share of a period of a fix or image count as on it
_EARLY = 1e-6


class PoseNoise(NamedTuple):
    """One agent's model, the errors of its velocity source in this run, and how often fixes and images come."""

    model: OwnModel
    errors: OwnErrors
    source: PoseSource


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
        self.noise = [
            PoseNoise(own_model(sources[j], dt_s), draw_errors(sources[j], rng), sources[j])
            for j in self.agents
        ]
        count = len(self.agents)
        #: filters' states (A,9) and covariances (A,9,9), see `camnet.estimation.own_pose.dead_reckoning`
        self.x, self.cov = np.zeros((count, 9)), np.zeros((count, 9, 9))
        #: which agents (N,) have no external pose now, and since when, s
        self.lost: BoolArray = np.zeros(n_agents, dtype=bool)
        self.lost_since_s = np.full(n_agents, math.nan)
        #: errors (N,) of the believed position on the ground, m, and heading, rad
        self.error_m, self.turn_rad = np.zeros(n_agents), np.zeros(n_agents)
        self._image_heading = np.zeros(count)
        self._past: deque[tuple[float, Array, Array, Array]] = deque(maxlen=_KEPT)
        draws, truth = rng.standard_normal((count, 3)), true_poses(now, self.agents)
        for a in range(count):
            start_own(self.x[a], self.cov[a], self.noise[a].model, truth[a], draws[a])
            self._image_heading[a] = truth[a, 2]
        self._truth = truth
        self._believe(now, truth)

    def step(self, after: Snapshot, outside: BoolArray) -> None:
        """Take one control period; ``outside`` (N,): agents beyond their regions, where there is no external pose."""
        was, now = self._truth, true_poses(after, self.agents)
        self._truth = now
        draws = self._rng.standard_normal((len(self.agents), 7))
        for a, j in enumerate(self.agents):
            model, errors, source = self.noise[a]
            turn = math.nan
            if source.source == "key_frames" and _ticks(after.t_s, self._dt, 1.0 / source.visual.every_s):
                since = math.remainder(now[a, 2] - self._image_heading[a], 2.0 * math.pi)
                turn = since + model.turn_sd * draws[a, 3]
                self._image_heading[a] = now[a, 2]
            advance_own(self.x[a], self.cov[a], model, errors, was[a], now[a], self._dt, draws[a, :3], turn)
            lost = source.lost_at(after.t_s) or bool(outside[j])
            if lost != self.lost[j]:
                self.lost_since_s[j] = after.t_s if lost else math.nan
            self.lost[j] = lost
            if not lost and _ticks(after.t_s, self._dt, source.fixes.rate_hz):
                fix_own(self.x[a], self.cov[a], model, now[a], draws[a, 4:])
        self._believe(after, now)

    def _believe(self, now: Snapshot, truth: Array) -> None:
        """Place the cameras in the agents' worlds."""
        self.p_world, self.q_world = now.camera_p_world.copy(), now.camera_q_world.copy()
        for a, j in enumerate(self.agents):
            self.turn_rad[j] = math.remainder(self.x[a, 2] - truth[a, 2], 2.0 * math.pi)
            self.error_m[j] = math.hypot(*(self.x[a, :2] - truth[a, :2]).tolist())
            self.p_world[j, :2] = self.x[a, :2]
            half = 0.5 * self.turn_rad[j]
            self.q_world[j] = multiply(np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), self.q_world[j])
        self._past.append((now.t_s, self.p_world, self.q_world, self.turn_rad.copy()))

    def residuals(self, j: int) -> OwnResiduals:
        """Return the true errors of agent ``j`` now."""
        a = self.agents.index(j)
        _, errors, _ = self.noise[a]
        scale = (1.0 + errors.scale) / (1.0 + float(self.x[a, 3])) - 1.0
        bias = errors.gyro_bias - float(self.x[a, 4])
        return OwnResiduals(float(self.error_m[j]), float(self.turn_rad[j]), scale, bias)

    def turned_back(self, vectors: Array) -> Array:
        """Turn vectors (N,3) from the agents' worlds into the true one."""
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = vectors[:, 0], vectors[:, 1]
        return np.column_stack([c * x + s * y, c * y - s * x, vectors[:, 2]])

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


def heading_of(q_world: Array) -> float:
    """Heading of a body, rad, from its orientation (4,)."""
    w, x, y, z = q_world.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def true_poses(now: Snapshot, agents: tuple[int, ...]) -> Array:
    """Return x and y of the agents' cameras, m, and headings of their bodies, rad, (A,3)."""
    p, q = now.camera_p_world, now.agent_q_world
    return np.array([[p[j, 0], p[j, 1], heading_of(q[j])] for j in agents])


def _ticks(t_s: float, dt_s: float, rate_hz: float) -> bool:
    """Whether a clock of ``rate_hz`` ticks in the period that ends at ``t_s``."""
    return math.floor(t_s * rate_hz + _EARLY) > math.floor((t_s - dt_s) * rate_hz + _EARLY)

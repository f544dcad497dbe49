"""Targets that follow a plan in place of chance: where they start, how they turn, how fast they drive, when they stop.

They keep to the class of the motion that they replace: the same roads or the same field, the same bounds.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from camnet.errors import ConfigError
from camnet.motion.fields import LoopField, WaveField
from camnet.motion.protocol import TargetState, planar_state
from camnet.motion.road import Ahead, RoadMotion
from camnet.motion.vector_field import VectorFieldMotion
from camnet.types import Array, Twist

__all__ = ["SPEED_LAG_S", "DrivePlan", "PlannedField", "PlannedRoad"]

#: time constant with which a driver takes up another speed, s
SPEED_LAG_S = 1.0


@dataclass(frozen=True, slots=True)
class DrivePlan:
    """What one target does; all shares are in [0, 1].

    Attributes
    ----------
    start : share of the start road, or of the path
    forward : whether it starts along the road
    lateral : share of the widest offset to the left, -1 to 1
    turns : draws in [0, 1), one for each junction, from the first again after the last
    speeds : share of the speed interval in each piece of the time, from the first again after the last
    piece_s : length of such a piece, s
    stop_at_s, stop_s : when it stops, and for how long, s
    pace : on fields, which leave no choice of speed: speed at the share 1, over the field's own (1: as the field says)
    """

    start: float
    forward: bool = True
    lateral: float = 0.0
    turns: tuple[float, ...] = (0.0,)
    speeds: tuple[float, ...] = (0.0,)
    piece_s: float = 10.0
    stop_at_s: float = 0.0
    stop_s: float = 0.0
    pace: float = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class _Turns:
    """The draws of a plan in the place of a generator's."""

    turns: tuple[float, ...]
    taken: list[int]

    def random(self) -> float:
        """Return the next draw."""
        k = self.taken[0]
        self.taken[0] = k + 1
        return self.turns[k % len(self.turns)]


@dataclass(frozen=True, eq=False, slots=True)
class PlannedRoad:
    """A road-bound vehicle with a plan; ``internal`` holds heading, the point ahead, its speed, and turns taken.

    Attributes
    ----------
    road : the motion whose roads, bounds and steering it has
    plan : what it does
    widest_m : offset across the road at ``plan.lateral`` = 1
    """

    road: RoadMotion
    plan: DrivePlan
    widest_m: float

    @property
    def v_max_mps(self) -> float:
        """Bound on the linear speed, m/s."""
        return self.road.v_max_mps

    @property
    def w_max_radps(self) -> float:
        """Bound on the angular speed, rad/s."""
        return self.road.w_max_radps

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Return the state at time 0, on the centre line and along it."""
        road, plan = self.road, self.plan
        line = road.network.lines[road.start_road]
        arc = plan.start * line.length_m if road.start_arc_m is None else road.start_arc_m
        x, y, along = line.at(arc)
        forward = plan.forward if road.start_arc_m is None else True
        if road.start_heading_rad is not None:
            forward = math.cos(road.start_heading_rad - along) >= 0.0
        theta = along if forward else along + math.pi
        v = self._wanted(0.0)
        internal = (theta, float(road.start_road), float(forward), arc, v, 0.0)
        return planar_state(x, y, 0.0, theta, v, 0.0, internal)

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Advance by the midpoint rule."""
        x, y, _ = state.p_world.tolist()
        theta, road, forward, arc, v, taken = state.internal.tolist()
        stands = self.plan.stop_at_s <= t_s < self.plan.stop_at_s + self.plan.stop_s
        v += (1.0 - math.exp(-dt_s / SPEED_LAG_S)) * (self._wanted(t_s) - v)
        if stands:
            return planar_state(x, y, 0.0, theta, 0.0, 0.0, (theta, road, forward, arc, v, taken))
        turns = _Turns(self.plan.turns, [int(taken)])
        start = Ahead(int(road), forward > 0.0, arc)
        ahead, goal_x, goal_y = self.road.lead(start, x, y, self.plan.lateral * self.widest_m, turns)
        w = self.road.turn(v, math.remainder(math.atan2(goal_y - y, goal_x - x) - theta, 2.0 * math.pi))
        middle = theta + 0.5 * dt_s * w
        x, y, theta = x + dt_s * v * math.cos(middle), y + dt_s * v * math.sin(middle), theta + dt_s * w
        internal = (theta, float(ahead.road), float(ahead.forward), ahead.arc_m, v, float(turns.taken[0]))
        return planar_state(x, y, 0.0, theta, v, w, internal)

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return None: the plan decides, not the pose."""
        return None

    def _wanted(self, t_s: float) -> float:
        slow, fast = self.road.speed_mps
        speeds = self.plan.speeds
        return slow + (fast - slow) * speeds[int(t_s / self.plan.piece_s) % len(speeds)]


@dataclass(frozen=True, eq=False, slots=True)
class PlannedField:
    """A robot along its field that starts where the plan says, beside its path by up to ``widest_m``.

    Attributes
    ----------
    field : the motion whose field and bounds it has
    plan : what it does
    widest_m : offset at the start at ``plan.lateral`` = 1
    paced : the motion in each piece of the time; all are ``field`` unless ``plan.pace`` lets it be faster or slower
    """

    field: VectorFieldMotion
    plan: DrivePlan
    widest_m: float
    paced: tuple[VectorFieldMotion, ...] = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        paces = [1.0 + (self.plan.pace - 1.0) * share for share in self.plan.speeds]
        object.__setattr__(self, "paced", tuple(_at_pace(self.field, pace) for pace in paces))

    @property
    def v_max_mps(self) -> float:
        """Bound on the linear speed, m/s."""
        return self.field.v_max_mps

    @property
    def w_max_radps(self) -> float:
        """Bound on the angular speed, rad/s."""
        return self.field.w_max_radps

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Return the state at time 0, heading as the field wants."""
        points = self.field.start_points
        k = min(int(self.plan.start * len(points)), len(points) - 1)
        x, y = points[k].tolist()
        theta = self.field.field.guide(x, y).direction
        off = self.plan.lateral * self.widest_m
        x, y = x - off * math.sin(theta), y + off * math.cos(theta)
        theta = self.field.field.guide(x, y).direction
        v, w = self.field.command(x, y, theta)
        return planar_state(x, y, 0.0, theta, v, w, (theta, v, w))

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Advance as the field's robot does at the pace of this piece of the time."""
        return self.paced[self._piece(t_s)].step(state, t_s, dt_s, rng)

    def poses(self, dt_s: float, count: int) -> Array:
        """Return the pose at time 0 and ``count`` poses ahead, as `step` makes them: (count + 1, 7), p and q."""
        state = self.reset(np.random.default_rng(0))
        rows = [np.concatenate([state.p_world, state.q_world])[None]]
        k = 0
        while k < count:
            piece = self._piece(k * dt_s)
            last = k + 1
            while last < count and self._piece(last * dt_s) == piece:
                last += 1
            ahead = self.paced[piece].states_ahead(state, dt_s, last - k)
            rows.append(ahead[:, :7])
            (x, y, z), (theta, v, w) = ahead[-1, :3].tolist(), ahead[-1, 13:16].tolist()
            state, k = planar_state(x, y, z, theta, v, w, (theta, v, w)), last
        return np.concatenate(rows)

    def _piece(self, t_s: float) -> int:
        return int(t_s / self.plan.piece_s) % len(self.paced)

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return the velocity that the robot has at a pose."""
        return self.field.velocity(p_world, q_world, t_s)


def _at_pace(motion: VectorFieldMotion, pace: float) -> VectorFieldMotion:
    """Return the robot at another speed along the same field."""
    field = motion.field
    if pace == 1.0:
        return motion
    if not isinstance(field, LoopField | WaveField):
        raise ConfigError(f"a field {type(field).__name__} has no speed that a plan could change")
    return dataclasses.replace(motion, field=dataclasses.replace(field, speed_mps=pace * field.speed_mps))

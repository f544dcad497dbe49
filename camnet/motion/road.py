"""A vehicle bound to a road network that turns at random at junctions (the targets of parikh2018, experiment 2).

A point runs ahead along the roads on a leash of length L; the vehicle pursues it along circular arcs,
``w = 2 v sin(alpha) / L`` with alpha the bearing of the point. Corners are thereby rounded, and as L >= 2 v / w_max the
turn rate never exceeds its bound. The speed wanders smoothly in its range: ``v = mean + half range x tanh(y)`` with y
an Ornstein-Uhlenbeck process passed through a first-order filter, so that v is continuously differentiable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from camnet.motion.protocol import TargetState, planar_state
from camnet.motion.road_network import RoadNetwork
from camnet.types import Array, Twist

__all__ = ["Ahead", "Draws", "RoadMotion"]

#: correlation time of speed and lateral offset, s
_WANDER_S = 10.0
#: times that the point ahead is moved to restore the leash in one step
_LEASH_STEPS = 4


class Draws(Protocol):
    """Where turns come from: a generator, or a plan."""

    def random(self) -> float:
        """Return the next draw in [0, 1)."""
        ...


@dataclass(frozen=True, slots=True)
class Ahead:
    """The point that runs ahead: road, direction on it, arc length."""

    road: int
    forward: bool
    arc_m: float


@dataclass(frozen=True, eq=False, slots=True)
class RoadMotion:
    """The vehicle; ``internal`` holds heading, the point ahead (road, direction, arc) and four wander states.

    Attributes
    ----------
    network : the roads
    speed_mps : slowest and fastest
    v_max_mps, w_max_radps : bounds
    leash_m : L
    lateral_std_m : standard deviation of the wander across the road
    start_road : index of the road to start on
    start_arc_m : where on it; drawn if None
    start_heading_rad : decides the direction along the road; drawn if None and the arc is drawn
    """

    network: RoadNetwork
    speed_mps: tuple[float, float]
    v_max_mps: float
    w_max_radps: float
    leash_m: float
    lateral_std_m: float
    start_road: int
    start_arc_m: float | None
    start_heading_rad: float | None

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Return the state at time 0, on the centre line and along it."""
        line = self.network.lines[self.start_road]
        drawn_arc, drawn_way = rng.uniform(0.0, line.length_m), bool(rng.integers(2))
        arc = drawn_arc if self.start_arc_m is None else self.start_arc_m
        x, y, along = line.at(arc)
        if self.start_heading_rad is not None:
            forward = math.cos(self.start_heading_rad - along) >= 0.0
        else:
            forward = drawn_way or self.start_arc_m is not None
        theta = along if forward else along + math.pi
        wander = rng.standard_normal(2) * math.sqrt(0.5)
        internal = (
            theta,
            float(self.start_road),
            float(forward),
            arc,
            wander[0],
            wander[0],
            wander[1],
            wander[1],
        )
        return planar_state(x, y, 0.0, theta, self._speed(wander[0]), 0.0, internal)

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Advance by the midpoint rule."""
        x, y, _ = state.p_world.tolist()
        theta, road, forward, arc, *wander = state.internal.tolist()
        rough_v, smooth_v, rough_d, smooth_d = _wandered(wander, dt_s, rng)
        v = self._speed(smooth_v)
        offset = self.lateral_std_m * math.sqrt(2.0) * smooth_d
        ahead, goal_x, goal_y = self.lead(Ahead(int(road), forward > 0.0, arc), x, y, offset, rng)
        bearing = math.remainder(math.atan2(goal_y - y, goal_x - x) - theta, 2.0 * math.pi)
        w = self.turn(v, bearing)
        theta_mid = theta + 0.5 * dt_s * w
        x += dt_s * v * math.cos(theta_mid)
        y += dt_s * v * math.sin(theta_mid)
        theta += dt_s * w
        internal = (
            theta,
            float(ahead.road),
            float(ahead.forward),
            ahead.arc_m,
            rough_v,
            smooth_v,
            rough_d,
            smooth_d,
        )
        return planar_state(x, y, 0.0, theta, v, w, internal)

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return None: speed and turns are drawn."""
        return None

    def _speed(self, wander: float) -> float:
        slow, fast = self.speed_mps
        return 0.5 * (slow + fast) + 0.5 * (fast - slow) * math.tanh(math.sqrt(2.0) * wander)

    def turn(self, v: float, bearing: float) -> float:
        """Return the turn rate at speed ``v`` towards a point at ``bearing``, rad/s."""
        if abs(bearing) > 0.5 * math.pi:  # behind: turn as sharply as allowed
            return math.copysign(self.w_max_radps, bearing)
        return 2.0 * v * math.sin(bearing) / self.leash_m

    def lead(self, ahead: Ahead, x: float, y: float, offset: float, rng: Draws) -> tuple[Ahead, float, float]:
        """Move the point ahead until the leash is taut; return it and where it is."""
        for _ in range(_LEASH_STEPS):
            goal_x, goal_y = self._place(ahead, offset)
            slack = self.leash_m - math.hypot(goal_x - x, goal_y - y)
            if slack <= 1e-9:
                break
            ahead = self._advance(ahead, slack, rng)
        return ahead, *self._place(ahead, offset)

    def _place(self, ahead: Ahead, offset: float) -> tuple[float, float]:
        x, y, along = self.network.lines[ahead.road].at(ahead.arc_m)
        side = offset if ahead.forward else -offset
        return x - side * math.sin(along), y + side * math.cos(along)

    def _advance(self, ahead: Ahead, distance_m: float, rng: Draws) -> Ahead:
        road, forward, arc = ahead.road, ahead.forward, ahead.arc_m
        while True:
            length = self.network.lines[road].length_m
            left = length - arc if forward else arc
            if distance_m < left:
                return Ahead(road, forward, arc + distance_m if forward else arc - distance_m)
            distance_m -= left
            road, forward = self.network.after(road, forward, rng.random())
            arc = 0.0 if forward else self.network.lines[road].length_m


def _wandered(
    wander: list[float], dt_s: float, rng: np.random.Generator
) -> tuple[float, float, float, float]:
    """Advance two Ornstein-Uhlenbeck processes of unit variance and their first-order filters."""
    rough_v, smooth_v, rough_d, smooth_d = wander
    keep = math.exp(-dt_s / _WANDER_S)
    kick = math.sqrt(1.0 - keep * keep)
    smooth_v += (1.0 - keep) * (rough_v - smooth_v)
    smooth_d += (1.0 - keep) * (rough_d - smooth_d)
    rough_v = keep * rough_v + kick * float(rng.standard_normal())
    rough_d = keep * rough_d + kick * float(rng.standard_normal())
    return rough_v, smooth_v, rough_d, smooth_d

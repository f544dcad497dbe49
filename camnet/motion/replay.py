"""A recorded track, replayed: positions by monotone cubic interpolation (Fritsch and Carlson 1980), C1 in time.

Monotone pieces do not overshoot, so a person who stands still between two fixes stands still here too. The heading is
the record's where it has one, else the direction of travel, held while that is slower than noise would turn it; its
rate is bounded. Before the first fix and after the last the target stands.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from camnet.motion.protocol import TargetState, planar_state
from camnet.motion.track import Track
from camnet.types import Array, Twist

__all__ = ["ReplayMotion", "TrackPath"]

#: points of a piece at which the largest speed is sought; the speed's square is a quartic there
_SPEED_SAMPLES = 65


@dataclass(frozen=True, eq=False, slots=True)
class TrackPath:
    """Position as a continuously differentiable function of time.

    Attributes
    ----------
    knots_s : times of the fixes
    coefficients : (n-1, 4, 3) of x, y, z in each piece, highest power first, about the piece's first fix
    headings : recorded headings without jumps, or None
    still : (3,) the only position, used where there is one fix
    """

    knots_s: list[float]
    coefficients: Array
    headings: Array | None
    still: Array

    @classmethod
    def of(cls, track: Track) -> TrackPath:
        """Interpolate a track."""
        headings = None if track.heading_rad is None else np.unwrap(track.heading_rad)
        coefficients = np.empty((0, 4, 3))
        if track.t_s.size > 1:
            coefficients = np.ascontiguousarray(
                PchipInterpolator(track.t_s, track.p_world).c.transpose(1, 0, 2)
            )
        return cls(track.t_s.tolist(), coefficients, headings, track.p_world[-1])

    def at(self, t_s: float) -> tuple[Array, Array]:
        """Return position and velocity (3,), (3,) at a time of the record."""
        knots = self.knots_s
        if len(knots) == 1:
            return self.still, np.zeros(3)
        clamped = min(max(t_s, knots[0]), knots[-1])
        k = min(max(bisect_right(knots, clamped) - 1, 0), len(knots) - 2)
        a, b, c, d = self.coefficients[k]
        h = clamped - knots[k]
        moving = knots[0] <= t_s < knots[-1]
        return ((a * h + b) * h + c) * h + d, (3.0 * a * h + 2.0 * b) * h + c if moving else np.zeros(3)

    def heading(self, t_s: float) -> float | None:
        """Return the recorded heading at a time of the record, rad."""
        return None if self.headings is None else float(np.interp(t_s, self.knots_s, self.headings))

    def speeds(self) -> Array:
        """Return horizontal speeds (n-1, m) all along the pieces, m/s."""
        h = np.diff(self.knots_s)[:, None, None] * np.linspace(0.0, 1.0, _SPEED_SAMPLES)[:, None]
        a, b, c = (self.coefficients[:, None, k] for k in range(3))
        velocity = (3.0 * a * h + 2.0 * b) * h + c
        return np.asarray(np.linalg.norm(velocity[..., :2], axis=-1))

    def first_direction(self, min_speed_mps: float, from_s: float) -> float:
        """Return the direction of travel when the target first moves after ``from_s``, rad; 0 if it never does."""
        for k, end in enumerate(self.knots_s[1:]):
            if end <= from_s:
                continue
            begin = max(self.knots_s[k], from_s)
            for t in np.linspace(begin, end, _SPEED_SAMPLES)[:-1].tolist():
                _, v = self.at(t)
                if math.hypot(v[0], v[1]) > min_speed_mps:
                    return math.atan2(v[1], v[0])
        return 0.0


@dataclass(frozen=True, eq=False, slots=True)
class ReplayMotion:
    """A replayed track; ``internal`` holds the heading (not wrapped).

    Attributes
    ----------
    path : the interpolated track
    begin_s : time of the record at the simulation's time 0
    min_speed_mps : below this the heading is held
    v_max_mps, w_max_radps : bounds
    start_heading_rad : heading at time 0; None takes the record's, or the first direction of travel
    """

    path: TrackPath
    begin_s: float
    min_speed_mps: float
    v_max_mps: float
    w_max_radps: float
    start_heading_rad: float | None = None

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Return the state at time 0."""
        theta = self.start_heading_rad
        if theta is None:
            theta = self.path.heading(self.begin_s)
        if theta is None:
            theta = self.path.first_direction(self.min_speed_mps, self.begin_s)
        return self._state(0.0, theta, 0.0)

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Return the record's state at ``t_s + dt_s``, turning there from the present heading."""
        theta = float(state.internal[0])
        goal = self._goal(t_s + dt_s)
        if goal is None:
            return self._state(t_s + dt_s, theta, 0.0)
        w = math.remainder(goal - theta, 2.0 * math.pi) / dt_s
        w = min(max(w, -self.w_max_radps), self.w_max_radps)
        return self._state(t_s + dt_s, theta + w * dt_s, w)

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return None: a record is a function of time."""
        return None

    def _goal(self, t_s: float) -> float | None:
        """Heading to turn to, or None to hold."""
        recorded = self.path.heading(self.begin_s + t_s)
        if recorded is not None:
            return recorded
        _, v = self.path.at(self.begin_s + t_s)
        return math.atan2(v[1], v[0]) if math.hypot(v[0], v[1]) > self.min_speed_mps else None

    def _state(self, t_s: float, theta: float, w: float) -> TargetState:
        p, v = self.path.at(self.begin_s + t_s)
        upright = planar_state(p[0], p[1], p[2], theta, 0.0, w, (theta,))
        return TargetState(upright.p_world, upright.q_world, v, upright.w_body, upright.internal)

"""Remedy 4 of the gap problem in the closed loop: where, and when, earlier crossings like this one came out.

| symbol | name | unit |
| --- | --- | --- |
| x, v | position and velocity at the exit | m, m/s |
| T, y, u | time a lesson took, position and velocity at its entry | s, m, m/s |
| d^2 = norm(x - x_j)^2 / s_x^2 + norm(v - v_j)^2 / s_v^2 | distance from lesson j, of the same region | - |

The nearest lessons vote with ``exp(-d^2 / 2)``, first for the camera of the entry, then those for that camera for T, y
and u (means). Between exit and entry the path is the cubic through both ends and their velocities; then straight on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.estimation.gap import hermite
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.observation import measured_world_pose
from camnet.estimation.protocol import Rollout
from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["ExperienceFilter", "LessonBook", "Lessons"]

#: number of lessons that vote
NEIGHBOURS = 5
#: difference of velocities that counts 1, as a share of the exit speed
VELOCITY_SHARE = 0.5
#: share of a new squared error in a record
RECORD_SHARE = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class Lessons:
    """One crossing, or what several say together; positions and velocities (3,), in the world.

    Attributes
    ----------
    region : that of the exit
    exit_p, exit_v : position and velocity there
    duration_s : from exit to entry
    entry_p, entry_v : position and velocity at the re-sighting
    to_region : that of the re-sighting
    """

    region: int
    exit_p: Array
    exit_v: Array
    duration_s: float
    entry_p: Array
    entry_v: Array
    to_region: int


class LessonBook:
    """Crossings of all targets that share it.

    Parameters
    ----------
    scale_m : difference of exit positions that counts 1
    """

    def __init__(self, scale_m: float) -> None:
        self._scale = scale_m
        self._lessons: list[Lessons] = []

    def add(self, lesson: Lessons) -> None:
        """Learn a crossing."""
        self._lessons.append(lesson)

    def consult(self, region: int, p: Array, v: Array) -> Lessons | None:
        """Return what the nearest lessons of ``region`` say of an exit at p (3,) with v (3,); None without any."""
        alike = [lesson for lesson in self._lessons if lesson.region == region]
        if not alike:
            return None
        speed = max(float(np.linalg.norm(v)), 1e-6)
        d2 = np.array(
            [
                ((p - k.exit_p) @ (p - k.exit_p)) / self._scale**2
                + ((v - k.exit_v) @ (v - k.exit_v)) / (VELOCITY_SHARE * speed) ** 2
                for k in alike
            ]
        )
        nearest = np.argsort(d2, kind="stable")[:NEIGHBOURS]
        weight = np.exp(-0.5 * (d2[nearest] - d2[nearest[0]]))
        cameras = [alike[i].to_region for i in nearest]
        votes = np.bincount(cameras, weights=weight)
        chosen = int(votes.argmax())
        agree = [(alike[i], w) for i, c, w in zip(nearest, cameras, weight, strict=True) if c == chosen]
        total = sum(w for _, w in agree)
        moved = sum(w * (k.entry_p - k.exit_p) for k, w in agree) / total
        return Lessons(
            region,
            p,
            v,
            float(sum(w * k.duration_s for k, w in agree) / total),
            np.asarray(p + moved),
            np.asarray(sum(w * k.entry_v for k, w in agree) / total),
            chosen,
        )


class ExperienceFilter:
    """A learning estimator while the target is seen; while it is not, what earlier crossings say.

    Parameters
    ----------
    base : estimates while seen, and knows how the target left
    book : lessons, of all targets
    blend : weigh both predictions by the record of their errors from this region; else the lessons alone, and without
        one the target is believed to stand where it was last seen
    """

    def __init__(self, base: LearningEstimator, book: LessonBook, blend: bool, name: str) -> None:
        self.name = name
        self._base, self._book, self._blend = base, book, blend
        self._measured = base.estimate
        self._exit: TargetEstimate | None = None
        self._advice: Lessons | None = None
        self._pending: tuple[TargetEstimate, float, Array, int] | None = None
        self._record: dict[int, tuple[float, float]] = {}

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        base = self._base.estimate
        if self._exit is None:
            return base
        p, v = self._at(np.array([base.t_s]), base.p_world[None], base.v_world)
        return TargetEstimate(
            base.t_s, p[0], base.q_world, v, base.w_body, False, base.last_seen_s, base.region, base.radius_m
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``."""
        exit_, t = self._exit, measurement.t_s
        if exit_ is not None:
            self._base.predict(t)
            p, _ = measured_world_pose(measurement)
            self._note_errors(exit_.region, t, p)
            self._pending = (exit_, t, p, region)
        self._exit = self._advice = None
        self._base.correct(measurement, region)
        self._measured = self._base.estimate
        self._finish_lesson(t)

    def _finish_lesson(self, t_s: float) -> None:
        """Learn a crossing when the velocity beyond it is known."""
        if self._pending is None or t_s - self._pending[1] < 0.6:
            return
        exit_, entry_s, p, region = self._pending
        self._pending = None
        v = self._base.estimate.v_world
        duration = entry_s - exit_.t_s
        self._book.add(Lessons(exit_.region, exit_.p_world, exit_.v_world, duration, p, v, region))

    def _note_errors(self, region: int, t_s: float, p: Array) -> None:
        if self._advice is None:
            return
        own = self._path(np.array([t_s]))[0][0] - p
        base = self._base.estimate.p_world - p
        old = self._record.get(region)
        new = (float(base @ base), float(own @ own))
        if old is not None:
            new = tuple(o + RECORD_SHARE * (n - o) for o, n in zip(old, new, strict=True))  # type: ignore[assignment]
        self._record[region] = new

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        was_seen, left = self._base.estimate.seen, self._measured
        self._base.predict(t_s)
        if was_seen and not self._base.estimate.seen:  # it left some frames ago
            self._exit, self._pending = left, None
            self._advice = self._book.consult(left.region, left.p_world, left.v_world)

    def _path(self, t_s: Array) -> tuple[Array, Array]:
        """Positions (K, 3) of the lessons' path at times (K,), and its velocity (3,) at the first of them."""
        exit_, advice = self._exit, self._advice
        if exit_ is None or advice is None:
            raise ValueError("no advice")
        duration = max(advice.duration_s, 1e-3)
        s = (t_s - exit_.t_s) / duration
        ends = (exit_.p_world, duration * exit_.v_world, advice.entry_p, duration * advice.entry_v)
        p = hermite(np.minimum(s, 1.0), *ends)
        p = p + (np.maximum(s - 1.0, 0.0) * duration)[:, None] * advice.entry_v
        step = 1e-3
        v = (hermite(np.array([min(float(s[0]), 1.0) + step]), *ends)[0] - p[0]) / (step * duration)
        return p, v if s[0] < 1.0 else advice.entry_v

    def _at(self, t_s: Array, base_p: Array, base_v: Array) -> tuple[Array, Array]:
        exit_ = self._exit
        if exit_ is None:
            return base_p, base_v
        if self._advice is None:
            if self._blend:
                return base_p, base_v
            return np.tile(exit_.p_world, (len(t_s), 1)), np.zeros(3)
        p, v = self._path(t_s)
        if not self._blend:
            return p, v
        record = self._record.get(exit_.region)
        if record is None:  # two crossings teach which of both to believe
            return base_p, base_v
        share = record[0] / max(record[0] + record[1], 1e-12)
        return share * p + (1.0 - share) * base_p, share * v + (1.0 - share) * base_v

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        base, now, left = self._base.rollout(horizon_s, dt_s), self._base.estimate, self._measured
        kept = self._exit, self._advice
        if self._exit is None and now.t_s > now.last_seen_s and now.region >= 0:
            self._exit = left  # a frame has been missed: if it is the exit, this is what is expected
            self._advice = self._book.consult(left.region, left.p_world, left.v_world)
        p, _ = self._at(base.t_s, base.p_world, np.zeros(3))
        self._exit, self._advice = kept
        return Rollout(base.t_s, p, base.q_world, base.radius_m)

    def diagnostics(self) -> dict[str, float]:
        """Those of the learning estimator."""
        return self._base.diagnostics()


def scale_of(regions_half_width_m: Array) -> float:
    """Return a tenth of the typical region: exits that near are alike."""
    return max(0.1 * math.sqrt(float(np.mean(np.asarray(regions_half_width_m) ** 2))) * 2.0, 0.1)

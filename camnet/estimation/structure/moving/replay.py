"""Prediction of an unseen target by what it did when it came by earlier: replay of its own record.

| symbol | name | shape | unit | what |
| --- | --- | --- | --- | --- |
| ``(t, p, q)`` | ``PoseRecord`` | (K,), (K, 3), (K, 4) | s, m, - | smoothed while seen, bridged across gaps |
| ``seen``, ``speed`` | | (K,), (K,) | -, m/s | whether an instant was seen; how fast the target went |
| ``D^2`` | | | - | ``|dp|^2 / match_m^2 + angle^2 / match_rad^2``, of a visit's nearest instant |
| ``rho`` | | | - | record seconds a present second: how much faster the target goes now than then |
| ``rho_hat`` | | | - | ``exp(g log rho)``, ``g = s^2 / (s^2 + n^2)``; s^2 learned, n from ``noise_m`` |

A gap is bridged once its end is seen: the quintic through position, velocity and acceleration ``w x v`` at both ends.
Bridges count little where the record has seen instants. Visits whose futures part by more than ``apart_m`` are
different futures: the prediction is the mean of the nearest few of the group with the largest weight, the others are
alternatives. Where the record has no visit the target coasts at its last twist (the coordinated turn) until it meets
one. A visit is a closest approach: where the record merely begins or ends nearby, nothing passed there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from camnet.estimation.structure.moving.twist_filter import TwistState, coast
from camnet.geometry.rotations import angle_between, rotate, slerp
from camnet.settings import Positive, Settings
from camnet.types import Array, BoolArray

__all__ = ["Future", "PoseRecord", "Replay", "ReplaySettings"]


class ReplaySettings(Settings):
    """See the module's table.

    ``gate_m``, ``gate_rad``, ``gate_speed``: how far a visit may pass from the target, and the largest ratio of the two
    speeds, either way: a target that goes by does not stop where it once rested. ``apart_m``: see above. ``nearest``:
    visits averaged. ``back_s``: time over which the present speed is compared with a visit's. ``recent_s``: the
    youngest part of the record, which is the present visit. ``bridged_weight``: of an instant that was not seen.
    """

    gate_m: Positive = 0.45
    gate_rad: Positive = 0.6
    gate_speed: Positive = 2.0
    match_m: Positive = 0.1
    match_rad: Positive = 0.2
    apart_m: Positive = 0.5
    nearest: Annotated[int, Field(ge=1, le=1000)] = 3
    back_s: Positive = 8.0
    recent_s: Positive = 5.0
    step_s: Positive = 1.0
    bridged_weight: Positive = 0.1
    bridge_step_s: Positive = 0.1
    noise_m: Positive = 0.06


@dataclass(frozen=True, eq=False, slots=True)
class Future:
    """One possible position (3,), m, and its share of the weight of all."""

    p: Array
    weight: float


class PoseRecord:
    """What is known of the target's way so far: seen stretches, smoothed, and bridges between them."""

    def __init__(self, bridge_step_s: float) -> None:
        self._step = bridge_step_s
        self.t_s, self.p, self.q = np.empty(0), np.empty((0, 3)), np.empty((0, 4))
        self.seen: BoolArray = np.empty(0, dtype=bool)
        self.speed = np.empty(0)
        self._last: TwistState | None = None

    def add(self, stretch: list[TwistState]) -> None:
        """Append a seen stretch (smoothed), later than all before; the gap before it is bridged."""
        if self._last is not None:
            t, p, q = _bridge(self._last, stretch[0], self._step)
            if len(t) > 1:
                self._append(t, p, q, np.linalg.norm(np.gradient(p, t, axis=0), axis=1), False)
        self._append(
            np.array([s.t_s for s in stretch]),
            np.array([s.p for s in stretch]),
            np.array([s.q for s in stretch]),
            np.array([np.linalg.norm(s.v_body) for s in stretch]),
            True,
        )
        self._last = stretch[-1]

    def _append(self, t: Array, p: Array, q: Array, speed: Array, seen: bool) -> None:
        self.t_s = np.concatenate([self.t_s, t])
        self.p, self.q = np.concatenate([self.p, p]), np.concatenate([self.q, q])
        self.seen = np.concatenate([self.seen, np.full(len(t), seen)])
        self.speed = np.concatenate([self.speed, speed])

    def at(self, t_s: float) -> tuple[Array, bool]:
        """Position (3,) at a time within the record, and whether it was seen."""
        k = int(np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1))
        share = (t_s - self.t_s[k - 1]) / (self.t_s[k] - self.t_s[k - 1])
        p = self.p[k - 1] + share * (self.p[k] - self.p[k - 1])
        return p, bool(self.seen[k - 1] and self.seen[k])


def _bridge(a: TwistState, b: TwistState, step: float) -> tuple[Array, Array, Array]:
    """Poses between two states: quintic position, shortest turn."""
    span = b.t_s - a.t_s
    x = np.arange(step, span - 0.5 * step, step) / span
    ends = []
    for s in (a, b):
        v = s.v_scene
        ends.append((s.p, v * span, rotate(s.q, np.cross(s.w_body, s.v_body)) * span**2))
    (p0, v0, a0), (p1, v1, a1) = ends
    d = p1 - p0 - v0 - 0.5 * a0
    e, f = v1 - v0 - a0, a1 - a0
    c3, c4, c5 = 10.0 * d - 4.0 * e + 0.5 * f, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + 0.5 * f
    y = x[:, None]
    p = p0 + y * (v0 + y * (0.5 * a0 + y * (c3 + y * (c4 + y * c5))))
    return a.t_s + span * x, p, slerp(np.broadcast_to(a.q, (len(x), 4)), np.broadcast_to(b.q, (len(x), 4)), x)


@dataclass(frozen=True, eq=False, slots=True)
class _Visit:
    """An instant of the record (index) near a state, how near, and the raw ratio of speeds (nan: not known)."""

    index: int
    distance: float
    ratio: float


class Replay:
    """Feed it smoothed stretches as they end; ask it for futures of the last state."""

    def __init__(self, settings: ReplaySettings) -> None:
        self._s = settings
        self.record = PoseRecord(settings.bridge_step_s)
        self._stretch: list[TwistState] = []
        self._squares: list[float] = []

    def add(self, stretch: list[TwistState]) -> None:
        """Take in a stretch that has just ended (the target went out of view)."""
        self.record.add(stretch)
        self._stretch = stretch
        raw = [v.ratio for v in self._visits(stretch[-1].p, stretch[-1].q) if np.isfinite(v.ratio)]
        if raw:
            self._squares.append(float(np.log(raw[0]) ** 2))

    def futures(self, span_s: float) -> list[Future]:
        """Where the target may be ``span_s`` after the last stretch's end, the likeliest first."""
        state = self._stretch[-1]
        t = 0.0
        while True:
            p, q = coast(state, t) if t > 0.0 else (state.p, state.q)
            visits = self._visits(p, q)
            found = self._followed(visits, span_s - t)
            if found:
                return found
            if t >= span_s:
                return [Future(p, 1.0)]
            t = min(t + self._s.step_s, span_s)

    def _visits(self, p: Array, q: Array) -> list[_Visit]:
        """Visits near a pose, the nearest first: one instant of each run of instants within the gates."""
        s, r = self._s, self.record
        old = r.t_s < r.t_s[-1] - s.recent_s
        away, angle = np.linalg.norm(r.p[old] - p, axis=1), angle_between(r.q[old], q)
        now, then = float(np.linalg.norm(self._stretch[-1].v_body)), r.speed[old]
        alike = (then < s.gate_speed * now) & (now < s.gate_speed * then)
        near = np.flatnonzero((away < s.gate_m) & (angle < s.gate_rad) & alike)
        out = []
        for run in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
            if len(run):
                d = (away[run] / s.match_m) ** 2 + (angle[run] / s.match_rad) ** 2
                best = int(run[np.argmin(d)])
                if best in (run[0], run[-1]) and d.min() > 1.0:
                    continue
                out.append(_Visit(best, float(np.sqrt(d.min())), self._ratio(best)))
        return sorted(out, key=lambda v: v.distance)

    def _ratio(self, index: int) -> float:
        """Time that the record took for the way of the last ``back_s``, over ``back_s``."""
        r, end = self.record, self._stretch[-1].t_s
        times = np.array([x.t_s for x in self._stretch])
        if times[0] > end - self._s.back_s:
            return np.nan
        then = self._stretch[int(np.searchsorted(times, end - self._s.back_s))]
        t_i = r.t_s[index]
        window = np.flatnonzero((r.t_s > t_i - 2.5 * self._s.back_s) & (r.t_s < t_i - 0.3 * self._s.back_s))
        if len(window) == 0:
            return np.nan
        away = np.linalg.norm(r.p[window] - then.p, axis=1)
        k = int(np.argmin(away))
        if away[k] > self._s.gate_m or not r.seen[window[k]] or not r.seen[index]:
            return np.nan
        return float((t_i - r.t_s[window[k]]) / (end - then.t_s))

    def _shrunk(self, ratio: float) -> float:
        if not np.isfinite(ratio) or ratio <= 0.0:
            return 1.0
        way = float(np.linalg.norm(self._stretch[-1].v_body)) * self._s.back_s
        noise = (self._s.noise_m / max(way, self._s.noise_m)) ** 2
        spread = max(0.0, float(np.mean(self._squares)) - noise) if self._squares else 0.0
        return float(np.exp(np.log(ratio) * spread / (spread + noise)))

    def _followed(self, visits: list[_Visit], span_s: float) -> list[Future]:
        """Futures after ``span_s`` along the visits, grouped."""
        s, r = self._s, self.record
        ends: list[tuple[Array, float]] = []
        for v in visits:
            until = r.t_s[v.index] + self._shrunk(v.ratio) * span_s
            if until <= r.t_s[-1]:
                place, seen = r.at(until)
                ends.append((place, (1.0 if seen else s.bridged_weight) / (1.0 + v.distance**2)))
        groups: list[list[tuple[Array, float]]] = []
        for place, weight in ends:
            for group in groups:
                if np.linalg.norm(group[0][0] - place) < s.apart_m:
                    group.append((place, weight))
                    break
            else:
                groups.append([(place, weight)])
        total = sum(w for _, w in ends)
        futures = []
        for group in groups:
            few = sorted(group, key=lambda g: -g[1])[: s.nearest]
            mean = sum(w * x for x, w in few) / sum(w for _, w in few)
            futures.append(Future(np.asarray(mean), sum(w for _, w in group) / total))
        return sorted(futures, key=lambda f: -f.weight)

r"""Verdicts for every transition of a camera network on roads, and for the network.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| l_max / v_lo | | s | latest re-sighting of a road-bound target |
| T | ``off_max_s``, ``off_max_m`` | s, m | what is allowed out of view |
| Dt_off, Dt_on | ``dwell`` | s | dwell times that the estimator's analysis proves |
| r(tau) = e(tau) + rho | ``allowed_time`` | m | ball of the ``learned`` certificate; e' <= mu e + e_v |

``unseen``: l_max / v_lo <= T and chord / v_max >= ``on_min_s``. ``sound``: the same with the proven Dt_off and Dt_on.
``learned``: the ball fits the next view at the latest time at which the target is where it fits best,
(l_max + way inside) / v_lo, and no junction with several ways is unseen: a model knows one way.
``published`` is about networks with disjoint views and is always unsatisfiable (``verdict``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from camnet.certification.growth import error_after
from camnet.certification.road_gaps import RoadGaps
from camnet.certification.verdict import theorem_31
from camnet.errors import CertificateError
from camnet.types import Array, BoolArray, IntArray

__all__ = ["GrowthModel", "RoadTargetClass", "TransitionTable", "certify_roads", "network_report"]

#: a tolerance of verdicts, s
_SLACK_S = 1e-9


@dataclass(frozen=True, slots=True)
class RoadTargetClass:
    """Road-bound targets.

    Attributes
    ----------
    v_lo_mps, v_max_mps : least and greatest speed along roads while a target moves, m/s
    extent_m : radius of the extent about its reference point, m: a place counts as seen where all of it is in view
    stop_s : longest time that it may stand still during one unseen way, s (signals, queues)
    """

    v_lo_mps: float
    v_max_mps: float
    extent_m: float = 0.0
    stop_s: float = 0.0

    def longest_time(self, way_m: float) -> float:
        """Return the longest time that an unseen way of a given length can take, s."""
        return way_m / self.v_lo_mps + self.stop_s if way_m > 0.0 else 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.stop_s < math.inf:
            raise CertificateError(f"stop_s = {self.stop_s!r}: a time of at least 0 s is needed")
        if not 0.0 < self.v_lo_mps <= self.v_max_mps < math.inf:
            raise CertificateError(
                f"v_lo_mps = {self.v_lo_mps!r}, v_max_mps = {self.v_max_mps!r}: 0 < v_lo <= v_max is needed; "
                "a target that may stop is never certain to be seen again"
            )


@dataclass(frozen=True, slots=True)
class GrowthModel:
    """Error growth for the ``learned`` certificate on roads.

    Attributes
    ----------
    e0_m : position error when the target is lost
    model_error_mps : e_v
    mu_per_s : logarithmic norm of the learned field along the roads
    source : where e_v comes from: ``deterministic``, ``statistical`` or ``stated``
    """

    e0_m: float
    model_error_mps: float
    mu_per_s: float = 0.0
    source: str = "stated"

    def allowed_time(self, radius_m: float) -> float:
        """Return the time until the error reaches a radius, s (inf if it never does)."""
        if radius_m < self.e0_m:
            return 0.0
        horizon = 1.0
        while self.error_at(horizon) < radius_m:
            horizon *= 2.0
            if horizon > 1e7:
                return math.inf
        return float(brentq(lambda t: self.error_at(t) - radius_m, 0.0, horizon, xtol=1e-10))

    def largest_model_error(self, radius_m: float, time_s: float, v_max_mps: float) -> float | None:
        """Return the largest e_v for which the error is within a radius at a time, m/s; None if there is none."""
        if not math.isfinite(time_s) or self.e0_m * math.exp(min(self.mu_per_s * time_s, 700.0)) > radius_m:
            return None
        if time_s <= 0.0:
            return 2.0 * v_max_mps
        x = self.mu_per_s * time_s
        gain = math.expm1(x) / self.mu_per_s if abs(x) > 1e-12 else time_s
        return min((radius_m - self.e0_m * math.exp(x)) / gain, 2.0 * v_max_mps)

    def error_at(self, t_s: float) -> float:
        """Return the error's bound at a time, m; nothing limits the prediction's speed, so that none limits it."""
        return error_after(self.mu_per_s, self.e0_m, self.model_error_mps, math.inf, t_s)


@dataclass(frozen=True, eq=False)
class TransitionTable:
    """One certificate's verdicts for all transitions of ``gaps``, as arrays (T,).

    Attributes
    ----------
    certified : verdicts
    margin_m, margin_s : spare length and time (negative: lacking; -inf where the target may never return)
    binding : the constraint that decides, one of ``BINDING``
    horizon_s : time within which the estimate can be trusted after the exit
    """

    certified: BoolArray
    margin_m: Array
    margin_s: Array
    binding: tuple[str, ...]
    horizon_s: Array


def certify_roads(
    gaps: RoadGaps,
    target: RoadTargetClass,
    off_max_s: float | None,
    on_min_s: float | None,
    growth: GrowthModel | None = None,
    *,
    off_max_m: float | None = None,
    dwell: tuple[float | None, float | None] | None = None,
) -> dict[str, TransitionTable]:
    """Return the ``unseen`` table and, given what they need, the ``sound`` and the ``learned`` one.

    Parameters
    ----------
    gaps : transitions of the network
    target : class of the targets
    off_max_s, off_max_m : what is allowed out of view; None: not limited in that unit
    on_min_s : least time in view that is asked for; None: none
    growth : error growth while unseen, for ``learned``
    dwell : (Dt_off, Dt_on) of the estimator's analysis, s, for ``sound``; None within: no dwell time exists
    """
    far = math.inf if off_max_m is None else off_max_m
    tables = {"unseen": _by_time(gaps, target, _or(off_max_s, math.inf), _or(on_min_s, 0.0), far)}
    if dwell is not None:
        off, on = _or(dwell[0], -math.inf), _or(dwell[1], math.inf)
        tables["sound"] = _by_time(gaps, target, off, on)
    if growth is not None:
        tables["learned"] = _by_growth(gaps, target, on_min_s, growth)
    return tables


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def _by_time(
    gaps: RoadGaps, target: RoadTargetClass, off_s: float, on_s: float, off_m: float = math.inf
) -> TransitionTable:
    chord = gaps.stretches.chord_m[gaps.entry_stretch]
    with np.errstate(invalid="ignore"):  # nothing is allowed, or nothing limited, beside a way without end
        out_s = np.minimum(
            off_s - target.stop_s - gaps.longest_m / target.v_lo_mps,
            (off_m - gaps.longest_m) / target.v_lo_mps,
        )
    out_s = np.where(np.isinf(gaps.longest_m), -math.inf, out_s)
    in_s = np.where(np.isinf(chord), math.inf, chord / target.v_max_mps - on_s)
    in_s = np.where(np.isinf(on_s), -math.inf, in_s)
    out_m, in_m = target.v_lo_mps * out_s, target.v_max_mps * in_s
    return _table(out_s, in_s, out_m, in_m, np.full(len(chord), max(off_s, 0.0)), "time out of view")


def _by_growth(
    gaps: RoadGaps, target: RoadTargetClass, on_min_s: float | None, growth: GrowthModel
) -> TransitionTable:
    """Compare the time to the deepest point of the next view with the time at which the ball outgrows it there."""
    radius, arrival = _meeting(gaps, target)
    unique, inverse = np.unique(np.round(radius, 9), return_inverse=True)
    allowed = np.array([growth.allowed_time(r) for r in unique])[inverse]
    error = np.array([growth.error_at(t) if np.isfinite(t) else math.inf for t in arrival])
    chord = gaps.stretches.chord_m[gaps.entry_stretch]
    on = 0.0 if on_min_s is None else on_min_s
    in_s = np.where(np.isinf(chord), math.inf, chord / target.v_max_mps - on)
    spare_s = np.where(gaps.branches, -math.inf, allowed - arrival)
    spare_m = np.where(gaps.branches, -math.inf, radius - error)
    table = _table(spare_s, in_s, spare_m, target.v_max_mps * in_s, allowed, "size of the ball")
    words = "unseen junction with several ways: the model knows one"
    binding = [words if b else w for b, w in zip(gaps.branches.tolist(), table.binding, strict=True)]
    return replace(table, binding=tuple(binding), horizon_s=np.where(gaps.branches, 0.0, allowed))


def _meeting(gaps: RoadGaps, target: RoadTargetClass) -> tuple[Array, Array]:
    """Return the ball's allowed radius in the next view (T,) and the latest time at which the target is there (T,)."""
    seen = gaps.stretches
    inside = seen.deepest_m[gaps.entry_stretch] - seen.start_m[gaps.entry_stretch]
    arrival = (gaps.longest_m + inside) / target.v_lo_mps + target.stop_s
    return seen.depth_m[gaps.entry_stretch], arrival


def _table(
    out_s: Array, in_s: Array, out_m: Array, in_m: Array, horizon: Array, outer: str
) -> TransitionTable:
    margin_s, margin_m = np.minimum(out_s, in_s), np.minimum(out_m, in_m)
    binding = np.where(out_s <= in_s, outer, "time in view").tolist()
    return TransitionTable(margin_s >= -_SLACK_S, margin_m, margin_s, tuple(binding), horizon)


def network_report(
    gaps: RoadGaps,
    tables: dict[str, TransitionTable],
    target: RoadTargetClass,
    cameras: Sequence[str],
    *,
    regions: int = 0,
    growth: GrowthModel | None = None,
    on_min_s: float | None = None,
    constants: dict[str, object] | None = None,
) -> dict[str, object]:
    """Return the network's report as plain data for JSON; transitions between the same two cameras are joined.

    Each joined transition carries the worst of its ways. ``uncertified`` lists transitions whose unseen ways exceed
    what is allowed, and exits from which the target may stay unseen for ever. ``certificates`` are those of the
    estimate; ``unseen`` sums up the transitions and says nothing of ways into the first view (``promise``).
    """
    joined = _join(gaps, tables)
    lost = _lost_exits(gaps, cameras)
    transitions, unmet = _transition_entries(joined, gaps, tables, target, growth, cameras)
    return {
        "network": {"cameras": len(cameras), "regions": regions},
        "target_class": f"road-bound, {target.v_lo_mps:g} to {target.v_max_mps:g} m/s",
        "certificates": {
            "published": _published(gaps, target, on_min_s),
            **{name: _summary(table, lost) for name, table in tables.items() if name != "unseen"},
        },
        "unseen": _summary(tables["unseen"], lost),
        "transitions": transitions,
        "uncertified": unmet + lost,
        "constants": constants or {},
    }


@dataclass(frozen=True, eq=False)
class _Joined:
    """Transitions between the same two cameras taken together: sorted rows and where each group starts."""

    rows: IntArray
    starts: IntArray
    source: IntArray
    sink: IntArray


def _join(gaps: RoadGaps, tables: dict[str, TransitionTable]) -> dict[str, _Joined]:
    """Group rows by cameras; for each table the row of least time comes first in its group."""
    seen = gaps.stretches
    source, sink = seen.exit_camera[gaps.exit_stretch], seen.entry_camera[gaps.entry_stretch]
    out = {}
    for name, table in tables.items():
        rows = np.lexsort((table.margin_s, sink, source))
        changed = (np.diff(source[rows], prepend=-1) != 0) | (np.diff(sink[rows], prepend=-1) != 0)
        starts = np.flatnonzero(changed)
        out[name] = _Joined(rows, starts, source[rows[starts]], sink[rows[starts]])
    return out


def _transition_entries(
    joined: dict[str, _Joined],
    gaps: RoadGaps,
    tables: dict[str, TransitionTable],
    target: RoadTargetClass,
    growth: GrowthModel | None,
    cameras: Sequence[str],
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """Return all joined transitions, each the worst of its ways, and those that no certificate holds for."""
    group = next(iter(joined.values()))
    if len(group.starts) == 0:
        return [], []
    names = [
        (cameras[a], cameras[b]) for a, b in zip(group.source.tolist(), group.sink.tolist(), strict=True)
    ]
    gap = np.minimum.reduceat(gaps.shortest_m[group.rows], group.starts).tolist()
    longest = np.maximum.reduceat(gaps.longest_m[group.rows], group.starts).tolist()
    parts = {name: _parts(name, joined[name], gaps, table, target, growth) for name, table in tables.items()}
    entries: list[dict[str, object]] = []
    unmet: list[dict[str, object]] = []
    for i, (a, b) in enumerate(names):
        verdicts = {name: part[i] for name, part in parts.items()}
        entries.append({"from": a, "to": b, "gap_m": gap[i], "longest_m": _finite(longest[i]), **verdicts})
        if verdicts["unseen"]["verdict"] != "certified":
            unmet.append({"from": a, "to": b})
    return entries, unmet


def _parts(
    name: str,
    group: _Joined,
    gaps: RoadGaps,
    table: TransitionTable,
    target: RoadTargetClass,
    growth: GrowthModel | None,
) -> list[dict[str, object]]:
    """Return one certificate's entry for every joined transition."""
    rows, starts = group.rows, group.starts
    worst = rows[starts].tolist()
    good = np.logical_and.reduceat(table.certified[rows], starts).tolist()
    margin_m = np.minimum.reduceat(table.margin_m[rows], starts).tolist()
    parts: list[dict[str, object]] = [
        {
            "verdict": "certified" if ok else "not certified",
            "margin_m": _finite(m),
            "margin_s": _finite(table.margin_s[k]),
            "binding": table.binding[k],
        }
        for k, ok, m in zip(worst, good, margin_m, strict=True)
    ]
    if name != "learned" or growth is None:
        return parts
    radius, arrival = (x.tolist() for x in _meeting(gaps, target))
    horizon = np.minimum.reduceat(table.horizon_s[rows], starts).tolist()
    for part, k, trusted in zip(parts, worst, horizon, strict=True):
        part["largest_model_error_mps"] = growth.largest_model_error(radius[k], arrival[k], target.v_max_mps)
        part["trust_horizon_s"] = _finite(trusted)
        part["model_error_source"] = growth.source
    return parts


def _lost_exits(gaps: RoadGaps, cameras: Sequence[str]) -> list[dict[str, object]]:
    """List exits with a branch on which the target is never certain to be seen again."""
    out: list[dict[str, object]] = []
    for flag, reason in (
        (gaps.cyclic, "unseen roads lead in a circle: the target may stay unseen for ever"),
        (gaps.cut, "unseen roads are longer than the search"),
    ):
        names = sorted({cameras[c] for c in gaps.stretches.exit_camera[gaps.exits[flag]].tolist()})
        out += [{"from": name, "to": None, "reason": reason} for name in names]
    return out


def _summary(table: TransitionTable, lost: Sequence[dict[str, object]]) -> dict[str, object]:
    total, good = len(table.certified), int(table.certified.sum())
    whole = good == total and not lost
    reason = (
        f"{good} of {total} ways between views are certified" if total else "no way leads from view to view"
    )
    for words in sorted({b for b, ok in zip(table.binding, table.certified.tolist(), strict=True) if not ok})[
        :1
    ]:
        reason += f"; the others lack: {words}"
    if lost:
        reason += f"; from {len(lost)} cameras the target may stay unseen"
    return {"verdict": "certified" if whole else "not certified", "reason": reason}


def _published(gaps: RoadGaps, target: RoadTargetClass, on_min_s: float | None) -> dict[str, object]:
    if len(gaps.shortest_m) == 0:
        return {"verdict": "not certified", "reason": "no gap between disjoint views was found"}
    verdict = theorem_31(float(gaps.shortest_m.min()), target.v_max_mps, on_min_s, target.extent_m)
    return {"verdict": verdict.verdict, "reason": "Theorem 3.1, smallest gap: " + verdict.reason}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

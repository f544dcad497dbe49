"""What could be predicted of recorded traffic between views: next view, time, and identity when labels are hidden.

The first half of the recording teaches, the second one tests. A crossing begins where a vehicle leaves the square of a
view and ends where it enters one; a vehicle whose trip ends unseen *leaves*. Vehicles that still drive when the
recording stops say nothing of their outcome and are left out.

Baselines: equal branches; a frequency table of the view; the *constant-speed model*: the median way of the branch over
the speed at the exit, with the interval that held the stated share of the teaching half's ratios.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from camnet.association.futures import LEAVES, Branch, FutureLessons, Futures
from camnet.association.settings import DensitySettings, FutureSettings, IdentitySettings
from camnet.errors import DataError
from camnet.experiments.identify import identify
from camnet.experiments.recorded_replay import Fixes
from camnet.importers.traffic import BusyRegion, visits
from camnet.motion.track import Track
from camnet.types import Array, BoolArray

__all__ = ["crossings_of", "hidden_labels", "predict_traffic"]

_FLOOR = 0.01
_SLOW_MPS = 1.0
_SHARE = 0.8


@dataclass(frozen=True, eq=False, slots=True)
class _Crossings:
    """Lessons, and the straight way (n,) from exit to entry, m."""

    lessons: FutureLessons
    way_m: Array


def crossings_of(tracks: Sequence[Track], places: Sequence[BusyRegion], end_s: float) -> _Crossings:
    """Every exit from a view, and what came of it.

    Raises
    ------
    DataError
        No track leaves a view.
    """
    rows: list[tuple[float, ...]] = []
    for track in tracks:
        stays = visits(track, places)
        for k, stay in enumerate(stays):
            if stay.leave_s >= track.t_s[-1] - 1e-6:
                continue
            p, v = _state(track, stay.leave_s)
            if k + 1 < len(stays):
                entry, _ = _state(track, stays[k + 1].enter_s)
                away, way = stays[k + 1].enter_s - stay.leave_s, float(np.hypot(*(entry - p)))
                rows.append((stay.region, *p, *v, stay.leave_s, stays[k + 1].region, away, way))
            elif track.t_s[-1] < end_s - 1.5:
                rows.append((stay.region, *p, *v, stay.leave_s, LEAVES, 0.0, 0.0))
    if not rows:
        raise DataError("no track leaves a view: are the views where the traffic is?")
    a = np.array(sorted(rows, key=lambda row: row[5]))
    view, outcome = a[:, 0].astype(np.int64), a[:, 6].astype(np.int64)
    return _Crossings(FutureLessons(view, a[:, 1:3], a[:, 3:5], a[:, 5], outcome, a[:, 7]), a[:, 8])


def _state(track: Track, t_s: float) -> tuple[Array, Array]:
    """Place and velocity (2,), (2,) at a time, straight between fixes."""
    k = int(np.clip(np.searchsorted(track.t_s, t_s, side="right") - 1, 0, len(track.t_s) - 2))
    dt = track.t_s[k + 1] - track.t_s[k]
    v = (track.p_world[k + 1, :2] - track.p_world[k, :2]) / dt
    return track.p_world[k, :2] + (t_s - track.t_s[k]) * v, v


def predict_traffic(
    tracks: Sequence[Track],
    places: Sequence[BusyRegion],
    half_s: float,
    end_s: float,
    settings: FutureSettings | None = None,
) -> dict[str, Any]:
    """Learn from exits whose outcome is known at ``half_s``, predict those that come later.

    Raises
    ------
    DataError
        Nothing to learn from, or nothing to predict.
    """
    found = crossings_of(tracks, places, end_s)
    n = found.lessons
    known = n.t_s + n.away_s < half_s
    test = np.flatnonzero(n.t_s >= half_s)
    if not known.any() or not len(test):
        raise DataError(
            f"{known.sum()} crossings to learn from and {len(test)} to predict; some of each were expected"
        )
    model = Futures(_subset(n, known), len(places), settings)
    taught, ways = _subset(n, known), found.way_m[known]
    ratio = _speed_ratios(taught, ways)
    hit, loss, table_loss, error, inside, width, plain = [], [], [], [], [], [], []
    plain_error, plain_inside = [], []
    for k in test:
        view, outcome, away = int(n.view[k]), int(n.outcome[k]), float(n.away_s[k])
        branches = model.predict(view, n.p_world[k], n.v_world[k], float(n.t_s[k]))
        hit.append(branches[0].outcome == outcome)
        branch = next(b for b in branches if b.outcome == outcome)
        loss.append(-np.log(_floored(branch.weight, len(branches))))
        same = taught.view == view
        share = (np.sum(taught.outcome[same] == outcome) + 1.0) / (same.sum() + len(branches))
        table_loss.append(-np.log(_floored(float(share), len(branches))))
        if outcome == LEAVES or not len(branch.times_s):
            continue
        low, high = branch.interval(_SHARE)
        error.append(abs(branch.quantile(0.5) - away))
        inside.append(low <= away <= high)
        width.append(high - low)
        way = float(np.median(ways[same & (taught.outcome == outcome)]))
        base = way / max(float(np.hypot(*n.v_world[k])), _SLOW_MPS)
        plain.append(base * (ratio[2] - ratio[0]))
        plain_error.append(abs(base * ratio[1] - away))
        plain_inside.append(base * ratio[0] <= away <= base * ratio[2])
    return {
        "views": len(places),
        "crossings": {"taught": int(known.sum()), "tested": len(test), "timed": len(error)},
        "next_view_top1": float(np.mean(hit)),
        "log_loss": {
            "learned": float(np.mean(loss)),
            "frequency_of_view": float(np.mean(table_loss)),
            "equal": float(np.log(len(places) + 1)),
        },
        "time": {
            "median_error_s": _median(error),
            "held_by_80": float(np.mean(inside)) if inside else None,
            "mean_width_s": float(np.mean(width)) if width else None,
            "median_width_s": _median(width),
        },
        "constant_speed": {
            "median_error_s": _median(plain_error),
            "held_by_80": float(np.mean(plain_inside)) if plain_inside else None,
            "mean_width_s": float(np.mean(plain)) if plain else None,
            "median_width_s": _median(plain),
        },
        "width_over_constant_speed": {
            "mean": float(np.mean(width) / np.mean(plain)) if plain else None,
            "median": float(np.median(width) / np.median(plain)) if plain else None,
        },
        "branches": _table(model, taught, len(places)),
    }


def _floored(p: float, outcomes: int) -> float:
    """Return a probability with the floor of 1 % that every model gets."""
    return (1.0 - _FLOOR) * p + _FLOOR / outcomes


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _subset(n: FutureLessons, rows: BoolArray) -> FutureLessons:
    return FutureLessons(*(getattr(n, f.name)[rows] for f in fields(n)))


def _speed_ratios(n: FutureLessons, ways: Array) -> Array:
    """Quantiles (3,) of the time away over that of the median way of the branch at the speed of the exit."""
    ratios = []
    for k in np.flatnonzero(n.outcome != LEAVES):
        way = np.median(ways[(n.view == n.view[k]) & (n.outcome == n.outcome[k])])
        base = way / max(float(np.hypot(*n.v_world[k])), _SLOW_MPS)
        ratios.append(n.away_s[k] / max(base, 1e-6))
    if not ratios:
        return np.ones(3)
    return np.asarray(np.quantile(ratios, [0.5 - _SHARE / 2, 0.5, 0.5 + _SHARE / 2]))


def _table(model: Futures, taught: FutureLessons, views: int) -> list[dict[str, Any]]:
    """Branches of every view at its most usual exit."""
    rows = []
    for view in range(views):
        mine = np.flatnonzero(taught.view == view)
        if not len(mine):
            continue
        gap = np.linalg.norm(taught.p_world[mine, None] - taught.p_world[None, mine], axis=2)
        k = mine[int(np.argmax((gap < 5.0).sum(axis=1)))]
        found = model.predict(view, taught.p_world[k], taught.v_world[k], float(taught.t_s[-1]))
        rows += [_row(view, taught.p_world[k], branch) for branch in found if branch.weight > _FLOOR]
    return rows


def _row(view: int, p: Array, branch: Branch) -> dict[str, Any]:
    timed = len(branch.times_s) > 0
    low, high = branch.interval(_SHARE) if timed else (None, None)
    return {
        "view": view,
        "exit_x_m": float(p[0]),
        "exit_y_m": float(p[1]),
        "next": "leaves" if branch.outcome == LEAVES else f"view {branch.outcome}",
        "weight": branch.weight,
        "median_s": branch.quantile(0.5) if timed else None,
        "low_s": low,
        "high_s": high,
    }


def hidden_labels(
    tracks: Sequence[Track],
    places: Sequence[BusyRegion],
    per_minute: float,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Thin traffic to vehicles a minute that two or more views see, hide their labels, and find out who is who.

    Starts and ends of trips are told, as in `camnet.experiments.identify`; learned from other vehicles.
    """
    rng = np.random.default_rng(seed)
    passing = [track for track in tracks if len(visits(track, places)) >= 2]
    span = max(t.t_s[-1] for t in tracks) - min(t.t_s[0] for t in tracks)
    count = min(round(per_minute * span / 60.0), len(passing))
    chosen = [passing[k] for k in np.sort(rng.choice(len(passing), count, replace=False))]
    fixes = _fixes(chosen, places)
    density = DensitySettings(
        position_scale_m=5.0, velocity_scale_mps=3.0, place_scale_m=5.0, time_floor_s=0.5, turn_scale_mps=3.0
    )
    found = identify(fixes, IdentitySettings(density=density), "others", None, seed, progress).summary
    return {
        "vehicles_per_minute": 60.0 * count / span,
        "entries": found["entries"],
        "candidates_mean": found["candidates_mean"],
        "rank1_at_once": found["rank1"]["at_once"],
        "rank1_revised": found["rank1"]["revised"],
        "rank1_nearest_in_time": found["rank1"]["nearest_in_time"],
        "calibration_error": found["calibration"]["revised"]["ece_chosen"],
        "alone": found["alone"],
    }


def _fixes(tracks: Sequence[Track], places: Sequence[BusyRegion]) -> Fixes:
    p = np.concatenate([t.p_world[:, :2] for t in tracks])
    t_s = np.concatenate([t.t_s for t in tracks])
    who = np.repeat(np.arange(len(tracks)), [len(t.t_s) for t in tracks])
    camera = np.full(len(p), -1)
    for k, place in enumerate(places):
        camera[np.all((p >= place.min_m) & (p <= place.max_m), axis=1)] = k
    order = np.lexsort((who, t_s))
    names = tuple(t.id for t in tracks)
    return Fixes(t_s[order], p[order], who[order], who[order], camera[order], names)

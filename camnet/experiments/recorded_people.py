r"""Recorded people against the reachable sets that a certificate claims for targets that go anywhere.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| t | ``since`` | s | time since the last fix in view |
| e | ``fix_error_m`` | m | bound of a fix's own error: the receiver's, and that of taking a foot point for the ground |
| v_max t + 2 e | | m | how far a fix may be from the fix at the exit: both carry the error |

The class of the targets says where they *are*; a recording says where a receiver *put* them. A person has left a
reachable set for certain only if a fix is further away than v_max t + 2 e. Without e the check says nothing: an unseen
fix that is reached by steps within v_max is in the set by the triangle inequality, and every other fix may be an error.

e is stated, or calibrated by the earliest quarter of all fixes, seen or not. A step between two fixes that is longer
than v_max dt + 2 e disproves e, so that the largest (d - v_max dt) / 2 of those steps is the least e that they allow.
What was lost from view after the calibration is checked with an e that knew nothing of it; that is what counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.certification.coverage import Views
from camnet.certification.free_network import FreeTargetClass, ground_views
from camnet.motion.track import Track
from camnet.types import Array, BoolArray

__all__ = ["check_recorded"]

#: share of the fixes, the earliest, that e is calibrated with
_CALIBRATION = 0.25
#: bounds of a fix's error that the table shows, m
_ERRORS_M = (0.0, 5.0, 10.0, 20.0, 50.0, 100.0, 150.0, 200.0)
_SLACK_M = 1e-6
#: a stretch of this many steps, all faster than this many times v_max, is no jump of a receiver
_RIDE_STEPS, _RIDE = 3, 1.5


@dataclass(frozen=True, eq=False)
class _Record:
    """All people together: steps between fixes and unseen fixes.

    Attributes
    ----------
    step_end_s, step_need_m : (s,) when a step ended and the least e that explains it
    person, exit_s, seen_s : (k,) of every unseen fix: whose it is, last time in view, its own time
    away_m : (k,) distance from the fix at the exit
    """

    step_end_s: Array
    step_need_m: Array
    person: Array
    exit_s: Array
    time_s: Array
    away_m: Array

    def needs(self, v_max_mps: float) -> Array:
        """Return the least e for which each unseen fix is in its reachable set (k,), m."""
        return np.asarray(np.maximum(self.away_m - v_max_mps * (self.time_s - self.exit_s), 0.0) / 2.0)


def check_recorded(
    tracks: Sequence[Track],
    views: Views,
    names: Sequence[str],
    target: FreeTargetClass,
    height_m: float,
    fix_error_m: float | None = None,
) -> dict[str, Any]:
    """Check every recorded fix out of view against the reachable set about the person's last fix in view.

    Parameters
    ----------
    tracks : one for each person
    views, names : the cameras
    target : class of the targets
    height_m : height of the plane in which they move
    fix_error_m : stated bound e of a fix's error; None: calibrated by the earliest quarter of the fixes

    Returns
    -------
    dict
        ``fix_error_m`` and where it comes from; ``unseen``, ``outside`` and ``people_outside`` over all unseen fixes,
        and ``held_out``: the same over those lost after the calibration (all of them where e is stated); ``table``:
        what leaves for other bounds; ``least_fix_error_m``, ``least_v_max_mps``: the smallest e, and for exact fixes
        the smallest v_max, for which nobody leaves; ``longest_jump_m``: the most by which a step exceeds v_max dt;
        ``rides``: stretches of steps that all are half as fast again as v_max.
    """
    ground = ground_views(views, names, height_m, target.extent_m)
    record = _collect(tracks, [g.view for g in ground], target.v_max_mps)
    if fix_error_m is None:
        until = float(np.quantile(record.step_end_s, _CALIBRATION)) if len(record.step_end_s) else -np.inf
        early = record.step_end_s <= until
        error, source = (
            float(record.step_need_m[early].max(initial=0.0)),
            "calibrated by the earliest quarter",
        )
    else:
        until, error, source = -np.inf, fix_error_m, "stated"
    needs = record.needs(target.v_max_mps)
    since, everybody = record.time_s - record.exit_s, np.ones(len(needs), dtype=bool)
    return {
        "people": len(tracks),
        "fixes": sum(len(track.t_s) for track in tracks),
        "faster_than_v_max": int((record.step_need_m > _SLACK_M).sum()),
        "v_max_mps": target.v_max_mps,
        "fix_error_m": error,
        "fix_error_source": source,
        **_leavers(record, needs, error, everybody),
        "held_out": _leavers(record, needs, error, np.asarray(record.exit_s > until)),
        "table": [{"fix_error_m": e, **_leavers(record, needs, e, everybody)} for e in _ERRORS_M],
        "longest_jump_m": 2.0 * float(record.step_need_m.max(initial=0.0)),
        "rides": _rides(tracks, _RIDE * target.v_max_mps),
        "least_fix_error_m": float(needs.max(initial=0.0)),
        "least_v_max_mps": float((record.away_m / since).max(initial=0.0)),
    }


def _rides(tracks: Sequence[Track], faster_mps: float) -> dict[str, float | int]:
    """Count stretches of at least ``_RIDE_STEPS`` steps that are all faster, with the speed from end to end, m/s."""
    speeds = []
    for track in tracks:
        p, t = track.p_world[:, :2], track.t_s
        fast = np.linalg.norm(np.diff(p, axis=0), axis=1) > faster_mps * np.diff(t)
        edges = np.flatnonzero(np.diff(np.r_[False, fast, False].astype(int))).reshape(-1, 2)
        for a, b in edges[np.diff(edges, axis=1)[:, 0] >= _RIDE_STEPS].tolist():
            speeds.append(float(np.linalg.norm(p[b] - p[a]) / (t[b] - t[a])))
    return {
        "count": len(speeds),
        "median_mps": float(np.median(speeds)) if speeds else 0.0,
        "fastest_mps": max(speeds, default=0.0),
    }


def _leavers(record: _Record, needs: Array, error_m: float, chosen: BoolArray) -> dict[str, int]:
    """Count the unseen fixes, and the people, that are out of their set for a bound of the fixes' error."""
    out: BoolArray = chosen & np.asarray(needs > error_m + _SLACK_M)
    return {
        "unseen": int(chosen.sum()),
        "outside": int(out.sum()),
        "people_outside": len(np.unique(record.person[out])),
    }


def _collect(tracks: Sequence[Track], views: Sequence[Any], v_max_mps: float) -> _Record:
    """Go through all tracks; an unseen fix before the first one in view is about nobody."""
    ends, needs, people, exits, times, away = ([np.zeros(0)] for _ in range(6))
    for k, track in enumerate(tracks):
        p, t = track.p_world[:, :2], track.t_s
        step = np.linalg.norm(np.diff(p, axis=0), axis=1) - v_max_mps * np.diff(t)
        ends.append(t[1:])
        needs.append(np.maximum(step, 0.0) / 2.0)
        visible = np.any([view.depth(p) >= 0.0 for view in views], axis=0)
        last = np.maximum.accumulate(np.where(visible, np.arange(len(p)), -1))
        rows = np.flatnonzero(~visible & (last >= 0))
        people.append(np.full(len(rows), float(k)))
        exits.append(t[last[rows]])
        times.append(t[rows])
        away.append(np.linalg.norm(p[rows] - p[last[rows]], axis=1))
    return _Record(*(np.concatenate(parts) for parts in (ends, needs, people, exits, times, away)))

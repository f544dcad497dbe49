"""Figures of one run of the road-network experiment: errors of each row, and what the policy did (``road_network``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camnet.geometry.rotations import angle_between
from camnet.types import Array, BoolArray, IntArray

__all__ = ["RoadTrace", "conduct", "passed_unseen", "score"]


@dataclass(frozen=True, eq=False, slots=True)
class RoadTrace:
    """One run at the decision rate, K instants and M robots.

    Attributes
    ----------
    t_s : (K,) times, s
    p_world, q_world : (K, M, 3), (K, M, 4) truth
    seen : (K, M) whether a measurement is in force
    road : (K, M) road that the robot is on
    estimates : for each row positions (K, M, 3) and orientations (K, M, 4)
    camera_p : (K, 3) where the camera is
    followed : (K,) which robot is followed
    lost : (K, M) whether the policy knows that the robot is not where it was predicted
    """

    t_s: Array
    p_world: Array
    q_world: Array
    seen: BoolArray
    road: IntArray
    estimates: Mapping[str, tuple[Array, Array]]
    camera_p: Array
    followed: IntArray
    lost: BoolArray


def passed_unseen(trace: RoadTrace) -> BoolArray:
    """Whether (K, M) a robot is on another road than when it was last seen: it has turned, and nobody saw it."""
    out = np.zeros(trace.seen.shape, dtype=bool)
    for m in range(trace.seen.shape[1]):
        known, changed = -1, False
        for k in range(len(trace.t_s)):
            if trace.seen[k, m]:
                known, changed = int(trace.road[k, m]), False
            changed = changed or int(trace.road[k, m]) != known
            out[k, m] = changed
    return out


def score(trace: RoadTrace, name: str, from_s: float) -> dict[str, float]:
    """Root mean square errors of a row from ``from_s`` on, from a robot's first sighting on."""
    p, q = trace.estimates[name]
    away = np.linalg.norm(p - trace.p_world, axis=2)
    turned = np.degrees(angle_between(q, trace.q_world))
    counted = (trace.t_s >= from_s)[:, None] & np.maximum.accumulate(trace.seen, axis=0)
    unseen = counted & ~trace.seen
    same_road = unseen & ~passed_unseen(trace)
    content = {
        "position_rmse_m": _rms(away[counted]),
        "orientation_rmse_deg": _rms(turned[counted]),
        "position_rmse_unseen_m": _rms(away[unseen]),
        "orientation_rmse_unseen_deg": _rms(turned[unseen]),
        "position_rmse_unseen_same_road_m": _rms(away[same_road]),
        "position_median_unseen_m": float(np.median(away[unseen])) if unseen.any() else 0.0,
    }
    for m in range(p.shape[1]):
        content[f"position_rmse_unseen_target_{m + 1}_m"] = _rms(away[:, m][unseen[:, m]])
    return content


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def conduct(trace: RoadTrace, from_s: float) -> dict[str, float]:
    """Figures of the policy: how long robots are unseen, how often one turned unseen, how often it was lost."""
    late = trace.t_s >= from_s
    turned = passed_unseen(trace)[late]
    unseen = ~trace.seen[late]
    lengths = [n for m in range(unseen.shape[1]) for n in _runs(unseen[:, m])]
    dt = float(np.diff(trace.t_s).mean())
    return {
        "unseen_share": float(unseen.mean()),
        "gaps": float(len(lengths)),
        "gap_mean_s": dt * float(np.mean(lengths)) if lengths else 0.0,
        "gap_longest_s": dt * float(np.max(lengths, initial=0)),
        "turned_unseen_share_of_unseen": float(turned[unseen].mean()) if unseen.any() else 0.0,
        "lost_share": float(trace.lost[late].mean()),
    }


def _runs(flags: BoolArray) -> list[int]:
    """Lengths of the runs of true values."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(int), 0]))
    return [int(n) for n in edges[1::2] - edges[::2]]

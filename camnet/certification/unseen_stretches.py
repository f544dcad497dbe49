r"""Unseen stretches of recorded tracks: what traffic really drove between two views (``experiments.check_traffic``).

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| p(t) | ``Track`` | m, s | straight lines between the fixes |
| A x <= b | ``Views`` | | convex fields of view; a point is seen where it is in one of them |
| L | ``length_m`` | m | way along p between two views, before the first one, or after the last one |
| T, T_0 | ``time_s``, ``standing_s`` | s | time that it took, and how much of it the target stood still |

Nothing here knows roads, classes or certificates: only where targets were and what the cameras look at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from camnet.certification.coverage import Views
from camnet.motion.track import Track
from camnet.types import Array

__all__ = ["STRETCH_KINDS", "Stretch", "stretches_of"]

STRETCH_KINDS = ("before the first view", "between views", "after the last view", "never seen")
#: a target slower than this stands still, m/s
_STANDING_MPS = 0.1


@dataclass(frozen=True, slots=True)
class Stretch:
    """One unseen stretch of one track.

    Attributes
    ----------
    track, kind : identity, and one of ``STRETCH_KINDS``
    start_s, end_s : times of the file's clock at which it begins and ends
    length_m, standing_s, fastest_mps : way, time of standing still, largest speed between two fixes
    start_xy, end_xy : where it begins and ends, m
    """

    track: str
    kind: str
    start_s: float
    end_s: float
    length_m: float
    standing_s: float
    fastest_mps: float
    start_xy: tuple[float, float]
    end_xy: tuple[float, float]

    @property
    def time_s(self) -> float:
        """Time that it took."""
        return self.end_s - self.start_s

    @property
    def moving_mps(self) -> float:
        """Mean speed while moving; inf where it took no time."""
        moving = self.time_s - self.standing_s
        return self.length_m / moving if moving > 0.0 else float("inf")


def stretches_of(tracks: Sequence[Track], views: Views, height_m: float = 0.0) -> list[Stretch]:
    """Return every unseen stretch of every track, in the order of the tracks and of time.

    Parameters
    ----------
    tracks : targets, in the frame of the views
    views : what the cameras see
    height_m : height at which the targets' reference points are looked for, m
    """
    tree = shapely.STRtree(shapely.box(*views.bounds_xy.T))
    out: list[Stretch] = []
    for track in tracks:
        out += _of_track(track, views, tree, height_m)
    return out


def _of_track(track: Track, views: Views, tree: shapely.STRtree, height_m: float) -> list[Stretch]:
    xy, t = track.p_world[:, :2], track.t_s
    if len(t) < 2:
        return []
    seen = _merged(*_seen_times(xy, t, views, tree, height_m))
    step = np.diff(xy, axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
    speed = np.diff(way) / np.diff(t)
    standing = np.concatenate([[0.0], np.cumsum(np.where(speed < _STANDING_MPS, np.diff(t), 0.0))])
    edges = [(float(t[0]), float(t[0])), *seen, (float(t[-1]), float(t[-1]))]
    out = []
    for k, ((_, a), (b, _)) in enumerate(pairwise(edges)):
        first, last = k == 0, k == len(edges) - 2
        kind = STRETCH_KINDS[(3 if last else 0) if first else (2 if last else 1)]
        if b <= a:
            continue
        (x0, x1), (y0, y1) = (np.interp([a, b], t, xy[:, i]).tolist() for i in (0, 1))
        length, stood = (float(np.diff(np.interp([a, b], t, of))[0]) for of in (way, standing))
        i, j = int(np.searchsorted(t, a, side="right")) - 1, int(np.searchsorted(t, b))
        fastest = float(speed[i : max(j, i + 1)].max())
        out.append(Stretch(track.id, kind, a, b, length, stood, fastest, (x0, y0), (x1, y1)))
    return out


def _seen_times(
    xy: Array, t: Array, views: Views, tree: shapely.STRtree, height_m: float
) -> tuple[Array, Array]:
    """Return the intervals of time in which single segments of a track are in single views."""
    low, high = np.minimum(xy[:-1], xy[1:]), np.maximum(xy[:-1], xy[1:])
    segment, camera = tree.query(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    normals = views.normals[camera]
    spare = views.offsets[camera] - normals[..., 2] * height_m
    start, step = xy[segment], xy[segment + 1] - xy[segment]
    spare = spare - np.einsum("pfi,pi->pf", normals[..., :2], start)
    slope = np.einsum("pfi,pi->pf", normals[..., :2], step)
    level = np.abs(slope) < 1e-15
    ratio = spare / np.where(level, 1.0, slope)
    enter = np.where((slope < 0.0) & ~level, ratio, 0.0).max(axis=1, initial=0.0)
    leave = np.where((slope > 0.0) & ~level, ratio, 1.0).min(axis=1, initial=1.0)
    inside = (enter <= leave) & ~(level & (spare < 0.0)).any(axis=1)
    dt = t[segment + 1] - t[segment]
    return (t[segment] + enter * dt)[inside], (t[segment] + leave * dt)[inside]


def _merged(start: Array, end: Array) -> list[tuple[float, float]]:
    out: list[tuple[float, float]] = []
    for k in np.argsort(start, kind="stable").tolist():
        if out and start[k] <= out[-1][1] + 1e-9:
            out[-1] = (out[-1][0], max(out[-1][1], float(end[k])))
        else:
            out.append((float(start[k]), float(end[k])))
    return out

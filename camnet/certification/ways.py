"""Ways that targets of a class can take, as a graph of curved arcs with headings and times, and what is seen of them.

| name | shape | unit | meaning |
| --- | --- | --- | --- |
| ``at_m`` | (n,) | m | arc length of each sample on its arc |
| ``xy``, ``heading`` | (n, 2), (n,) | m, rad | pose of the target there |
| ``time_s`` | (n,) | s | latest time from the start of the arc |
| ``half_width_m`` | | m | targets may be this far to either side |
| ``height_m`` | (n,) | m | height above the ground; None: on it |

The target's feature points are carried along each arc; a place is seen by a camera where the simulator's own test says
so, over the whole cross-section. Where a view begins or ends is found by halving between two samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Coverage, Views
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.sight_lines import Solids, seen_by, seen_pairs
from camnet.certification.unseen import SeenArcs
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Ways", "cover_ways", "join_coverage", "seen_arcs", "straight_ways"]

#: distance between samples along an arc, m; a view or a shadow shorter than this may be passed over
STEP_M = 0.1
#: distance between samples across a cross-section, m
_ACROSS_M = 0.1
#: halvings between two samples: 0.1 m / 2^10 is 0.1 mm
_HALVINGS = 10
#: feature points looked at in one go
_CHUNK = 200_000


@dataclass(frozen=True, eq=False)
class Ways:
    """A graph of arcs with samples; see the table above.

    Attributes
    ----------
    roads : arcs and turns
    sample_ptr : (A + 1,) samples of arc a are ``ptr[a]:ptr[a + 1]``
    entries : (A,) arcs on which a target may begin
    anywhere : whether it may begin anywhere on them, or at their starts only
    """

    roads: RoadArcs
    sample_ptr: IntArray
    at_m: Array
    xy: Array
    heading: Array
    time_s: Array
    entries: BoolArray
    half_width_m: float = 0.0
    anywhere: bool = True
    height_m: Array | None = None

    def height(self, arc: IntArray, at_m: Array) -> Array | None:
        """Return heights (k,) on arcs (k,) at arc lengths (k,), m; None where all is on the ground."""
        if self.height_m is None:
            return None
        i, f = self._between(arc, at_m)
        return np.asarray(self.height_m[i] + f * (self.height_m[i + 1] - self.height_m[i]))

    def pose(self, arc: IntArray, at_m: Array) -> tuple[Array, Array]:
        """Return places (k, 2) and headings (k,) on arcs (k,) at arc lengths (k,), m."""
        i, f = self._between(arc, at_m)
        xy = self.xy[i] + f[:, None] * (self.xy[i + 1] - self.xy[i])
        turn = np.remainder(self.heading[i + 1] - self.heading[i] + math.pi, 2.0 * math.pi) - math.pi
        return xy, np.asarray(self.heading[i] + f * turn)

    def time(self, arc: IntArray, at_m: Array) -> Array:
        """Return the latest time (k,) from the start of arcs (k,) to arc lengths (k,), s."""
        i, f = self._between(arc, at_m)
        return np.asarray(self.time_s[i] + f * (self.time_s[i + 1] - self.time_s[i]))

    def _between(self, arc: IntArray, at_m: Array) -> tuple[IntArray, Array]:
        """Return the sample before each place, and the share of the way to the next one."""
        base = np.concatenate([[0.0], np.cumsum(self.roads.length_m + 1.0)])
        owner = np.repeat(np.arange(self.roads.n_arcs), np.diff(self.sample_ptr))
        i = np.searchsorted(self.at_m + base[owner], at_m + base[arc], side="right") - 1
        i = np.clip(i, self.sample_ptr[arc], self.sample_ptr[arc + 1] - 2)
        step = self.at_m[i + 1] - self.at_m[i]
        return i, np.clip((at_m - self.at_m[i]) / np.where(step > 0.0, step, 1.0), 0.0, 1.0)


def straight_ways(
    roads: RoadArcs, v_lo_mps: float, entries: BoolArray | None = None, half_width_m: float = 0.0
) -> Ways:
    """Sample the arcs of a road network, which are travelled at ``v_lo_mps`` or faster; entries None: every arc."""
    first = np.searchsorted(roads.piece_arc, np.arange(roads.n_arcs + 1))
    at, xy, heading, ptr = [], [], [], [0]
    for arc in range(roads.n_arcs):
        pieces = slice(int(first[arc]), int(first[arc + 1]))
        for start, along, length, offset in zip(
            roads.start_xy[pieces],
            roads.direction_xy[pieces],
            roads.piece_length_m[pieces].tolist(),
            roads.piece_offset_m[pieces].tolist(),
            strict=True,
        ):
            s = np.linspace(0.0, length, max(2, math.ceil(length / STEP_M) + 1))
            at.append(offset + s)
            xy.append(start + s[:, None] * along)
            heading.append(np.full(len(s), math.atan2(along[1], along[0])))
        ptr.append(ptr[-1] + sum(len(x) for x in at[len(at) - (pieces.stop - pieces.start) :]))
    at_m = np.concatenate(at)
    return Ways(
        roads,
        np.array(ptr, dtype=np.int64),
        at_m,
        np.concatenate(xy),
        np.concatenate(heading),
        at_m / v_lo_mps,
        np.ones(roads.n_arcs, dtype=bool) if entries is None else entries,
        half_width_m,
    )


def cover_ways(ways: Ways, views: Views, solids: Solids, features: Array) -> Coverage:
    """Return what each camera sees of the ways, of targets with feature points (F, 3) in their frame, m.

    ``depth_m`` of the result is 0: how large a disc fits is no matter of what is seen.
    """
    owner = np.repeat(np.arange(ways.roads.n_arcs), np.diff(ways.sample_ptr))
    rows = max(1, _CHUNK // max(1, len(features) * len(_across(ways.half_width_m))))
    seen = np.concatenate(
        [
            seen_by(_samples(ways, features, slice(k, k + rows)), views, solids)
            for k in range(0, len(ways.at_m), rows)
        ]
    )
    arc, camera, start, end = _runs(seen, owner)
    low, high = _edges(ways, views, solids, features, seen, arc, camera, start, end)
    keep = high > low
    arc, camera, low, high = arc[keep], camera[keep], low[keep], high[keep]
    order = np.lexsort((low, arc))
    nothing = np.zeros(len(order))
    return Coverage(arc[order], camera[order], low[order], high[order], nothing, 0.5 * (low + high)[order])


def join_coverage(a: Coverage, b: Coverage, first: int) -> Coverage:
    """Return both, sorted; the cameras of ``b`` are numbered from ``first`` on."""
    arc, start = np.concatenate([a.arc, b.arc]), np.concatenate([a.start_m, b.start_m])
    order = np.lexsort((start, arc))
    camera = np.concatenate([a.camera, b.camera + first])[order]
    end, depth, at = (
        np.concatenate([getattr(a, name), getattr(b, name)])[order]
        for name in ("end_m", "depth_m", "deepest_m")
    )
    return Coverage(arc[order], camera, start[order], end, depth, at)


def seen_arcs(ways: Ways, coverage: Coverage, first: IntArray, last: IntArray, in_time: bool) -> SeenArcs:
    """Return merged stretches (``coverage``) of the ways for ``longest_unseen``, in seconds if ``in_time``.

    ``first`` and ``last`` are the cameras that see the beginning and the end of each stretch.
    """
    roads = ways.roads
    everything = np.arange(roads.n_arcs)
    if in_time:
        start, end = ways.time(coverage.arc, coverage.start_m), ways.time(coverage.arc, coverage.end_m)
        length = ways.time(everything, roads.length_m)
    else:
        start, end, length = coverage.start_m, coverage.end_m, roads.length_m
    return SeenArcs(
        length,
        roads.successor_ptr,
        roads.successor,
        coverage.arc,
        start,
        end,
        first,
        last,
        ways.entries,
        ways.anywhere,
    )


def _across(half_width_m: float) -> Array:
    if half_width_m <= 0.0:
        return np.zeros(1)
    n = 2 * math.ceil(half_width_m / _ACROSS_M) + 1
    return np.linspace(-half_width_m, half_width_m, n)


def _samples(ways: Ways, features: Array, rows: slice) -> Array:
    height = None if ways.height_m is None else ways.height_m[rows]
    return _points(ways, features, ways.xy[rows], ways.heading[rows], height)


def _points(ways: Ways, features: Array, xy: Array, heading: Array, height: Array | None) -> Array:
    """Return the feature points (n, F * widths, 3) of targets at places (n, 2) with headings and heights (n,)."""
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    across = _across(ways.half_width_m)
    fx = np.tile(features[:, 0], len(across))
    fy = np.tile(features[:, 1], len(across)) + np.repeat(across, len(features))
    fz = np.tile(features[:, 2], len(across))
    x = xy[:, :1] + c * fx - s * fy
    y = xy[:, 1:] + s * fx + c * fy
    z = np.broadcast_to(fz, x.shape) if height is None else fz + height[:, None]
    return np.stack([x, y, z], axis=-1)


def _runs(seen: BoolArray, owner: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return arc, camera, first and last sample of every unbroken run of ``seen`` (n, C) on one arc."""
    columns = np.ascontiguousarray(seen.T)
    new_arc = np.diff(owner, prepend=-1) != 0
    ends_arc = np.append(new_arc[1:], True)
    before = np.pad(columns[:, :-1], ((0, 0), (1, 0)))
    after = np.pad(columns[:, 1:], ((0, 0), (0, 1)))
    camera, start = np.nonzero(columns & (~before | new_arc))
    _, end = np.nonzero(columns & (~after | ends_arc))
    return owner[start], camera, start, end


def _edges(
    ways: Ways,
    views: Views,
    solids: Solids,
    features: Array,
    seen: BoolArray,
    arc: IntArray,
    camera: IntArray,
    start: IntArray,
    end: IntArray,
) -> tuple[Array, Array]:
    """Return where runs begin and end, m, refined by halving; the seen side of the last bracket is taken."""
    inside = np.concatenate([start, end])
    step = np.concatenate([np.full(len(start), -1), np.full(len(end), 1)])
    cameras, arcs = np.tile(camera, 2), np.tile(arc, 2)
    good = ways.at_m[inside]
    outside = np.clip(inside + step, ways.sample_ptr[arcs], ways.sample_ptr[arcs + 1] - 1)
    bad = ways.at_m[outside]
    open_ended = outside != inside
    for _ in range(_HALVINGS):
        middle = 0.5 * (good + bad)
        xy, heading = ways.pose(arcs, middle)
        places = _points(ways, features, xy, heading, ways.height(arcs, middle))
        hit = seen_pairs(places, cameras, views, solids)
        good, bad = np.where(open_ended & hit, middle, good), np.where(open_ended & ~hit, middle, bad)
    return good[: len(start)], good[len(start) :]

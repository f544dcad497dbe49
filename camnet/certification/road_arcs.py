"""Directed roads for certification: straight pieces, travelled arcs and the turns between them, as flat arrays.

An *arc* is one direction of one road between two junctions, or one turn over a junction; a *piece* is one straight
part of an arc. A target of the road-bound class travels along arcs, turns into any successor at an arc's end and never
turns around in between.

A piece holds one or more *lines*, the lanes, side by side with one common arc length. A target may change from line to
line at any time, so a place of an arc is in view only where every line is: nothing can pass such a cross-section
unseen (``arcs_from_lanes``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.errors import CertificateError
from camnet.types import Array, IntArray

__all__ = ["RoadArcs", "arcs_from_lanes", "arcs_from_polylines", "arcs_from_roads"]

#: ends closer than this (m) are one junction
_JOIN_M = 1e-3


@dataclass(frozen=True, eq=False)
class RoadArcs:
    """A road network as arrays.

    Attributes
    ----------
    start_xy, direction_xy : (S, 2) first point (m) of each piece's middle, and its change per metre of arc length (a
        unit vector where the piece has one level line)
    piece_length_m : (S,) length of each piece, m: of its longest line, slopes included
    piece_arc : (S,) arc that it belongs to, ascending
    piece_offset_m : (S,) arc length at its start, m
    length_m : (A,) length of each arc, m
    successor_ptr, successor : (A + 1,), (T,) arcs that may follow arc a: ``successor[ptr[a]:ptr[a + 1]]``
    line_ptr, line_start_xy, line_direction_xy : (S + 1,), (L, 2), (L, 2) lines of piece k, as ``start_xy`` and
        ``direction_xy``: ``line_ptr[k]:line_ptr[k + 1]``
    """

    start_xy: Array
    direction_xy: Array
    piece_length_m: Array
    piece_arc: IntArray
    piece_offset_m: Array
    length_m: Array
    successor_ptr: IntArray
    successor: IntArray
    line_ptr: IntArray
    line_start_xy: Array
    line_direction_xy: Array

    @property
    def n_arcs(self) -> int:
        """Number of arcs."""
        return len(self.length_m)

    def position(self, arc: int, s_m: float) -> Array:
        """Point (2,) of one arc at an arc length, m."""
        first, last = np.searchsorted(self.piece_arc, [arc, arc + 1])
        k = first + int(np.searchsorted(self.piece_offset_m[first:last], s_m, side="right")) - 1
        k = min(max(k, int(first)), int(last) - 1)
        return np.asarray(self.start_xy[k] + (s_m - self.piece_offset_m[k]) * self.direction_xy[k])


def arcs_from_polylines(polylines: Sequence[Array], successors: Sequence[Sequence[int]]) -> RoadArcs:
    """Build arcs of one line each from directed polylines (n_i, 2), m, and the arcs that may follow each.

    Raises
    ------
    CertificateError
        if a polyline has no length or a successor does not exist.
    """
    _check(len(polylines), polylines, successors)
    counts = np.array([len(line) for line in polylines], dtype=np.int64)
    points = np.concatenate([np.asarray(line, dtype=float).reshape(-1, 2) for line in polylines])
    owner = np.repeat(np.arange(len(counts)), counts)
    delta = np.diff(points, axis=0)
    length = np.linalg.norm(delta, axis=1)
    keep = (owner[1:] == owner[:-1]) & (length > 1e-9)
    arc, length, delta, start = owner[:-1][keep], length[keep], delta[keep], points[:-1][keep]
    one = np.ones(len(arc), dtype=np.int64)
    return _assemble(arc, length, start, delta / length[:, None], one, successors)


def arcs_from_lanes(
    lanes: Sequence[Sequence[Array]],
    successors: Sequence[Sequence[int]],
    extra_m: Sequence[float] | None = None,
) -> RoadArcs:
    """Build arcs from the lines of their lanes and the arcs that may follow each.

    Parameters
    ----------
    lanes : for each arc the lines (n, 2) or (n, 3) of its lanes, m; equal shares of the way along them lie side by side
    successors : for each arc the numbers of those that may follow
    extra_m : for each arc length that a target may drive beyond that of its lanes (lane changes), spread over it, m

    Raises
    ------
    CertificateError
        if an arc has no lane, a lane no length, or a successor does not exist.
    """
    _check(len(lanes), [line for of in lanes for line in of], successors)
    extra = [0.0] * len(lanes) if extra_m is None else extra_m
    parts = [_side_by_side(k, of, e) for k, (of, e) in enumerate(zip(lanes, extra, strict=True))]
    pieces = [len(length) for _, _, length in parts]
    start, direction = (np.concatenate([p[k].swapaxes(0, 1).reshape(-1, 2) for p in parts]) for k in (0, 1))
    return _assemble(
        np.repeat(np.arange(len(parts)), pieces),
        np.concatenate([length for _, _, length in parts]),
        start,
        direction,
        np.repeat([len(of) for of in lanes], pieces),
        successors,
    )


def _check(arcs: int, polylines: Sequence[Array], successors: Sequence[Sequence[int]]) -> None:
    if arcs != len(successors):
        raise CertificateError(f"{arcs} roads but {len(successors)} lists of successors")
    if len(polylines) < max(arcs, 1) or min(len(line) for line in polylines) < 2:
        raise CertificateError("every road needs at least two points")


def _assemble(
    arc: IntArray,
    length: Array,
    line_start: Array,
    line_direction: Array,
    lines: IntArray,
    successors: Sequence[Sequence[int]],
) -> RoadArcs:
    """Build the record from pieces (S,), sorted by arc, and their lines (L, 2), ``lines[k]`` of them for piece k."""
    n = len(successors)
    total = np.bincount(arc, weights=length, minlength=n).astype(np.float64)
    if not (np.isfinite(total).all() and (total > 0.0).all() and len(total) == n):
        raise CertificateError(f"road {int(np.argmin(np.nan_to_num(total)))} has no length")
    travelled = np.cumsum(length) - length
    first = np.searchsorted(arc, np.arange(n))
    ptr = np.concatenate([[0], np.cumsum([len(s) for s in successors])]).astype(np.int64)
    following = np.fromiter((a for s in successors for a in s), dtype=np.int64, count=int(ptr[-1]))
    if len(following) and not (following.min() >= 0 and following.max() < n):
        raise CertificateError(f"successors must be numbers of roads, 0 to {n - 1}")
    line_ptr = np.concatenate([[0], np.cumsum(lines)]).astype(np.int64)
    middle = [
        np.add.reduceat(of, line_ptr[:-1], axis=0) / lines[:, None] for of in (line_start, line_direction)
    ]
    return RoadArcs(
        start_xy=middle[0],
        direction_xy=middle[1],
        piece_length_m=length,
        piece_arc=arc.astype(np.int64),
        piece_offset_m=travelled - travelled[first][arc],
        length_m=total,
        successor_ptr=ptr,
        successor=following,
        line_ptr=line_ptr,
        line_start_xy=line_start,
        line_direction_xy=line_direction,
    )


def _side_by_side(number: int, lanes: Sequence[Array], extra_m: float) -> tuple[Array, Array, Array]:
    """Cut the lanes of one arc at common shares of their ways.

    Returns starts (K, S, 2) and changes per metre of arc length (K, S, 2) of K lanes in S straight pieces, and the
    pieces' lengths (S,): those of the longest lane.
    """
    shares, lines = [], []
    for lane in lanes:
        points = np.asarray(lane, dtype=float)
        if points.ndim != 2 or not np.isfinite(points).all():
            raise CertificateError(f"road {number}: its points must be finite numbers")
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        if not way[-1] > 1e-9:
            raise CertificateError(f"road {number} has no length")
        shares.append(way / way[-1])
        lines.append(points)
    cuts = np.unique(np.concatenate(shares))
    cuts = cuts[np.r_[True, np.diff(cuts) > 1e-12]]
    cuts[-1] = 1.0
    at = np.stack(
        [
            np.stack([np.interp(cuts, share, line[:, k]) for k in range(line.shape[1])], axis=-1)
            for share, line in zip(shares, lines, strict=True)
        ]
    )
    steps = np.diff(at, axis=1)
    length = np.linalg.norm(steps, axis=2).max(axis=0)
    length = length * (1.0 + extra_m / length.sum())
    return at[:, :-1, :2], steps[..., :2] / length[:, None], length


def arcs_from_roads(roads: Sequence[Array], closed: Sequence[bool] | None = None) -> RoadArcs:
    """Build both directions of undirected roads (n_i, 2) that meet where they share an end.

    At a junction the target may take every road but the one it came from; it turns around only where there is no other.
    ``closed`` roads lead back into themselves.
    """
    loops = list(closed) if closed is not None else [False] * len(roads)
    lines: list[Array] = []
    ends: list[tuple[int, int]] = []
    junctions: dict[tuple[int, int], int] = {}
    for road, loop in zip(roads, loops, strict=True):
        points = np.asarray(road, dtype=float).reshape(-1, 2)
        if loop:
            points = np.concatenate([points, points[:1]])
        a, b = (_junction(points[i], junctions) for i in (0, -1))
        lines += [points, points[::-1]]
        ends += [(a, b), (b, a)]
    leaving: dict[int, list[int]] = {}
    for arc, (a, _) in enumerate(ends):
        leaving.setdefault(a, []).append(arc)
    following = []
    for arc, (_, b) in enumerate(ends):
        if loops[arc // 2]:
            following.append([arc])
            continue
        ways = [w for w in leaving[b] if w != arc ^ 1]
        following.append(ways or [arc ^ 1])
    return arcs_from_polylines(lines, following)


def _junction(point: Array, known: dict[tuple[int, int], int]) -> int:
    key = (round(float(point[0]) / _JOIN_M), round(float(point[1]) / _JOIN_M))
    return known.setdefault(key, len(known))

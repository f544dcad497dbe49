"""Directed roads for certification: straight pieces, travelled arcs and the turns between them, as flat arrays.

An *arc* is one direction of one road between two junctions; a *piece* is one straight part of an arc. A target of
the road-bound class travels along arcs, turns into any successor at an arc's end and never turns around in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.errors import CertificateError
from camnet.types import Array, IntArray

__all__ = ["RoadArcs", "arcs_from_polylines", "arcs_from_roads"]

#: ends closer than this (m) are one junction
_JOIN_M = 1e-3


@dataclass(frozen=True, eq=False)
class RoadArcs:
    """A road network as arrays.

    Attributes
    ----------
    start_xy, direction_xy : (S, 2) first point (m) and unit direction of each piece
    piece_length_m : (S,) length of each piece, m
    piece_arc : (S,) arc that it belongs to, ascending
    piece_offset_m : (S,) arc length at its start, m
    length_m : (A,) length of each arc, m
    successor_ptr, successor : (A + 1,), (T,) arcs that may follow arc a: ``successor[ptr[a]:ptr[a + 1]]``
    """

    start_xy: Array
    direction_xy: Array
    piece_length_m: Array
    piece_arc: IntArray
    piece_offset_m: Array
    length_m: Array
    successor_ptr: IntArray
    successor: IntArray

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
    """Build arcs from directed polylines (n_i, 2), m, and the arcs that may follow each.

    Raises
    ------
    CertificateError
        if a polyline has no length or a successor does not exist.
    """
    if len(polylines) != len(successors):
        raise CertificateError(f"{len(polylines)} polylines but {len(successors)} lists of successors")
    counts = np.array([len(line) for line in polylines], dtype=np.int64)
    if len(counts) == 0 or counts.min() < 2:
        raise CertificateError("every road needs at least two points")
    points = np.concatenate([np.asarray(line, dtype=float).reshape(-1, 2) for line in polylines])
    owner = np.repeat(np.arange(len(counts)), counts)
    same = owner[1:] == owner[:-1]
    delta = np.diff(points, axis=0)
    length = np.linalg.norm(delta, axis=1)
    keep = same & (length > 1e-9)
    arc, length, delta, start = owner[:-1][keep], length[keep], delta[keep], points[:-1][keep]
    total = np.bincount(arc, weights=length, minlength=len(counts)).astype(np.float64)
    if not (total > 0.0).all():
        raise CertificateError(f"road {int(np.argmin(total))} has no length")
    travelled = np.cumsum(length) - length
    first = np.searchsorted(arc, np.arange(len(counts)))
    ptr = np.concatenate([[0], np.cumsum([len(s) for s in successors])]).astype(np.int64)
    following = np.fromiter((a for s in successors for a in s), dtype=np.int64, count=int(ptr[-1]))
    if len(following) and not (following.min() >= 0 and following.max() < len(counts)):
        raise CertificateError(f"successors must be numbers of roads, 0 to {len(counts) - 1}")
    return RoadArcs(
        start_xy=start,
        direction_xy=delta / length[:, None],
        piece_length_m=length,
        piece_arc=arc.astype(np.int64),
        piece_offset_m=travelled - travelled[first][arc],
        length_m=total,
        successor_ptr=ptr,
        successor=following,
    )


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

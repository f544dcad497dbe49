r"""Which stretches of road each camera sees: exact intervals, occluders included, for thousands of cameras at once.

| symbol | name | shape | meaning |
| --- | --- | --- | --- |
| A x <= b - rho | ``views`` | (C, F, 3), (C, F) | a ball of radius rho inside a view; exact for unit normals |
| p(s) = p0 + s d | lines of ``RoadArcs`` | (L, 2) | straight lanes of road pieces at the target's height z |

A place of a piece is in view where every line of it is, so that no target passes the cross-section unseen.

A convex view cuts a straight piece in one interval, and so does an occluder's shadow, a convex polygon in the targets'
plane (``shadows``). ``hidden_interval`` finds that of a single point another way: c + lambda (p(s) - c) is inside the
occluder for some lambda in (0, 1]; with m = lambda s that is a convex polygon in (lambda, m), whose corners
hold the extremes of s = m / lambda (docs/theory.md, section 9). Pairs of cameras and pieces come from an STR-tree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from camnet.certification.road_arcs import RoadArcs
from camnet.certification.shadows import shadow_polygon
from camnet.errors import CertificateError
from camnet.types import Array, IntArray

__all__ = ["Coverage", "Views", "clip_polygon", "cover_roads", "hidden_interval"]

#: intervals shorter than this (m) are contact, not view
_CONTACT_M = 1e-9
#: distance to a face that does not limit
_UNLIMITED_M = 1e9
#: numbers in one intermediate array
_MOST_NUMBERS = 20_000_000


@dataclass(frozen=True, eq=False)
class Views:
    """Convex fields of view, in the world frame.

    Attributes
    ----------
    normals, offsets : (C, F, 3), (C, F) half-spaces A x <= b with unit normals
    bounds_xy : (C, 4) smallest x, y and largest x, y of each
    position : (C, 3) optical centres, m
    """

    normals: Array
    offsets: Array
    bounds_xy: Array
    position: Array

    @classmethod
    def create(cls, normals: Array, offsets: Array, corners: Array, position: Array) -> Views:
        """Take half-spaces, corners (C, K, 3) and optical centres (C, 3)."""
        if normals.ndim != 3 or offsets.shape != normals.shape[:2] or len(corners) != len(normals):
            raise CertificateError(
                f"views: normals {normals.shape}, offsets {offsets.shape}, corners {corners.shape} do not fit"
            )
        bounds = np.concatenate([corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)], axis=1)
        return cls(normals, offsets, bounds, np.asarray(position, dtype=float).reshape(-1, 3))

    def __len__(self) -> int:
        """Return the number of cameras."""
        return len(self.offsets)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Stretches of arcs in view of one camera each, sorted by arc and start.

    Attributes
    ----------
    arc, camera : (V,) what sees what
    start_m, end_m : (V,) arc lengths, m
    depth_m : (V,) radius of the largest level disc, beyond the target's extent, that fits the view on the stretch, m
    deepest_m : (V,) arc length where it fits, m
    """

    arc: IntArray
    camera: IntArray
    start_m: Array
    end_m: Array
    depth_m: Array
    deepest_m: Array


def cover_roads(
    roads: RoadArcs,
    views: Views,
    height_m: float,
    extent_m: float,
    occluders: Sequence[tuple[Array, Array]] = (),
) -> Coverage:
    """Return what each camera sees of a road network.

    Parameters
    ----------
    roads, views : the network and the cameras
    height_m : height of the target's reference point above the plane z = 0, m
    extent_m : radius of the ball about it that must be in view, m
    occluders : convex polytopes (B, c), B x <= c with unit normals; their shadows are grown by the extent
    """
    camera, piece = _near_pairs(roads, views, extent_m)
    lines = np.diff(roads.line_ptr)[piece]
    found = [
        _cover(roads, views, height_m, extent_m, occluders, camera[lines == n], piece[lines == n])
        for n in np.unique(lines).tolist()
    ]
    if not found:
        nothing = np.zeros(0, dtype=np.int64)
        return Coverage(nothing, nothing, *(np.zeros(0) for _ in range(4)))
    arc, seen_by, start, end, depth, at = (np.concatenate([part[k] for part in found]) for k in range(6))
    order = np.lexsort((start, arc))
    return Coverage(arc[order], seen_by[order], start[order], end[order], depth[order], at[order])


def _cover(
    roads: RoadArcs,
    views: Views,
    height_m: float,
    extent_m: float,
    occluders: Sequence[tuple[Array, Array]],
    camera: IntArray,
    piece: IntArray,
) -> tuple[IntArray, IntArray, Array, Array, Array, Array]:
    """Return the columns of ``Coverage``, unsorted, for pairs of cameras and pieces with equally many lines."""
    spare, slope = _linear_depth(roads, views, height_m, extent_m, camera, piece)
    low, high = _interval(spare, slope, roads.piece_length_m[piece])
    seen = high > low + _CONTACT_M
    camera, piece = camera[seen], piece[seen]
    low, high, spare, slope = low[seen], high[seen], spare[seen], slope[seen]
    for occluder in occluders:
        camera, piece, low, high, keep = _subtract_shadow(
            roads, views, height_m, extent_m, occluder, camera, piece, low, high
        )
        spare, slope = spare[keep], slope[keep]
    spare, slope = _in_plane(views, camera, spare, slope)
    at, depth = _deepest_in_parts(spare, slope, low, high)
    offset = roads.piece_offset_m[piece]
    return roads.piece_arc[piece], camera, low + offset, high + offset, depth, at + offset


def _near_pairs(roads: RoadArcs, views: Views, extent_m: float) -> tuple[IntArray, IntArray]:
    """Return camera and piece numbers whose boxes meet."""
    length = np.repeat(roads.piece_length_m, np.diff(roads.line_ptr))[:, None]
    ends = roads.line_start_xy + length * roads.line_direction_xy
    low = np.minimum.reduceat(np.minimum(roads.line_start_xy, ends), roads.line_ptr[:-1])
    high = np.maximum.reduceat(np.maximum(roads.line_start_xy, ends), roads.line_ptr[:-1])
    tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    camera, piece = tree.query(shapely.box(*views.bounds_xy.T))
    return camera.astype(np.int64), piece.astype(np.int64)


def _linear_depth(
    roads: RoadArcs, views: Views, height_m: float, extent_m: float, camera: IntArray, piece: IntArray
) -> tuple[Array, Array]:
    """Return (pairs, K F) arrays: the distance of line i to face k is ``spare - slope s``, less the extent.

    The pieces have equally many lines K; columns run over the lines, and over the faces of each.
    """
    normals = views.normals[camera][:, None]  # (pairs, 1, F, 3)
    lines = _lines(roads, piece)
    start, direction = roads.line_start_xy[lines], roads.line_direction_xy[lines]  # (pairs, K, 2)
    spare = (views.offsets[camera] - extent_m)[:, None] - normals[..., 2] * height_m
    spare = spare - (normals[..., 0] * start[..., :1] + normals[..., 1] * start[..., 1:])
    slope = normals[..., 0] * direction[..., :1] + normals[..., 1] * direction[..., 1:]
    return spare.reshape(len(piece), -1), slope.reshape(len(piece), -1)


def _lines(roads: RoadArcs, piece: IntArray) -> IntArray:
    """Return the numbers of the lines of pieces that have equally many: (pieces, K)."""
    count = int(roads.line_ptr[piece[0] + 1] - roads.line_ptr[piece[0]]) if len(piece) else 1
    return np.asarray(roads.line_ptr[piece][:, None] + np.arange(count), dtype=np.int64)


def _in_plane(views: Views, camera: IntArray, spare: Array, slope: Array) -> tuple[Array, Array]:
    """Measure distances to faces within the target's plane, in which its uncertainty is a disc.

    A disc of radius r is inside a half-space when the distance is at least r |n_xy|. Horizontal faces do not limit it;
    they get a distance that never decides.
    """
    share = np.linalg.norm(views.normals[camera][..., :2], axis=-1)
    share = np.tile(share, spare.shape[1] // share.shape[1])
    flat = share < 1e-9
    spare, slope = spare / np.where(flat, 1.0, share), slope / np.where(flat, 1.0, share)
    spare[flat], slope[flat] = _UNLIMITED_M, 0.0
    return spare, slope


def _interval(spare: Array, slope: Array, length: Array) -> tuple[Array, Array]:
    """Solve slope s <= spare for s in [0, length]; an empty answer has high < low."""
    flat = np.abs(slope) < 1e-12
    ratio = spare / np.where(flat, 1.0, slope)
    low = np.where(slope < 0.0, ratio, 0.0)
    high = np.where(slope > 0.0, ratio, np.inf)
    low[flat] = 0.0
    high[flat] = np.where(spare[flat] >= 0.0, np.inf, -1.0)
    return np.maximum(low.max(axis=1), 0.0), np.minimum(high.min(axis=1), length)


def _deepest_in_parts(spare: Array, slope: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return ``_deepest`` of many rows with bounded memory."""
    rows = max(1, _MOST_NUMBERS // spare.shape[1] ** 3)
    parts = [slice(k, k + rows) for k in range(0, max(len(low), 1), rows)]
    found = [_deepest(spare[p], slope[p], low[p], high[p]) for p in parts]
    return np.concatenate([at for at, _ in found]), np.concatenate([depth for _, depth in found])


def _deepest(spare: Array, slope: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Maximise min_k (spare - slope s) over [low, high]: concave, so at an end or where two faces are equally far."""
    faces = spare.shape[1]
    i, j = np.triu_indices(faces, 1)
    difference = slope[:, i] - slope[:, j]
    parallel = np.abs(difference) < 1e-12
    equal = (spare[:, i] - spare[:, j]) / np.where(parallel, 1.0, difference)
    candidates = np.concatenate(
        [np.where(parallel, low[:, None], equal), low[:, None], high[:, None]], axis=1
    )
    candidates = np.clip(candidates, low[:, None], high[:, None])
    depth = (spare[:, None, :] - slope[:, None, :] * candidates[:, :, None]).min(axis=2)
    best = np.argmax(depth, axis=1)
    rows = np.arange(len(best))
    return candidates[rows, best], depth[rows, best]


def _subtract_shadow(
    roads: RoadArcs,
    views: Views,
    height_m: float,
    extent_m: float,
    occluder: tuple[Array, Array],
    camera: IntArray,
    piece: IntArray,
    low: Array,
    high: Array,
) -> tuple[IntArray, IntArray, Array, Array, IntArray]:
    """Cut an occluder's shadow out of the intervals; the last result numbers the rows that the new ones come from."""
    rows: list[tuple[int, float, float]] = []
    lines = _lines(roads, piece)
    dark = {
        c: shadow_polygon(views.position[c], *occluder, height_m, extent_m)
        for c in np.unique(camera).tolist()
    }
    for k in range(len(camera)):
        parts = [(float(low[k]), float(high[k]))]
        for line in lines[k].tolist():
            ends = roads.line_start_xy[line] + np.array([[0.0], [high[k]]]) * roads.line_direction_xy[line]
            hidden = shapely.intersection(shapely.LineString(ends), dark[int(camera[k])])
            if hidden.is_empty:
                continue
            along = (shapely.get_coordinates(hidden) - ends[0]) @ (ends[1] - ends[0]) * high[k]
            along = along / max(float(((ends[1] - ends[0]) ** 2).sum()), _CONTACT_M**2)
            parts = [
                part for a, b in parts for part in ((a, min(b, along.min())), (max(a, along.max()), b))
                if part[1] - part[0] > _CONTACT_M
            ]  # fmt: skip
        rows += [(k, float(a), float(b)) for a, b in parts]
    keep = np.array([r[0] for r in rows], dtype=np.int64)
    return camera[keep], piece[keep], np.array([r[1] for r in rows]), np.array([r[2] for r in rows]), keep


def hidden_interval(
    eye: Array, start: Array, direction: Array, length_m: float, normals: Array, limits: Array
) -> tuple[float, float] | None:
    """Return the interval of s in [0, length] for which an occluder cuts the line of sight to start + s direction.

    Parameters
    ----------
    eye : (3,) optical centre, m
    start, direction, length_m : the straight line, (3,) m, (3,) unit, m
    normals, limits : (F, 3), (F,) convex occluder B x <= c

    Returns
    -------
    tuple or None
        None where nothing is hidden.
    """
    # B (eye + lambda (start - eye) + m direction) <= c, 0 <= m <= lambda length, lambda <= 1
    polygon = [(0.0, 0.0), (1.0, 0.0), (1.0, length_m)]
    for a, b, c in zip(normals @ (start - eye), normals @ direction, limits - normals @ eye, strict=True):
        polygon = clip_polygon(polygon, float(a), float(b), float(c))
        if not polygon:
            return None
    ratios = [m / lam for lam, m in polygon if lam > 1e-12]
    if len(ratios) < len(polygon):
        return 0.0, length_m  # the eye itself is inside: nothing can be seen
    return min(ratios), max(ratios)


def clip_polygon(
    polygon: list[tuple[float, float]], a: float, b: float, c: float
) -> list[tuple[float, float]]:
    """Keep the part of a convex polygon with a x + b y <= c."""
    out: list[tuple[float, float]] = []
    for (x0, y0), (x1, y1) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        f0, f1 = a * x0 + b * y0 - c, a * x1 + b * y1 - c
        if f0 <= 0.0:
            out.append((x0, y0))
        if (f0 < 0.0 < f1) or (f1 < 0.0 < f0):
            t = f0 / (f0 - f1)
            out.append((x0 + t * (x1 - x0), y0 + t * (y1 - y0)))
    return out

"""What cameras see of the ground, place by place on a grid, and of roads by length: by how many, with which pixels.

A place is a point at a height above the ground. A camera sees it where the simulator's own test says so
(``sight_lines.seen_by``): in the frustum, and no solid meets the line of sight. Places inside solids are no ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from camnet.certification.coverage import Coverage
from camnet.certification.lens_views import Watch
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.sight_lines import Solids, seen_by
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Grid", "GroundCover", "cover_ground", "lengths_by_cameras", "stretches_inside"]

#: a place on the face of a solid belongs to it, m
_ON_FACE_M = 1e-9
#: places looked at in one go
_CHUNK = 500_000


@dataclass(frozen=True, slots=True)
class Grid:
    """Square places of side ``step_m`` from the corner (``x_m``, ``y_m``) on; places stand for their middles."""

    x_m: float
    y_m: float
    step_m: float
    columns: int
    rows: int

    @classmethod
    def over(cls, bounds: tuple[float, float, float, float], step_m: float) -> Grid:
        """Cover a box (smallest x, y, largest x, y), m."""
        x0, y0, x1, y1 = bounds
        columns, rows = (max(1, math.ceil((b - a) / step_m - 1e-9)) for a, b in ((x0, x1), (y0, y1)))
        return cls(x0, y0, step_m, columns, rows)

    @property
    def x(self) -> Array:
        """Middles of the columns, m."""
        return np.asarray(self.x_m + self.step_m * (np.arange(self.columns) + 0.5))

    @property
    def y(self) -> Array:
        """Middles of the rows, m."""
        return np.asarray(self.y_m + self.step_m * (np.arange(self.rows) + 0.5))

    def window(self, bounds: Array) -> tuple[slice, slice]:
        """Return the rows and columns whose middles can be in a box (4,), m."""
        first = np.floor((bounds[:2] - (self.x_m, self.y_m)) / self.step_m - 0.5)
        last = np.ceil((bounds[2:] - (self.x_m, self.y_m)) / self.step_m + 0.5)
        (c0, r0), (c1, r1) = (
            np.clip(edge, 0, (self.columns, self.rows)).astype(int).tolist() for edge in (first, last)
        )
        return slice(r0, max(r0, r1)), slice(c0, max(c0, c1))


@dataclass(frozen=True, eq=False)
class GroundCover:
    """What is seen of the places of a grid.

    Attributes
    ----------
    grid : the places
    ground : (rows, columns) which of them are ground in the counted areas
    cameras : (rows, columns) how many cameras see each
    px_per_m : (rows, columns) most pixels per metre of any camera that sees it; 0 where none does; None: unknown
    seen_by : (C,) number of counted places that each camera sees
    """

    grid: Grid
    ground: BoolArray
    cameras: IntArray
    px_per_m: Array | None
    seen_by: IntArray

    def shares(self, part: BoolArray | None = None) -> list[dict[str, float]]:
        """Return how much ground is seen by 0, 1, 2, ... cameras: ``cameras``, ``m2``, ``share``."""
        chosen = self.ground if part is None else self.ground & part
        counts = np.bincount(self.cameras[chosen], minlength=1)
        total = max(int(counts.sum()), 1)
        cell = self.grid.step_m**2
        return [
            {"cameras": k, "m2": float(n) * cell, "share": float(n) / total} for k, n in enumerate(counts)
        ]

    def area_m2(self, part: BoolArray | None = None) -> float:
        """Return the area of the counted ground, m2."""
        return float((self.ground if part is None else self.ground & part).sum()) * self.grid.step_m**2


def cover_ground(
    grid: Grid, area: shapely.Geometry, watch: Watch, solids: Solids, height_m: float
) -> GroundCover:
    """Return what the cameras see of the ground in an area, ``height_m`` above the plane z = 0."""
    ground = _ground(grid, area, solids, height_m)
    cameras = np.zeros((grid.rows, grid.columns), dtype=np.int64)
    density = None if watch.focal_px is None else np.zeros((grid.rows, grid.columns))
    seen_count = np.zeros(len(watch.names), dtype=np.int64)
    x, y = grid.x, grid.y
    for camera in range(len(watch.names)):
        pieces = np.flatnonzero(watch.owner == camera)
        bounds = watch.views.bounds_xy[pieces]
        whole = grid.window(np.r_[bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)])
        seen = np.zeros((whole[0].stop - whole[0].start, whole[1].stop - whole[1].start), dtype=bool)
        if seen.size == 0:
            continue
        points = _points(x[whole[1]], y[whole[0]], height_m)
        todo = ground[whole].ravel().copy()
        for piece in pieces.tolist():
            places = np.flatnonzero(todo)
            one = watch.one(piece)
            for k in range(0, len(places), _CHUNK):
                at = places[k : k + _CHUNK]
                hit = seen_by(points[at][:, None], one, solids)[:, 0]
                seen.ravel()[at[hit]] = True
                todo[at[hit]] = False
        cameras[whole] += seen
        seen_count[camera] = int(seen.sum())
        if density is not None:
            best = watch.density(camera, points).reshape(seen.shape)
            density[whole] = np.where(seen, np.maximum(density[whole], best), density[whole])
    return GroundCover(grid, ground, cameras, density, seen_count)


def _points(x: Array, y: Array, height_m: float) -> Array:
    gx, gy = np.meshgrid(x, y)
    return np.stack([gx.ravel(), gy.ravel(), np.full(gx.size, height_m)], axis=1)


def _ground(grid: Grid, area: shapely.Geometry, solids: Solids, height_m: float) -> BoolArray:
    """Return which places are in the area and in no solid."""
    gx, gy = np.meshgrid(grid.x, grid.y)
    shapely.prepare(area)
    ground: BoolArray = np.asarray(shapely.contains_xy(area, gx, gy), dtype=np.bool_)
    for i in range(len(solids.ptr) - 1):
        part = slice(int(solids.ptr[i]), int(solids.ptr[i + 1]))
        inside = np.ones(ground.shape, dtype=np.bool_)
        for normal, limit in zip(solids.normals[part], solids.limits[part].tolist(), strict=True):
            inside &= normal[0] * gx + normal[1] * gy + normal[2] * height_m <= limit + _ON_FACE_M
        ground &= ~inside
    return ground


def lengths_by_cameras(
    coverage: Coverage, length_m: Array, chosen: BoolArray, inside: Coverage | None = None
) -> list[float]:
    """Return the length (m) of the chosen arcs (A,) of which 0, 1, 2, ... cameras see the whole cross-section.

    Only the stretches of ``inside`` count, if given: what one stands for is of no matter, and none meets another.
    """
    if inside is None:
        n = np.flatnonzero(chosen)
        zero = np.zeros(len(n))
        inside = Coverage(n, n, zero, length_m[n], zero, zero)
    most = len(coverage.arc) + 1  # a place in a stretch that counts has this much more
    parts = ((coverage, 1), (inside, most))
    rows = [
        (of.arc[keep], at[keep], np.full(int(keep.sum()), sign * weight))
        for of, weight in parts
        for keep in (chosen[of.arc],)
        for at, sign in ((of.start_m, 1), (of.end_m, -1))
    ]
    arc, at, step = (np.concatenate([row[k] for row in rows]) for k in range(3))
    order = np.lexsort((step, at, arc))
    arc, at, count = arc[order], at[order], np.cumsum(step[order])
    ahead = np.r_[np.where(arc[1:] == arc[:-1], np.diff(at), 0.0), 0.0][: len(at)]
    counted = count >= most
    lengths = np.bincount(count[counted] - most, weights=ahead[counted], minlength=1)
    return [float(v) for v in lengths]


def stretches_inside(roads: RoadArcs, area: shapely.Geometry) -> Coverage:
    """Return the stretches of arcs whose middle line is in an area; the columns ``camera`` and ``depth_m`` are 0."""
    ends = roads.start_xy + roads.piece_length_m[:, None] * roads.direction_xy
    lines = shapely.linestrings(np.stack([roads.start_xy, ends], axis=1))
    shapely.prepare(area)
    rows: list[tuple[int, float, float]] = []
    for k in np.flatnonzero(shapely.intersects(area, lines)).tolist():
        offset, arc = float(roads.piece_offset_m[k]), int(roads.piece_arc[k])
        for part in shapely.get_parts(shapely.intersection(lines[k], area)):
            s = (shapely.get_coordinates(part) - roads.start_xy[k]) @ roads.direction_xy[k]
            if len(s) > 1 and float(np.ptp(s)) > 0.0:
                rows.append((arc, offset + float(s.min()), offset + float(s.max())))
    table = np.array(sorted(rows), dtype=float).reshape(-1, 3)
    arcs = table[:, 0].astype(np.int64)
    return Coverage(arcs, 0 * arcs, table[:, 1], table[:, 2], 0.0 * table[:, 1], table[:, 1])

r"""Views and regions in the targets' plane that are not convex: operating regions of any outline, views with shadows.

| symbol | name | meaning |
| --- | --- | --- |
| V | ``PolygonView`` | polygon, possibly in parts and with holes |
| depth(p) | ``depth`` | distance from p to the border of V, negative outside: the largest disc about p |

What occluders hide is in ``shadows``; here they are cut into convex solids, none of them smaller than the occluder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike

from camnet.certification.coverage import Coverage
from camnet.certification.road_arcs import RoadArcs
from camnet.geometry.regions import CylinderRegion, PolytopeRegion, Region
from camnet.types import Array

__all__ = ["PolygonView", "convex_solids", "cover_regions", "inscribed_radius"]

#: arcs of eroded outlines are polygons of this many pieces a quarter turn
_QUARTER = 16
#: what is thinner than this (m) is contact
_CONTACT_M = 1e-9
#: places at which the room beside a stretch of road is measured
_SAMPLES = 33


@dataclass(frozen=True, eq=False)
class PolygonView:
    """A view or region in the targets' plane, of any outline; the counterpart of ``PlanarView`` for convex ones."""

    shape: shapely.Geometry

    @property
    def possible(self) -> bool:
        """Whether anything can be seen."""
        return not self.shape.is_empty

    def depth(self, points: ArrayLike) -> Array:
        """Radius (...,) of the largest disc about points (..., 2) inside the view, m; negative outside."""
        xy = np.asarray(points, dtype=float)
        if self.shape.is_empty:
            return np.full(xy.shape[:-1], -np.inf)
        places = shapely.points(xy)
        away = shapely.distance(places, self.shape.boundary)
        return np.asarray(np.where(shapely.intersects(self.shape, places), away, -away))


def inscribed_radius(view: PolygonView) -> float:
    """Return the radius of a largest disc inside, m; never above the true one."""
    parts = [p for p in shapely.get_parts(view.shape) if p.area > 0.0]
    if not parts:
        return 0.0
    centres = [shapely.maximum_inscribed_circle(p, 1e-3).coords[0] for p in parts]
    return max(0.0, float(view.depth(np.array(centres)).max()))


def convex_solids(region: Region) -> list[tuple[Array, Array]]:
    """Return a solid as convex parts (B, c), B x <= c with unit normals; triangles where its outline is not convex.

    A cylinder is the prism about it, 0.12 % of its radius larger: nothing that it hides counts as seen.
    """
    if isinstance(region, PolytopeRegion):
        return [(np.asarray(region.A), np.asarray(region.b))]
    corners = region.footprint()
    if isinstance(region, CylinderRegion):
        corners = region.center[:2] + (corners - region.center[:2]) / np.cos(np.pi / len(corners))
    outline = shapely.Polygon(corners)
    if outline.convex_hull.area <= outline.area * (1.0 + 1e-9):
        cells = [outline]
    else:
        cells = list(shapely.get_parts(shapely.constrained_delaunay_triangles(outline)))
    return [_upright(cell, *(float(h) for h in region.height)) for cell in cells if cell.area > 0.0]


def _upright(cell: shapely.Polygon, low: float, high: float) -> tuple[Array, Array]:
    corners = np.asarray(shapely.geometry.polygon.orient(cell).exterior.coords)
    along = np.diff(corners, axis=0)
    normals = np.c_[along[:, 1], -along[:, 0]] / np.linalg.norm(along, axis=1, keepdims=True)
    a = np.r_[np.c_[normals, np.zeros(len(normals))], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]]
    return a, np.r_[np.einsum("fi,fi->f", normals, corners[:-1]), -low, high]


def cover_regions(
    roads: RoadArcs, outlines: Sequence[Array], extent_m: float, largest_m: Sequence[float]
) -> Coverage:
    """Return the stretches of road inside operating regions of any outline, each region one camera.

    Parameters
    ----------
    roads : the network
    outlines : corners (K, 2) of each region
    extent_m : radius of the targets' extent, which must be inside too
    largest_m : largest disc that each region's camera can hold wherever it is, m
    """
    ends = roads.start_xy + roads.piece_length_m[:, None] * roads.direction_xy
    lines = shapely.linestrings(np.stack([roads.start_xy, ends], axis=1))
    tree = shapely.STRtree(lines)
    rows: list[tuple[int, int, float, float, float, float]] = []
    for camera, corners in enumerate(outlines):
        inner = PolygonView(_eroded(shapely.Polygon(corners), extent_m))
        for k in sorted(tree.query(inner.shape, "intersects").tolist()):
            start, along = roads.start_xy[k], roads.direction_xy[k]
            for part in shapely.get_parts(shapely.intersection(lines[k], inner.shape)):
                s = np.sort((np.asarray(part.coords) - start) @ along)
                if s[-1] - s[0] <= _CONTACT_M:
                    continue
                at = np.linspace(s[0], s[-1], _SAMPLES)
                room = inner.depth(start + at[:, None] * along)
                best = int(np.argmax(room))
                depth = min(max(float(room[best]), 0.0), largest_m[camera])
                offset = float(roads.piece_offset_m[k])
                row = (
                    int(roads.piece_arc[k]),
                    camera,
                    s[0] + offset,
                    s[-1] + offset,
                    depth,
                    at[best] + offset,
                )
                rows.append(row)
    rows.sort(key=lambda row: (row[0], row[2]))
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return Coverage(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), *table[:, 2:].T)


def _eroded(outline: shapely.Polygon, extent_m: float) -> shapely.Geometry:
    """Return the points at least the extent inside, or slightly fewer where a corner points inwards."""
    if extent_m <= 0.0:
        return outline
    convex = outline.convex_hull.area <= outline.area * (1.0 + 1e-9)
    # pieces of an arc are chords: a larger radius puts all of them beyond the true arc
    margin = extent_m if convex else extent_m / np.cos(0.25 * np.pi / _QUARTER)
    return shapely.buffer(outline, -margin, quad_segs=_QUARTER, join_style="round")

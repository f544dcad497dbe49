"""Outlines of what cameras see of the ground, shadows taken out, and of what none of them sees: exact polygons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from camnet.certification.coverage import clip_polygon
from camnet.certification.free_network import ground_outline
from camnet.certification.lens_views import Watch
from camnet.certification.reachable import planar_view
from camnet.certification.shadows import shadow_polygon
from camnet.types import Array

__all__ = ["blind_spots", "polygons", "solid_outline", "view_outlines"]

#: parts smaller than this (m2) are rounding, not ground
_LEAST_M2 = 1e-4
#: corners are rounded to this (m)
_ROUND_M = 1e-3


def view_outlines(
    watch: Watch, solids: Sequence[tuple[Array, Array]], height_m: float
) -> list[shapely.Geometry]:
    """Return what each camera sees of the plane z = ``height_m``: a geometry of polygons, empty if nothing.

    Parameters
    ----------
    watch : the cameras
    solids : convex occluders (B, c), B x <= c with unit normals
    """
    views = watch.views
    own = [solid_outline(*solid, height_m) for solid in solids]
    out: list[shapely.Geometry] = []
    for camera in range(len(watch.names)):
        pieces = np.flatnonzero(watch.owner == camera).tolist()
        mine = [ground_outline(planar_view(views, k, height_m, 0.0), views.bounds_xy[k]) for k in pieces]
        shape = mine[0] if len(mine) == 1 else shapely.union_all(mine, grid_size=_ROUND_M)
        dark = [shadow_polygon(views.position[pieces[0]], *solid, height_m, 0.0) for solid in solids]
        hidden = [part for part in (*dark, *own) if part.intersects(shape)]
        out.append(shapely.difference(shape, shapely.union_all(hidden)) if hidden else shape)
    return out


def solid_outline(normals: Array, limits: Array, height_m: float) -> shapely.Geometry:
    """Return the cut of a convex solid with the plane z = ``height_m``, its faces included."""
    reach = 1e6
    polygon = [(-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)]
    for normal, limit in zip(normals.tolist(), limits.tolist(), strict=True):
        polygon = clip_polygon(polygon, normal[0], normal[1], limit - normal[2] * height_m + 1e-9)
    return shapely.Polygon(polygon) if len(polygon) >= 3 else shapely.Polygon()


def blind_spots(
    area: shapely.Geometry, views: Sequence[shapely.Geometry], solids: Sequence[shapely.Geometry]
) -> list[shapely.Polygon]:
    """Return the parts of an area that no camera sees, the largest first; ``solids`` are no ground."""
    seen = shapely.union_all([*views, *solids], grid_size=_ROUND_M)
    parts = polygons(shapely.difference(area, seen, grid_size=_ROUND_M))
    return sorted(parts, key=lambda part: -float(part.area))


def polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the polygons of a geometry, those with an area."""
    parts = shapely.get_parts(shapely.get_parts(shape))
    return [p for p in parts.tolist() if isinstance(p, shapely.Polygon) and p.area > _LEAST_M2]

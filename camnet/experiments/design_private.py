"""Areas that no camera may see: candidates that look into one of them are left out.

A camera sees an area where a point of it, between the ground and ``_HEIGHT_M``, is in its frustum and no occluder is in
between. Points are looked at on a grid of ``_STEP_M`` over the area grown by that much, so that the border counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from camnet.certification.coverage import Views
from camnet.certification.sight_lines import seen_by
from camnet.errors import CertificateError, ConfigError
from camnet.experiments.design_mounts import Candidates
from camnet.experiments.promise_world import fixed_views, solids_of
from camnet.geometry.frustum import Frustum
from camnet.geometry.mount_tolerance import MountTolerance
from camnet.geometry.settings import CameraModel
from camnet.importers.geojson_areas import NamedArea
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["keep_private", "private_points"]

#: people are seen up to this height, m
_HEIGHT_M = 2.0
#: between the points of an area that are looked at, m
_STEP_M = 0.25
#: most points of all areas
_MOST_POINTS = 200_000
#: candidates that are looked at in one go
_BLOCK = 500


def private_points(areas: Sequence[NamedArea]) -> Array:
    """Return points (n, 3) of the areas and of their borders, from the ground to the height of people, m.

    Raises
    ------
    ConfigError
        The areas are so large that there would be too many.
    """
    grown = shapely.union_all([shapely.buffer(area.shape, _STEP_M) for area in areas])
    low_x, low_y, high_x, high_y = grown.bounds
    count = 3.0 * (high_x - low_x) * (high_y - low_y) / _STEP_M**2
    if count > _MOST_POINTS:
        raise ConfigError(
            f"--private: areas within {high_x - low_x:.4g} m x {high_y - low_y:.4g} m need {count:.4g} points; at most "
            f"{_MOST_POINTS:,} are possible: give smaller areas (are they in the world's metres?)"
        )
    x, y = np.meshgrid(
        np.arange(low_x, high_x + _STEP_M, _STEP_M), np.arange(low_y, high_y + _STEP_M, _STEP_M)
    )
    inside = shapely.contains_xy(grown, x.ravel(), y.ravel())
    xy = np.c_[x.ravel(), y.ravel()][inside]
    return np.concatenate([np.c_[xy, np.full(len(xy), z)] for z in (0.0, 0.5 * _HEIGHT_M, _HEIGHT_M)])


def keep_private(
    candidates: Candidates,
    models: Sequence[CameraModel],
    network: Network,
    areas: Sequence[NamedArea],
    with_standing: bool,
    tolerance: MountTolerance | None = None,
) -> Candidates:
    """Return the candidates that see nothing of the areas, wherever within the tolerance they are installed.

    Raises
    ------
    CertificateError
        A camera that stands sees one of them, or every candidate does.
    """
    points, solids = private_points(areas)[:, None], solids_of(network)
    views, names = fixed_views(network)
    if with_standing and views is not None:
        seeing = np.flatnonzero(seen_by(points, views, solids).any(axis=0))
        if len(seeing):
            raise CertificateError(
                f"camera {names[int(seeing[0])]!r}, which stands, sees a private area: turn it, or design without the "
                "cameras that stand (--existing replace)"
            )
    rows = np.arange(len(candidates))
    blocks = [rows[k : k + _BLOCK] for k in range(0, len(rows), _BLOCK)]
    views_of = [candidates.views(models, block) for block in blocks]
    if tolerance is not None:
        reach = max(float(np.linalg.norm(Frustum.from_camera(m).corners, axis=-1).max()) for m in models)
        views_of = [_widened(v, tolerance, reach) for v in views_of]
        solids = solids.grown(-tolerance.position_m)
    sees = [seen_by(points, views, solids).any(axis=0) for views in views_of]
    allowed = rows[~np.concatenate(sees)]
    if len(allowed) == 0:
        raise CertificateError(f"all {len(rows)} candidates see a private area: add mounts that do not")
    return candidates.only(allowed)


def _widened(views: Views, tolerance: MountTolerance, reach_m: float) -> Views:
    """Return views that hold those of every pose within the tolerance, of cameras that see ``reach_m`` far.

    A face turned by theta about the optical centre and shifted by delta moves outwards by at most delta +
    2 sin(theta / 2) (reach + delta) at the points that a camera can see.
    """
    turn = 2.0 * math.sin(0.5 * math.radians(tolerance.angle_deg))
    by = tolerance.position_m + turn * (reach_m + tolerance.position_m)
    bounds = views.bounds_xy + by * np.array([-1.0, -1.0, 1.0, 1.0])
    return Views(views.normals, views.offsets + by, bounds, views.position)

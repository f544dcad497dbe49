"""Why a camera sees none of the ways: the likely reason, in words that say what to look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from camnet.certification.coverage import Views
from camnet.certification.free_network import ground_outline
from camnet.certification.promise import BlindCamera
from camnet.certification.reachable import planar_view
from camnet.types import Array, BoolArray

__all__ = ["blind_cameras"]

#: a camera further from every way than this many diameters of the site, and this far (m), stands elsewhere
_ELSEWHERE, _FAR_M = 3.0, 300.0


def blind_cameras(
    names: Sequence[str],
    views: Views,
    ways_xy: Array,
    height_m: float,
    sees: BoolArray,
    would_see: BoolArray | None = None,
) -> tuple[BlindCamera, ...]:
    """Return the cameras that see nothing of the ways, each with the likely reason.

    Parameters
    ----------
    names, views : the cameras
    ways_xy : (n, 2) places on the ways, m
    height_m : height of the ground, m
    sees : (C,) which cameras see some of the ways
    would_see : (C,) which would see some of them without occluders; None: there are none
    """
    low, high = ways_xy.min(axis=0), ways_xy.max(axis=0)
    ways = shapely.multipoints(ways_xy)
    out = []
    for k in np.flatnonzero(~sees).tolist():
        if would_see is not None and would_see[k]:
            reason = "hidden: occluders stand in front of everything that it could see of the ways"
        else:
            reason = _reason(views, k, ways, low, high, height_m)
        out.append(BlindCamera(names[k], reason))
    return tuple(out)


def _reason(
    views: Views, camera: int, ways: shapely.MultiPoint, low: Array, high: Array, height_m: float
) -> str:
    eye = views.position[camera]
    away = float(shapely.distance(shapely.Point(eye[:2]), ways))
    if away > max(_FAR_M, _ELSEWHERE * float(np.linalg.norm(high - low))):
        return _elsewhere(eye, away, low, high)
    outline = ground_outline(planar_view(views, camera, height_m, 0.0), views.bounds_xy[camera])
    if outline.is_empty:
        return (
            f"looks away: it sees no ground, {abs(eye[2] - height_m):.3g} m above it (it looks too high, or its "
            "range is too short)"
        )
    gap = float(shapely.distance(outline, ways))
    if gap > 0.0:
        return (
            f"looks away: what it sees of the ground ends {gap:.3g} m from the nearest way (it stands {away:.3g} m "
            "from one)"
        )
    return "sees places on the ways, but never the whole target"


def _elsewhere(eye: Array, away_m: float, low: Array, high: Array) -> str:
    x, y = (float(v) for v in eye[:2])
    margin = 0.5 * (high - low)
    degrees = abs(x) <= 180.0 and abs(y) <= 90.0
    centimetres = bool(((eye[:2] / 100.0 >= low - margin) & (eye[:2] / 100.0 <= high + margin)).all())
    question = "are these longitudes and latitudes?"
    if centimetres and not degrees:
        question = (
            "are these centimetres (divided by 100 it stands on the site), or longitudes and latitudes?"
        )
    elif not degrees:
        question = "are these longitudes and latitudes, centimetres, or the coordinates of another map?"
    return f"stands at ({x:g}, {y:g}), {away_m / 1000.0:.3g} km from every way: {question}"

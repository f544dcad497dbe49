r"""Transitions of a network of fixed cameras for targets that may go anywhere, such as people on an open site.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| g | ``gap_m`` | m | distance between two views on the ground |
| g / v_max | ``earliest_s`` | s | first time at which a target that left one can be in the other |
| R | ``radius_m`` | m | largest disc in the other view, less the target's extent |

A free target may stay away for ever, so no transition is certified by dwell times: ``sound`` says by how much.
What can be given is a horizon: the time within which the error's bound stays below R, so that looking at the prediction
still finds the target; with a growth model (``learned``) or from the speed bound alone (``sound``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from camnet.certification.coverage import Views, clip_polygon
from camnet.certification.planar_shapes import PolygonView, inscribed_radius
from camnet.certification.reachable import PlanarView, planar_view
from camnet.certification.shadows import shadow_polygon
from camnet.certification.transitions import GrowthModel
from camnet.certification.verdict import theorem_31
from camnet.geometry.polytope import largest_ball
from camnet.types import Array

__all__ = ["FreeTargetClass", "GroundView", "certify_free", "ground_outline", "ground_views"]


@dataclass(frozen=True, slots=True)
class FreeTargetClass:
    """Targets that go anywhere with speed at most ``v_max_mps``; ``extent_m`` is the radius of their extent."""

    v_max_mps: float
    extent_m: float = 0.0


@dataclass(frozen=True, eq=False)
class GroundView:
    """One camera's view cut with the targets' plane, shrunk by their extent.

    Attributes
    ----------
    name : of the camera
    view : half-planes; a polygon where it is not convex
    outline : polygon or polygons, empty where the camera cannot see the plane
    radius_m : radius of the largest disc inside, m
    """

    name: str
    view: PlanarView | PolygonView
    outline: shapely.Polygon | shapely.MultiPolygon
    radius_m: float

    @property
    def rings(self) -> list[tuple[str, Array]]:
        """Name and outer border (K, 2) of every part, for maps."""
        parts = [part for part in shapely.get_parts(self.outline) if part.area > 0.0]
        return [(self.name, np.asarray(part.exterior.coords)) for part in parts]


def ground_views(
    views: Views,
    names: Sequence[str],
    height_m: float,
    extent_m: float,
    occluders: Sequence[tuple[Array, Array]] = (),
) -> list[GroundView]:
    """Cut every view with the plane of the targets' reference points, less what convex occluders (B, c) hide of it."""
    out = []
    for camera, name in enumerate(names):
        view = planar_view(views, camera, height_m, extent_m)
        outline = ground_outline(view, views.bounds_xy[camera])
        radius = largest_ball(view.normals, view.offsets)[1] if outline.area > 0.0 else 0.0
        seen = GroundView(name, view, outline, max(radius, 0.0))
        out.append(_without_shadows(seen, views.position[camera], height_m, extent_m, occluders))
    return out


def _without_shadows(
    seen: GroundView, eye: Array, height_m: float, extent_m: float, occluders: Sequence[tuple[Array, Array]]
) -> GroundView:
    dark = [shadow_polygon(eye, a, c, height_m, extent_m) for a, c in occluders]
    dark = [shape for shape in dark if shape.intersection(seen.outline).area > 0.0]
    if not dark:
        return seen
    view = PolygonView(shapely.difference(seen.outline, shapely.union_all(dark)))
    return GroundView(seen.name, view, view.shape, inscribed_radius(view))


def ground_outline(view: PlanarView, bounds: Array) -> shapely.Polygon:
    """Return a convex view in the targets' plane as a polygon inside the box ``bounds`` (4,), empty if it has none."""
    if not view.possible:
        return shapely.Polygon()
    x0, y0, x1, y1 = (float(v) for v in bounds)
    polygon = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for normal, offset in zip(view.normals.tolist(), view.offsets.tolist(), strict=True):
        polygon = clip_polygon(polygon, normal[0], normal[1], offset)
    return shapely.Polygon(polygon) if len(polygon) >= 3 else shapely.Polygon()


def certify_free(
    ground: Sequence[GroundView],
    target: FreeTargetClass,
    off_max_s: float | None,
    on_min_s: float | None,
    e0_m: float,
    growth: GrowthModel | None = None,
    search_m: float = math.inf,
) -> dict[str, object]:
    """Return the network's report as plain data for JSON.

    Parameters
    ----------
    ground : views on the ground, from ``ground_views``
    target : class of the targets
    off_max_s, on_min_s : dwell times in force; None: none exists
    e0_m : position error when a target is lost
    growth : error growth of a prediction, for ``learned``
    search_m : pairs of views further apart are left out
    """
    shapes = [g.outline for g in ground]
    tree = shapely.STRtree(shapes)
    transitions: list[dict[str, object]] = []
    gaps: list[float] = []
    for i, source in enumerate(ground):
        if source.outline.is_empty:
            continue
        near = range(len(ground)) if math.isinf(search_m) else tree.query(source.outline, "dwithin", search_m)
        for j in sorted(int(k) for k in near):
            if j == i or ground[j].outline.is_empty:
                continue
            gap = float(source.outline.distance(ground[j].outline))
            gaps.append(gap)
            transitions.append(_transition(source, ground[j], gap, target, off_max_s, e0_m, growth))
    return {
        "network": {"cameras": len(ground), "regions": 0},
        "target_class": f"free, at most {target.v_max_mps:g} m/s",
        "certificates": _certificates(gaps, target, on_min_s, growth),
        "transitions": transitions,
        "uncertified": [{"from": t["from"], "to": t["to"]} for t in transitions],
        "constants": {},
    }


def _transition(
    source: GroundView,
    sink: GroundView,
    gap_m: float,
    target: FreeTargetClass,
    off_max_s: float | None,
    e0_m: float,
    growth: GrowthModel | None,
) -> dict[str, object]:
    earliest = gap_m / target.v_max_mps
    horizon = max(0.0, (sink.radius_m - e0_m) / target.v_max_mps)
    out: dict[str, object] = {
        "from": source.name,
        "to": sink.name,
        "gap_m": gap_m,
        "earliest_s": earliest,
        "sound": {
            "verdict": "not certified",
            # the reachable disc about the exit is outside the view by the gap and its own radius at best
            "margin_m": -(gap_m + e0_m),
            "margin_s": None if off_max_s is None else off_max_s - earliest,
            "binding": "a free target may stay away for ever",
            "trust_horizon_s": horizon,
        },
    }
    if growth is not None:
        trusted = growth.allowed_time(sink.radius_m)
        out["learned"] = {
            "verdict": "not certified",
            "margin_m": sink.radius_m - growth.error_at(earliest),
            "margin_s": _finite(trusted - earliest),
            "binding": "a free target may stay away for ever",
            "largest_model_error_mps": growth.largest_model_error(sink.radius_m, earliest, target.v_max_mps),
            "trust_horizon_s": _finite(trusted),
            "model_error_source": growth.source,
        }
    return out


def _certificates(
    gaps: Sequence[float], target: FreeTargetClass, on_min_s: float | None, growth: GrowthModel | None
) -> dict[str, object]:
    reason = "targets of this class may stay unseen for ever; each transition has its trust horizon"
    apart = [gap for gap in gaps if gap > 0.0]
    published: dict[str, object] = {"verdict": "not certified", "reason": "no two views are apart"}
    if apart:
        verdict = theorem_31(min(apart), target.v_max_mps, on_min_s, target.extent_m)
        published = {"verdict": verdict.verdict, "reason": "Theorem 3.1, smallest gap: " + verdict.reason}
    out: dict[str, object] = {"published": published, "sound": {"verdict": "not certified", "reason": reason}}
    if growth is not None:
        out["learned"] = {"verdict": "not certified", "reason": reason}
    return out


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

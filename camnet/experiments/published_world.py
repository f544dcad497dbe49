"""Theorem 3.1 along the ways of a network of fixed cameras: every place at which a target leaves a view.

Where another camera sees the place too there is no gap: the prediction is as deep in that view as the target, and the
theorem holds if that is deeper than the ball's radius beta (``occlusion_verdict``). Elsewhere no geometry can meet it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from camnet.certification.coverage import Coverage
from camnet.certification.free_network import GroundView
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.verdict import Theorem31, occlusion_verdict, theorem_31
from camnet.experiments.promise_world import Watched
from camnet.simulation.certificates import feature_extent, network_certificates
from camnet.simulation.network import Network

__all__ = ["published_on_ways"]

#: a stretch that ends this near (m) to the end of its arc goes on
_END_M = 1e-3


def published_on_ways(network: Network, watched: Watched, ground: Sequence[GroundView]) -> dict[str, Any]:
    """Return the ``published`` verdict of a network of fixed cameras over all exits of its views."""
    bounds = network_certificates(network).published
    times = [bounds.on_min(h=h).seconds for h in (False, True)]
    on_min = min((s for s in times if s is not None), default=None)
    v_max = network.scenario.targets[0].v_max_mps
    extent = feature_extent(network)
    verdicts: list[tuple[Theorem31, str]] = []
    outlines = np.array([g.outline for g in ground], dtype=object)
    for camera, arc, at in _exits(watched.ways.roads, watched.coverage):
        place = watched.ways.pose(np.array([arc]), np.array([at]))[0][0]
        others = [k for k in _watching(watched.coverage, arc, at) if k != camera]
        name = ground[camera].name
        if others:
            depth, best = max((float(ground[k].view.depth(place)), k) for k in others)
            where = f"leaving {name} within {ground[best].name}"
            verdicts.append((occlusion_verdict(depth, v_max, on_min, extent), where))
        else:
            away = shapely.distance(outlines, shapely.Point(place))
            away[camera] = np.nan
            gap = float(np.nanmin(away)) if np.isfinite(away).any() else np.inf
            verdicts.append((theorem_31(gap, v_max, on_min, extent), f"leaving {name}"))
    return _joined(verdicts, watched.in_m.some_seen)


def _exits(roads: RoadArcs, coverage: Coverage) -> list[tuple[int, int, float]]:
    """Return (camera, arc, place) wherever a way leaves a camera's view."""
    begins = {(int(a), int(c)) for a, c, s in zip(coverage.arc, coverage.camera, coverage.start_m, strict=True)
              if s <= _END_M}  # fmt: skip
    out = []
    for arc, camera, end in zip(
        coverage.arc.tolist(), coverage.camera.tolist(), coverage.end_m.tolist(), strict=True
    ):
        ways = roads.successor[roads.successor_ptr[arc] : roads.successor_ptr[arc + 1]].tolist()
        goes_on = end >= roads.length_m[arc] - _END_M and all((b, camera) in begins for b in ways)
        if not goes_on:
            out.append((camera, arc, end))
    return out


def _watching(coverage: Coverage, arc: int, at_m: float) -> list[int]:
    """Return the cameras that see a place, and some way on from it."""
    here = (coverage.arc == arc) & (coverage.start_m <= at_m + _END_M) & (coverage.end_m > at_m + _END_M)
    return np.unique(coverage.camera[here]).tolist()  # type: ignore[no-any-return]


def _joined(verdicts: Sequence[tuple[Theorem31, str]], some_seen: bool) -> dict[str, Any]:
    if not verdicts:
        reason = "every way stays in one view" if some_seen else "no camera sees any way"
        return {"verdict": "certified" if some_seen else "not certified", "reason": reason}
    bad = [(v, w) for v, w in verdicts if v.verdict != "certified"]
    if not bad:
        tightest, where = min(verdicts, key=lambda v: v[0].horizon_s)
        reason = f"Theorem 3.1 holds at all {len(verdicts)} exits, all within other views; {where}: {tightest.reason}"
        return {"verdict": "certified", "reason": reason}
    apart = [(v, w) for v, w in bad if v.verdict == "unsatisfiable"]
    worst, where = (apart or bad)[0]
    what = "unsatisfiable" if apart else "not certified"
    reason = f"Theorem 3.1 fails at {len(bad)} of {len(verdicts)} exits of views; {where}: {worst.reason}"
    return {"verdict": what, "reason": reason}

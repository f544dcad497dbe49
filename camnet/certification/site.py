"""Certify a whole site in one call: a road network or an open site with its fixed cameras.

These are the entry points of the command line. They take plain arrays; ``camnet.config`` is above this package.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.certification.coverage import Coverage, Views, cover_roads
from camnet.certification.free_network import FreeTargetClass, certify_free, ground_views
from camnet.certification.promise import with_claims
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import RoadGaps, road_gaps
from camnet.certification.road_promise import road_promise
from camnet.certification.transitions import (
    GrowthModel,
    RoadTargetClass,
    TransitionTable,
    certify_roads,
    network_report,
)
from camnet.errors import CertificateError
from camnet.geometry.frustum import Frustum
from camnet.types import Array

__all__ = ["certify_open_site", "certify_road_site", "road_segments_with_verdict", "views_of"]


def views_of(frusta: Sequence[Frustum], positions_world: Array) -> Views:
    """Fields of view of fixed cameras from their frusta in the world frame and optical centres (C, 3), m."""
    stacked = Frustum.stack(frusta)
    return Views.create(stacked.A, stacked.b, stacked.corners, np.asarray(positions_world, dtype=float))


def certify_road_site(
    roads: RoadArcs,
    views: Views | None,
    names: Sequence[str],
    target: RoadTargetClass,
    *,
    height_m: float,
    off_max_s: float | None,
    on_min_s: float | None,
    growth: GrowthModel | None = None,
    occluders: Sequence[tuple[Array, Array]] = (),
    search_m: float = math.inf,
    coverage: Coverage | None = None,
    constants: dict[str, object] | None = None,
    off_max_m: float | None = None,
    limit_source: str = "stated",
    dwell: tuple[float | None, float | None] | None = None,
) -> tuple[dict[str, object], RoadGaps, dict[str, TransitionTable]]:
    """Certify fixed cameras on a road network.

    Parameters
    ----------
    roads, views, names : network, fields of view and names of the cameras
    target : road-bound class
    height_m : height of the targets' reference point, m
    off_max_s, off_max_m, limit_source : what is allowed out of view, and who says so; None: not limited
    on_min_s : least time in view that is asked for
    growth : error growth, for the ``learned`` certificate
    dwell : dwell times that an estimator's analysis proves, for ``sound``; None: there is no estimator
    occluders : convex polytopes (B, c), B x <= c with unit normals
    search_m : unseen ways longer than this are not followed, and then not certified
    coverage : what is seen, where it is known already (mobile cameras: their regions); ``views`` are not used then
    constants : shown in the report

    Returns
    -------
    tuple
        the report as plain data, with the ``promise`` and both ``claims``, the gaps, and the verdicts by certificate
        (for maps).
    """
    if coverage is None:
        if views is None:
            raise CertificateError("views or coverage: one of them is needed")
        coverage = cover_roads(roads, views, height_m, target.extent_m, occluders)
    gaps = road_gaps(roads, coverage, search_m)
    tables = certify_roads(gaps, target, off_max_s, on_min_s, growth, off_max_m=off_max_m, dwell=dwell)
    report = network_report(
        gaps, tables, target, names, growth=growth, on_min_s=on_min_s, constants=constants
    )
    promise = road_promise(
        roads,
        coverage,
        names,
        target,
        off_max_s=off_max_s,
        off_max_m=off_max_m,
        limit_source=limit_source,
        views=views,
        height_m=height_m,
    )
    return with_claims(report, promise), gaps, tables


def certify_open_site(
    views: Views,
    names: Sequence[str],
    target: FreeTargetClass,
    *,
    height_m: float,
    off_max_s: float | None,
    on_min_s: float | None,
    e0_m: float,
    growth: GrowthModel | None = None,
    search_m: float = math.inf,
) -> dict[str, object]:
    """Report every transition of an open site with its trust horizon, for targets that may go anywhere."""
    ground = ground_views(views, names, height_m, target.extent_m)
    return certify_free(ground, target, off_max_s, on_min_s, e0_m, growth, search_m)


def road_segments_with_verdict(
    roads: RoadArcs, gaps: RoadGaps, table: TransitionTable, kept: bool
) -> dict[str, list[Array]]:
    """Return straight pieces (2, 2) of road by what a map shows: ``seen``, ``certified``, ``uncertified``.

    An unseen piece is certified when every transition that starts at the last view before it on its arc is; pieces of
    arcs that are unseen from their start are certified when the promise of the whole network is ``kept``, ways into the
    first view and never-seen ones included, and all its transitions are certified.
    """
    seen = gaps.stretches
    bad = np.zeros(len(seen.arc), dtype=bool)
    bad[gaps.exit_stretch[~table.certified]] = True
    bad[gaps.exits[gaps.cyclic | gaps.cut]] = True
    everything = kept and not bad.any()
    out: dict[str, list[Array]] = {"seen": [], "certified": [], "uncertified": []}
    ptr = np.searchsorted(seen.arc, np.arange(roads.n_arcs + 1))
    for arc in range(roads.n_arcs):
        at, verdict = 0.0, "certified" if everything else "uncertified"
        for k in range(ptr[arc], ptr[arc + 1]):
            out[verdict] += _pieces(roads, arc, at, float(seen.start_m[k]))
            out["seen"] += _pieces(roads, arc, float(seen.start_m[k]), float(seen.end_m[k]))
            at, verdict = float(seen.end_m[k]), "uncertified" if bad[k] else "certified"
        out[verdict] += _pieces(roads, arc, at, float(roads.length_m[arc]))
    return out


def _pieces(roads: RoadArcs, arc: int, start_m: float, end_m: float) -> list[Array]:
    """Cut the straight pieces between two arc lengths out of an arc."""
    first, last = np.searchsorted(roads.piece_arc, [arc, arc + 1])
    out = []
    for k in range(int(first), int(last)):
        offset = float(roads.piece_offset_m[k])
        a, b = max(start_m - offset, 0.0), min(end_m - offset, float(roads.piece_length_m[k]))
        if b > a + 1e-6:
            out.append(roads.start_xy[k] + np.array([[a], [b]]) * roads.direction_xy[k])
    return out

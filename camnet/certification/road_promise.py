r"""The promise of fixed cameras on a road network: every place of it may be where a target enters or leaves.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| L | | m | longest unseen walk along arcs (``unseen``), into the first view and after the last one too |
| T = L / v_lo | | s | longest time that it takes; a target that stops on the way takes longer |
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camnet.certification.blind import blind_cameras
from camnet.certification.coverage import Coverage, Views
from camnet.certification.promise import BlindCamera, Promise, UnseenWay
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import merge_coverage
from camnet.certification.transitions import RoadTargetClass
from camnet.certification.unseen import SeenArcs, UnseenWays, longest_unseen

__all__ = ["road_promise"]


def road_promise(
    roads: RoadArcs,
    coverage: Coverage,
    names: Sequence[str],
    target: RoadTargetClass,
    *,
    off_max_s: float | None,
    off_max_m: float | None = None,
    limit_source: str = "stated",
    views: Views | None = None,
    height_m: float = 0.0,
) -> Promise:
    """Return the promise of cameras that see ``coverage`` of a road network.

    Parameters
    ----------
    roads, coverage, names : the network, what is seen of it, and the cameras
    target : class of the targets
    off_max_s, off_max_m, limit_source : what is allowed out of view, and who says so
    views, height_m : the cameras' views and the height of the targets, to say why a camera sees nothing
    """
    found = _longest(roads, coverage)
    per_m = 1.0 / target.v_lo_mps
    circle = "unseen roads lead in a circle: a target may stay on them for ever"
    way = _record(found.longest, names, per_m, circle)
    into = _record(found.into_first, names, per_m, circle)
    return Promise(
        target_class=f"every target on the roads, {target.v_lo_mps:g} to {target.v_max_mps:g} m/s",
        unseen_max_m=way.length_m,
        unseen_max_s=way.time_s,
        longest=way if way.length_m > 0.0 else None,
        into_first=into if into.length_m > 0.0 else None,
        cameras=len(names),
        limit_m=off_max_m,
        limit_s=off_max_s,
        limit_source=limit_source,
        nobody_sees=() if found.some_seen else ("any road",),
        never_seen_m=found.never_seen,
        blind=_blind(roads, coverage, names, views, height_m),
    )


def _longest(roads: RoadArcs, coverage: Coverage) -> UnseenWays:
    seen = merge_coverage(roads, coverage)
    return longest_unseen(
        SeenArcs(
            roads.length_m,
            roads.successor_ptr,
            roads.successor,
            seen.arc,
            seen.start_m,
            seen.end_m,
            seen.entry_camera,
            seen.exit_camera,
            np.ones(roads.n_arcs, dtype=bool),
        )
    )


def _record(found: tuple[float, str, int, int], names: Sequence[str], per_m: float, circle: str) -> UnseenWay:
    length, kind, before, after = found
    return UnseenWay(
        kind,
        length,
        length * per_m,
        names[before] if before >= 0 else None,
        names[after] if after >= 0 else None,
        reason="" if np.isfinite(length) else circle,
    )


def _blind(
    roads: RoadArcs, coverage: Coverage, names: Sequence[str], views: Views | None, height_m: float
) -> tuple[BlindCamera, ...]:
    if views is None:
        return ()
    sees = np.zeros(len(names), dtype=bool)
    sees[coverage.camera] = True
    if sees.all():
        return ()
    places = np.concatenate(
        [roads.start_xy, roads.start_xy + 0.5 * roads.piece_length_m[:, None] * roads.direction_xy]
    )
    return blind_cameras(names, views, places, height_m, sees)

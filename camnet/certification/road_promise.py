r"""The promise of fixed cameras on a road network: every place of it may be where a target enters or leaves.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| L | | m | longest unseen walk along arcs (``unseen``), into the first view and after the last one too |
| T = L / v_lo + t_stop | | s | longest time that it takes, standing still for t_stop (``stop_s``) in all |
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

__all__ = ["road_promise", "target_words"]


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
    circle = "unseen roads lead in a circle: a target may stay on them for ever"
    way = _record(found.longest, names, target, circle)
    into = _record(found.into_first, names, target, circle)
    return Promise(
        target_class=target_words(target),
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


def target_words(target: RoadTargetClass) -> str:
    """Return the class in words."""
    stop = f", standing still for at most {target.stop_s:g} s while unseen" if target.stop_s else ""
    return f"every target on the roads, {target.v_lo_mps:g} to {target.v_max_mps:g} m/s{stop}"


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


def _record(
    found: tuple[float, str, int, int], names: Sequence[str], target: RoadTargetClass, circle: str
) -> UnseenWay:
    length, kind, before, after = found
    return UnseenWay(
        kind,
        length,
        target.longest_time(length),
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

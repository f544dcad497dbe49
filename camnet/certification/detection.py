r"""What counts as seen where cameras take frames and detectors miss: so many detections at a stated probability.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| f, p | ``rate_hz``, ``probability`` | Hz, - | frames of a camera; probability that one in view is a detection |
| N, q | ``count``, ``confidence`` | - | a pass of a view counts where it has N detections with probability q at least |
| n | ``frames_needed`` | - | least n with P(Binomial(n, p) >= N) >= q |
| T | ``time_in_view_s`` | s | n / f and the latency: n frames fall into a view as long, whenever the first comes |
| d | | m | what the fastest target of the class drives in T |

Each frame is a detection by itself. From the moment a target comes into a camera's view it has been detected after d
metres at most; when it leaves, the last N detections are not older than d metres. So each stretch in view counts less d
at both ends, and not at all where it is no longer than 2 d. Each camera has to do so by itself: detections of several
are not added up. A view that goes on from one arc of the roads to the next is one stretch, on the least lucky of the
ways there.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.settings import DetectionSettings
from camnet.types import Array, BoolArray, IntArray

__all__ = ["detected", "frames_needed", "time_in_view_s"]

#: a view reaches the end of an arc where it ends nearer to it than this, m
_AT_END_M = 1e-3


def frames_needed(settings: DetectionSettings) -> int:
    """Return the least number of frames with enough detections at the stated probability."""
    p, tail_of = settings.probability, settings.count
    n = tail_of
    while _enough(n, p, tail_of) < settings.confidence:
        n += 1
    return n


def _enough(n: int, p: float, count: int) -> float:
    """Return P(Binomial(n, p) >= count)."""
    return 1.0 - math.fsum(math.comb(n, k) * p**k * (1.0 - p) ** (n - k) for k in range(count))


def time_in_view_s(settings: DetectionSettings) -> float:
    """Return how long a target has to be in view to be seen, s."""
    return frames_needed(settings) / settings.rate_hz + settings.latency_s


def detected(coverage: Coverage, roads: RoadArcs, d_m: float) -> Coverage:
    """Return what is left of each camera's stretches of the arcs, less ``d_m`` where the view begins and ends."""
    length = roads.length_m[coverage.arc]
    first, last = coverage.start_m <= _AT_END_M, coverage.end_m >= length - _AT_END_M
    before = np.repeat(np.arange(roads.n_arcs), np.diff(roads.successor_ptr))
    after = roads.successor
    behind = _carried(coverage, before, after, last, first, d_m)
    ahead = _carried(coverage, after, before, first, last, d_m)
    start = coverage.start_m + np.maximum(d_m - behind, 0.0)
    end = coverage.end_m - np.maximum(d_m - ahead, 0.0)
    keep = end > start
    start, end = start[keep], end[keep]
    return replace(
        coverage,
        arc=coverage.arc[keep],
        camera=coverage.camera[keep],
        start_m=start,
        end_m=end,
        depth_m=coverage.depth_m[keep],
        deepest_m=np.clip(coverage.deepest_m[keep], start, end),
    )


def _carried(
    coverage: Coverage, of: IntArray, into: IntArray, leaves: BoolArray, enters: BoolArray, d_m: float
) -> Array:
    """Return how far (R,) each stretch that begins at an arc's end has been in the same view before, at most ``d_m``.

    Of all arcs ``of`` that lead ``into`` its own the least; 0 where one of them has no view there.
    """
    carried = np.where(enters, d_m, 0.0)
    cameras = int(coverage.camera.max(initial=0)) + 1
    row_of = {int(a) * cameras + int(c): k for k, (a, c) in _rows(coverage, leaves)}
    pairs: list[tuple[int, int]] = []
    comes: dict[int, list[int]] = {}
    for a, b in zip(of.tolist(), into.tolist(), strict=True):
        comes.setdefault(b, []).append(a)
    for k, (arc, camera) in _rows(coverage, enters):
        arcs = comes.get(arc, [])
        found = [row_of.get(a * cameras + camera, -1) for a in arcs]
        if not found or min(found) < 0:
            carried[k] = 0.0
        else:
            pairs += [(k, row) for row in found]
    if not pairs:
        return carried
    to, source = np.array(pairs).T
    length = coverage.end_m - coverage.start_m
    whole = leaves & enters
    while True:
        # a stretch that does not fill its arc passes on its own length alone
        passed = length[source] + np.where(whole[source], carried[source], 0.0)
        lower = carried.copy()
        np.minimum.at(lower, to, passed)
        if np.array_equal(lower, carried):
            return carried
        carried = lower


def _rows(coverage: Coverage, chosen: BoolArray) -> list[tuple[int, tuple[int, int]]]:
    rows = np.flatnonzero(chosen)
    return list(
        zip(
            rows.tolist(),
            zip(coverage.arc[rows].tolist(), coverage.camera[rows].tolist(), strict=True),
            strict=True,
        )
    )

"""Judge a flight by the truth alone: how far and how long targets were out of view, and how far off estimates were.

A target counts as out of view from the first instant without a view to the last one before it is seen again, so that a
stretch is never taken for longer than it was. A stretch that the flight's end cuts off counts for as long as it was
watched.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from camnet.experiments.closed_loop.claims import Claims
from camnet.experiments.closed_loop.flight import TruthLog

__all__ = ["Outcome", "Stretch", "judge", "stretches"]

#: figures of a promise are printed to about this
_SLACK = 1e-6


@dataclass(frozen=True, slots=True)
class Stretch:
    """A target out of view: from when on, how long, how far; ``first`` before its first view, ``open`` to the end."""

    target: int
    from_s: float
    time_s: float
    length_m: float
    first: bool
    open: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a flight did to a promise.

    Attributes
    ----------
    share : largest figure as a share of what is promised; above 1 the promise is broken
    broken : the figures that exceed the promise
    worst : by figure, the largest that occurred, with what is promised, the margin, and where
    stretches, gaps : how many counted
    use : by assumption, how much of it was used up
    """

    share: float
    broken: tuple[str, ...]
    worst: dict[str, dict[str, Any]]
    stretches: int
    gaps: int
    use: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {**asdict(self), "broken": list(self.broken)}


def stretches(log: TruthLog, since: Sequence[float] | None = None) -> Iterator[Stretch]:
    """Yield every stretch out of view, target by target; of those under way ``since`` a target's time, the rest."""
    for m in range(log.seen.shape[1]):
        begin = 0 if since is None else int(np.searchsorted(log.t_s, since[m]))
        unseen = np.concatenate([[False], ~log.seen[:, m], [False]])
        change = np.flatnonzero(np.diff(unseen.astype(np.int8)))
        steps = np.linalg.norm(np.diff(log.p_world[:, m], axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        for start, j in zip(change[::2].tolist(), (change[1::2] - 1).tolist(), strict=True):
            i = max(start, begin)
            if i <= j:
                time_s, length_m = float(log.t_s[j] - log.t_s[i]), float(way[j] - way[i])
                yield Stretch(m, float(log.t_s[i]), time_s, length_m, start == 0, j == len(log.t_s) - 1)


def judge(log: TruthLog, claims: Claims, names: tuple[str, ...], regions: tuple[str, ...] = ()) -> Outcome:
    """Compare a flight with what is promised; ``regions`` are the names of the numbers in ``log.region``.

    The way into the first view rests on no estimate: it counts from the start, whatever the promise waits for. Where it
    is not promised, a target that nobody has seen by the time at which the promise holds counts from then on.
    """
    worst: dict[str, dict[str, Any]] = {}
    since = [_since(log, claims, m, claims.after_laps) for m in range(len(names))]
    count = 0
    waits = claims.after_laps > 0 or claims.after_s > 0.0
    whole = [s for s in stretches(log) if s.first and claims.into_first_view]
    later = [s for s in stretches(log, since) if not s.first or (waits and not claims.into_first_view)]
    for s in whole + later:
        count += not s.first and not s.open
        where = {"target": names[s.target], "from_s": s.from_s, "into_first_view": s.first, "cut_off": s.open}
        _note(worst, "unseen_m", s.length_m, claims.unseen_max_m, where)
        _note(worst, "unseen_s", s.time_s, claims.unseen_max_s, where)
        way = _way(log, claims, s, regions)
        if way is not None:
            _note(worst, "unseen_way_m", s.length_m, way[2], {**where, "from": way[0], "to": way[1]})
    laps = max(claims.after_laps, claims.error_after_laps)
    known = [_since(log, claims, m, laps) for m in range(len(names))]
    gaps = [g for g in log.gaps if g.lost_s >= known[g.target]]
    if claims.error is not None:
        for g in gaps:
            bound = claims.error.at(g.target, g.from_camera, g.seen_s - g.lost_s)
            limit = bound if np.isfinite(bound) else None  # no tube begins at this exit
            where = {"target": names[g.target], "from_s": g.lost_s, "gap_s": g.seen_s - g.lost_s}
            _note(worst, "error_m", g.error_m, limit, where)
    broken = tuple(name for name, w in worst.items() if w["margin"] is not None and w["margin"] < -_SLACK)
    share = max((w["share"] for w in worst.values() if w["share"] is not None), default=0.0)
    return Outcome(share, broken, worst, count, len(gaps), log.use)


def _way(
    log: TruthLog, claims: Claims, s: Stretch, regions: tuple[str, ...]
) -> tuple[str, str, float] | None:
    """Return the way between two regions that a stretch lies on, and what is promised of it; None of no such way.

    It leads from the region that the target was in last, at its begin, to the next one, at its end: whoever misses a
    target in a region adds to the stretch, and not to what is promised.
    """
    if not claims.ways or log.region is None or s.first:
        return None
    own, i = log.region[:, s.target], int(np.searchsorted(log.t_s, s.from_s - 1e-9))
    j = int(np.searchsorted(log.t_s, s.from_s + s.time_s - 1e-9))
    before, after = np.flatnonzero(own[: i + 1] >= 0), j + np.flatnonzero(own[j:] >= 0)
    if not len(before) or not len(after):
        return None
    pair = regions[own[before[-1]]], regions[own[after[0]]]
    return next((way for way in claims.ways if way[:2] == pair), None)


def _since(log: TruthLog, claims: Claims, m: int, laps: int) -> float:
    """Return from when on the promise holds for a target that has to be followed for so many laps first, s."""
    if laps == 0:
        return claims.after_s
    later = np.flatnonzero(log.lap[:, m] > laps)
    return max(float(log.t_s[later[0]]), claims.after_s) if len(later) else float("inf")


def _note(
    worst: dict[str, dict[str, Any]], name: str, value: float, limit: float | None, where: dict[str, Any]
) -> None:
    """Keep the figure that is the largest share of its limit; without a limit, the largest."""
    share = None if limit is None else (value / limit if limit > 0.0 else (np.inf if value > 0.0 else 0.0))
    if share is not None and not np.isfinite(share):
        share = 1e9
    before = worst.get(name)
    key = value if share is None else share
    if before is None or key > (before["value"] if before["share"] is None else before["share"]):
        margin = None if limit is None else limit - value
        worst[name] = {"value": value, "promised": limit, "margin": margin, "share": share, **where}

"""Switching signals and dwell times of one target in a run, checked against both certificates.

| symbol | name | equation |
| --- | --- | --- |
| sigma^f | ``seen`` | feedback available, section 4.2 |
| sigma^d | ``d`` | finite excitation holds, Assumption 4.7 |
| sigma^h | ``h`` | it held in an earlier visit, Theorem 4.1 |
| T_j | ``excited_at_s`` | Assumption 4.7 |
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from camnet.certification.dwell import DwellBounds, DwellTime
from camnet.errors import CertificateError

__all__ = ["DwellMonitor", "Interval", "IntervalCheck"]


@dataclass(frozen=True, slots=True)
class IntervalCheck:
    """What one certificate says of one interval.

    Attributes
    ----------
    limit_s : dwell time asked for (shortest in view, longest out of view); None where none exists
    status : ``met``, ``violated``, ``impossible`` (no dwell time exists) or ``open`` (the run ended first)
    broken : the condition was met, yet the error exceeded the certified level: a counterexample
    """

    limit_s: float | None
    status: str
    broken: bool = False


@dataclass(frozen=True, slots=True)
class Interval:
    """One interval in view (``on``) or out of view (``off``).

    Attributes
    ----------
    seen : whether it is an interval in view
    region : region that sees the target, or that saw it last
    start_s, end_s : its ends, s
    d, h : switching signals at its end (for an interval out of view: of the interval before)
    excited_at_s : time at which excitation first held in this visit, s; None if it did not
    max_error_m : largest position error reported during it, m (0 when none was)
    published, sound : the two certificates' checks
    """

    seen: bool
    region: int
    start_s: float
    end_s: float
    d: bool
    h: bool
    excited_at_s: float | None
    max_error_m: float
    published: IntervalCheck
    sound: IntervalCheck

    @property
    def duration_s(self) -> float:
        """Length of the interval, s."""
        return self.end_s - self.start_s


@dataclass(slots=True)
class _Open:
    """The interval in progress."""

    seen: bool
    region: int
    start_s: float
    h: bool
    excited_at_s: float | None = None
    d: bool = False
    max_error_m: float = 0.0
    limits: tuple[DwellTime, DwellTime] | None = None


@dataclass(slots=True)
class DwellMonitor:
    """Record the switching signals of one target and check both certificates as the run goes.

    Time before the first sighting is ignored. ``update`` costs a few comparisons unless the target appears or
    disappears.

    Parameters
    ----------
    n_regions : number of regions (or fixed cameras)
    published, sound : the two certificates' dwell times
    """

    n_regions: int
    published: DwellBounds
    sound: DwellBounds
    intervals: list[Interval] = field(default_factory=list)
    _open: _Open | None = None
    _held: list[bool] = field(default_factory=list)
    _armed: list[bool] = field(default_factory=lambda: [True, True])
    _last_s: float = -math.inf

    def __post_init__(self) -> None:
        if self.n_regions < 1:
            raise CertificateError(f"n_regions = {self.n_regions!r}: at least one region is needed")
        self._held = [False] * self.n_regions

    def update(self, t_s: float, region: int, seen: bool, excited: bool, error_m: float = 0.0) -> None:
        """Take one sensing step.

        Parameters
        ----------
        t_s : time, s, not decreasing
        region : region whose camera sees the target (or in which it is); -1 outside all regions
        seen : whether feedback is available
        excited : whether finite excitation holds in the history stack of ``region``
        error_m : position error of the estimate where the truth is known, m
        """
        self._last_s = t_s
        if seen and region < 0:
            raise CertificateError(f"region = {region} with seen = True: a target is seen in a region only")
        current = self._open
        if current is None:
            if not seen:
                return
            current = self._begin_on(t_s, region)
        elif current.seen != seen or (seen and current.region != region):
            current = self._switch(current, t_s, region, seen)
        if seen and excited and not current.d:
            current.d = True
            current.excited_at_s = t_s
            self._held[region] = True
        if error_m > current.max_error_m:
            current.max_error_m = error_m

    def close(self) -> None:
        """End the run: the interval in progress is kept, as ``open`` unless it already violates its limit."""
        if self._open is not None:
            self._finish(self._open, self._last_s, complete=False)
            self._open = None

    def off_time_left_s(self, t_s: float, certificate: str = "sound") -> float | None:
        """Return how long the target may still stay unseen, s; None while it is seen or where nothing is certified."""
        current = self._open
        if current is None or current.seen or current.limits is None:
            return None
        limit = current.limits[0 if certificate == "published" else 1].seconds
        return None if limit is None else limit - (t_s - current.start_s)

    def summary(self) -> dict[str, object]:
        """Return counts for the run's summary; ``violations`` adds both certificates' violated conditions."""
        checks = {name: _tally(self.intervals, name) for name in ("published", "sound")}
        return {
            **checks,
            "violations": sum(int(tally["violated"]) for tally in checks.values()),
            "broken": sum(int(tally["broken"]) for tally in checks.values()),
            "intervals_on": sum(i.seen for i in self.intervals),
            "intervals_off": sum(not i.seen for i in self.intervals),
            "longest_off_s": max((i.duration_s for i in self.intervals if not i.seen), default=0.0),
            "shortest_on_s": min((i.duration_s for i in self.intervals if i.seen), default=0.0),
            "excited_at_s": [self._first_excitation(j) for j in range(self.n_regions)],
        }

    def _first_excitation(self, region: int) -> float | None:
        found = (
            i.excited_at_s
            for i in self.intervals
            if i.seen and i.region == region and i.excited_at_s is not None
        )
        return next(found, None)

    def _begin_on(self, t_s: float, region: int) -> _Open:
        self._open = _Open(True, region, t_s, h=self._held[region])
        return self._open

    def _switch(self, current: _Open, t_s: float, region: int, seen: bool) -> _Open:
        """Close the interval in progress and open the next one."""
        self._finish(current, t_s, complete=True)
        if seen:
            return self._begin_on(t_s, region)
        nxt = _Open(False, current.region, t_s, h=current.h, d=current.d, excited_at_s=current.excited_at_s)
        on_s = t_s - current.start_s
        excited_s = 0.0 if current.excited_at_s is None else t_s - current.excited_at_s
        nxt.limits = (
            self.published.off_max(on_s, excited_s, d=current.d, h=current.h and current.d),
            self.sound.off_max(on_s, excited_s, d=current.d, h=current.h and current.d),
        )
        self._open = nxt
        return nxt

    def _finish(self, current: _Open, t_s: float, *, complete: bool) -> None:
        limits = current.limits
        if current.seen or limits is None:
            limits = (self.published.on_min(h=current.h), self.sound.on_min(h=current.h))
        length = t_s - current.start_s
        checks = []
        for j, (limit, bounds) in enumerate(zip(limits, (self.published, self.sound), strict=True)):
            check = _check(current, limit, length, bounds.v_hi, armed=self._armed[j], complete=complete)
            self._armed[j] = _premise(current, check, bounds, self._armed[j])
            checks.append(check)
        self.intervals.append(
            Interval(
                seen=current.seen,
                region=current.region,
                start_s=current.start_s,
                end_s=t_s,
                d=current.d,
                h=current.h,
                excited_at_s=current.excited_at_s,
                max_error_m=current.max_error_m,
                published=checks[0],
                sound=checks[1],
            )
        )


def _check(
    current: _Open, limit: DwellTime, length_s: float, v_hi: float, *, armed: bool, complete: bool
) -> IntervalCheck:
    """Compare an interval with one certificate's dwell time; ``armed``: the certificate's premises hold."""
    if limit.seconds is None:
        return IntervalCheck(None, "impossible")
    if current.seen:
        if length_s >= limit.seconds:
            return IntervalCheck(limit.seconds, "met")
        return IntervalCheck(limit.seconds, "violated" if complete else "open")
    if length_s > limit.seconds:
        return IntervalCheck(limit.seconds, "violated")
    broken = armed and _exceeds(current, v_hi)
    return IntervalCheck(limit.seconds, "met" if complete else "open", broken)


def _exceeds(current: _Open, v_hi: float) -> bool:
    return 0.5 * current.max_error_m**2 > v_hi  # V >= |p_til|^2 / 2


def _premise(current: _Open, check: IntervalCheck, bounds: DwellBounds, armed: bool) -> bool:
    """Return whether the certificate's premise holds for what follows this interval.

    The conditions for time out of view assume V <= V_lo when it starts (stationary, Lemma 3.3) or V <= V_hi when the
    view before it started (mobile, Theorem 4.1). A broken chain starts again when the error returns below V_hi.
    """
    if not current.seen:
        return check.status == "met" or not _exceeds(current, bounds.v_hi)
    if bounds.constants.mobile:
        return armed
    return armed and check.status == "met"


def _tally(intervals: list[Interval], name: str) -> dict[str, int]:
    checks: list[IntervalCheck] = [getattr(i, name) for i in intervals]
    counts = {
        status: sum(c.status == status for c in checks)
        for status in ("met", "violated", "impossible", "open")
    }
    counts["broken"] = sum(c.broken for c in checks)
    return counts

"""Switching signals and dwell times of one target in a run, checked against both certificates.

| symbol | name | equation |
| --- | --- | --- |
| sigma^f | ``seen`` | feedback available, section 4.2 |
| sigma^d | ``d`` | finite excitation holds, Assumption 4.7 |
| sigma^h | ``h`` | it held in an earlier visit, Theorem 4.1 |
| T_j | ``excited_at_s`` | Assumption 4.7 |

Excitation may end as well as begin, with a change of the stack: d is of the present, and h falls with it, for the
excited cases hold only while the stack is of full rank. A violation of ``sound`` is an error and logged as one the
moment it happens: the condition of the certificate was met and the error exceeded its level all the same (``broken``),
or the target stayed out of view for longer than the designer's certificate of the network allows (``overdue``).
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field, replace

from camnet.certification.dwell import DwellBounds
from camnet.certification.intervals import (
    GapCertificate,
    Interval,
    IntervalCheck,
    OpenInterval,
    check,
    exceeds,
    premise,
    tally,
)
from camnet.errors import CertificateError

__all__ = ["DwellMonitor", "GapCertificate", "Interval", "IntervalCheck"]

_LOG = logging.getLogger(__name__)
#: order of the certificates in pairs
_NAMES = ("published", "sound")


@dataclass(slots=True)
class DwellMonitor:
    """Record the switching signals of one target and check both certificates as the run goes.

    Time before the first sighting is ignored. ``update`` costs a few comparisons unless the target appears or
    disappears.

    Parameters
    ----------
    n_regions : number of regions (or fixed cameras)
    published, sound : the two certificates' dwell times
    name : of the target, for messages
    stated_off_s : longest time out of view by the designer's certificate of the network, s; None: none is stated
    """

    n_regions: int
    published: DwellBounds
    sound: DwellBounds
    name: str = "target"
    stated_off_s: float | None = None
    intervals: list[Interval] = field(default_factory=list)
    violations: int = 0
    overdue: int = 0
    _open: OpenInterval | None = None
    _held: list[bool] = field(default_factory=list)
    _armed: list[bool] = field(default_factory=lambda: [True, True])
    _last_s: float = -math.inf

    def __post_init__(self) -> None:
        if self.n_regions < 1:
            raise CertificateError(f"n_regions = {self.n_regions!r}: at least one region is needed")
        self._held = [False] * self.n_regions

    @property
    def signals(self) -> tuple[bool, bool, bool]:
        """Return sigma^f, sigma^d and sigma^h now; all false before the first sighting."""
        now = self._open
        return (False, False, False) if now is None else (now.seen, now.d, now.h)

    def update(
        self,
        t_s: float,
        region: int,
        seen: bool,
        excited: bool,
        error_m: float = 0.0,
    ) -> None:
        """Take one sensing step.

        Parameters
        ----------
        t_s : time, s, not decreasing
        region : region whose camera sees the target (or in which it is); -1 outside all regions
        seen : whether feedback is available
        excited : whether finite excitation holds now in the history stack of ``region``
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
        if seen:
            self._excite(current, t_s, region, excited)
        if error_m > current.max_error_m:
            current.max_error_m = error_m
        if not current.seen:
            self._watch(current, t_s)

    def _excite(self, current: OpenInterval, t_s: float, region: int, excited: bool) -> None:
        if excited and not current.d:
            current.d = True
            current.excited_at_s = t_s
        elif not excited:
            current.d, current.h, current.excited_at_s = False, False, None
        self._held[region] = excited

    def _watch(self, current: OpenInterval, t_s: float) -> None:
        """Report violations of ``sound`` in a gap when they happen, each once a gap."""
        off_s = t_s - current.start_s
        if self.stated_off_s is not None and off_s > self.stated_off_s and not current.overdue:
            current.overdue = True
            self.overdue += 1
            _LOG.error(
                "%s: out of view since %.2f s, at %.2f s for longer than the %.4g s that the network's certificate "
                "allows",
                self.name, current.start_s, t_s, self.stated_off_s,
            )  # fmt: skip
        if current.limits is None or current.reported:
            return
        limit = current.limits[1].seconds
        if limit is None or off_s > limit or not self._armed[1] or not exceeds(current, self.sound.v_hi):
            return
        current.reported = True
        self.violations += 1
        _LOG.error(
            "%s: sound certificate violated at %.2f s: %.4g s out of view (allowed %.4g s) with a position error of "
            "%.4g m (certified %.4g m); an assumption of the certificate does not hold here",
            self.name, t_s, off_s, limit, current.max_error_m, math.sqrt(2.0 * self.sound.v_hi),
        )  # fmt: skip

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

    def certificate(self, t_s: float) -> GapCertificate:
        """Return what is certified now: by the dwell time of ``sound`` where there is one, else by the stated one."""
        current = self._open
        if current is None or current.seen:
            return GapCertificate(True, None, None, self.violations)
        off_s, margin = t_s - current.start_s, None
        left = self.off_time_left_s(t_s) if self._armed[1] else None
        if left is not None:
            radius = math.sqrt(2.0 * self.sound.v_hi)
            margin = radius - self.sound.error_bound_m(current.exit_levels[1], off_s)
        elif self.stated_off_s is not None:
            left = self.stated_off_s - off_s
        return GapCertificate(False, left, margin, self.violations)

    @property
    def excited(self) -> bool:
        """Whether the target is in view and excitation holds."""
        return self._open is not None and self._open.seen and self._open.d

    def visit_start_s(self, region: int) -> float | None:
        """Return when the present visit to a region began, s; None if the target was not seen there just now."""
        current = self._open
        return current.start_s if current is not None and current.seen and current.region == region else None

    @property
    def dwell_violations(self) -> int:
        """Intervals in which the condition of ``sound`` was not met."""
        return sum(i.sound.status == "violated" for i in self.intervals)

    def summary(self) -> dict[str, object]:
        """Return counts for the run's summary; ``violations`` adds both certificates' violated conditions."""
        checks = {name: tally(self.intervals, name) for name in _NAMES}
        return {
            **checks,
            "violations": sum(int(tally["violated"]) for tally in checks.values()),
            "broken": sum(int(tally["broken"]) for tally in checks.values()),
            "certificate_violations": self.violations,
            "overdue": self.overdue,
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

    def _begin_on(self, t_s: float, region: int) -> OpenInterval:
        self._open = OpenInterval(True, region, t_s, h=self._held[region])
        return self._open

    def _switch(self, current: OpenInterval, t_s: float, region: int, seen: bool) -> OpenInterval:
        """Close the interval in progress and open the next one."""
        self._finish(current, t_s, complete=True)
        if seen:
            return self._begin_on(t_s, region)
        nxt = OpenInterval(
            False,
            current.region,
            t_s,
            h=current.h,
            d=current.d,
            excited_at_s=current.excited_at_s,
        )
        on_s = t_s - current.start_s
        limits, levels = [], []
        for bounds in (self.published, self.sound):
            d, h, at_s = current.d, current.h, current.excited_at_s
            excited_s = 0.0 if at_s is None else t_s - at_s
            limits.append(bounds.off_max(on_s, excited_s, d=d, h=h and d))
            levels.append(bounds.exit_level(on_s, excited_s, d=d, h=h and d))
        nxt.limits, nxt.exit_levels = (limits[0], limits[1]), (levels[0], levels[1])
        self._open = nxt
        return nxt

    def _finish(self, current: OpenInterval, t_s: float, *, complete: bool) -> None:
        limits = current.limits
        if current.seen or limits is None:
            limits = (self.published.on_min(h=current.h), self.sound.on_min(h=current.h))
        length = t_s - current.start_s
        checks = []
        for j, (limit, bounds) in enumerate(zip(limits, (self.published, self.sound), strict=True)):
            found = check(current, limit, length, bounds.v_hi, armed=self._armed[j], complete=complete)
            self._armed[j] = premise(current, found, bounds, self._armed[j])
            checks.append(replace(found, broken=True) if j == 1 and current.reported else found)
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

"""Intervals in and out of view of one target, and what each certificate says of them.

Pairs hold ``published`` first and ``sound`` second. For the symbols see ``monitor``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.certification.dwell import DwellBounds, DwellTime

__all__ = [
    "GapCertificate",
    "Interval",
    "IntervalCheck",
    "OpenInterval",
    "check",
    "exceeds",
    "premise",
    "tally",
]


@dataclass(frozen=True, slots=True)
class GapCertificate:
    """What is certified of the present instant.

    Attributes
    ----------
    seen : whether the target is in view, or was never seen (nothing is then to be certified)
    time_left_s : how long it may still stay out of view, s; None: in view, or nothing is certified
    margin_m : what the certified bound of the position error leaves of the view's radius now, m; None as above
    violations : violations of ``sound`` so far
    """

    seen: bool
    time_left_s: float | None
    margin_m: float | None
    violations: int


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
class OpenInterval:
    """The interval in progress."""

    seen: bool
    region: int
    start_s: float
    h: bool
    excited_at_s: float | None = None
    d: bool = False
    max_error_m: float = 0.0
    limits: tuple[DwellTime, DwellTime] | None = None
    exit_levels: tuple[float, float] = (math.inf, math.inf)
    reported: bool = False
    overdue: bool = False


def check(
    current: OpenInterval, limit: DwellTime, length_s: float, v_hi: float, *, armed: bool, complete: bool
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
    broken = armed and exceeds(current, v_hi)
    return IntervalCheck(limit.seconds, "met" if complete else "open", broken)


def exceeds(current: OpenInterval, v_hi: float) -> bool:
    """Whether the position error alone was above a level."""
    return 0.5 * current.max_error_m**2 > v_hi  # V >= |p_til|^2 / 2


def premise(current: OpenInterval, check: IntervalCheck, bounds: DwellBounds, armed: bool) -> bool:
    """Return whether the certificate's premise holds for what follows this interval.

    The conditions for time out of view assume V <= V_lo when it starts (stationary, Lemma 3.3) or V <= V_hi when the
    view before it started (mobile, Theorem 4.1). A broken chain starts again when the error returns below V_hi.
    """
    if not current.seen:
        return check.status == "met" or not exceeds(current, bounds.v_hi)
    if bounds.constants.mobile:
        return armed
    return armed and check.status == "met"


def tally(intervals: list[Interval], name: str) -> dict[str, int]:
    """Count one certificate's checks by status."""
    checks: list[IntervalCheck] = [getattr(i, name) for i in intervals]
    counts = {
        status: sum(c.status == status for c in checks)
        for status in ("met", "violated", "impossible", "open")
    }
    counts["broken"] = sum(c.broken for c in checks)
    return counts

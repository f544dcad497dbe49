"""The promise of a certificate as data: who is seen, how many at once, and how far and how long unseen at most.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| L | ``unseen_max_m`` | m | longest unseen stretch of any way of the class, from entering the site to leaving it |
| T | ``unseen_max_s`` | s | longest time that such a stretch can take |
| N | ``at_once``, ``served`` | | targets at the same time: asked for, and those that the promise holds for |

The way into the first view, the way after the last one, ways that no camera sees and targets that nobody sees all
count. ``certified`` needs a finite stretch within what is allowed, as many targets as asked for, and no refusal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

__all__ = ["BlindCamera", "Promise", "UnseenWay", "join_promises", "with_claims"]

#: what is allowed may be exceeded by this much (m or s): rounding of sums
_SLACK = 1e-6
#: stretches up to this length (m) are contact of two views
_CONTACT_M = 1e-3
_NO_ESTIMATOR = "no estimator was given whose dwell times could be proven"
_NO_MODEL = "no motion model was given (--learn or --model for a world, --model-error for roads)"


@dataclass(frozen=True, slots=True)
class UnseenWay:
    """One unseen stretch of a way.

    Attributes
    ----------
    kind : ``between views``, ``into the first view``, ``after the last view`` or ``never seen``
    length_m, time_s : length and longest duration; inf: it may never end
    source, sink : camera that sees its beginning and its end; None: nobody does
    target : whose way it is
    reason : what makes it so long, in words
    """

    kind: str
    length_m: float
    time_s: float
    source: str | None = None
    sink: str | None = None
    target: str = ""
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the record as plain data; an infinite length becomes None."""
        return {
            "kind": self.kind,
            "length_m": _finite(self.length_m),
            "time_s": _finite(self.time_s),
            "from": self.source,
            "to": self.sink,
            "target": self.target,
            "reason": self.reason,
        }


@dataclass(frozen=True, slots=True)
class BlindCamera:
    """A camera that sees none of the ways, and the likely reason in words."""

    name: str
    reason: str

    def as_dict(self) -> dict[str, str]:
        """Return the record as plain data."""
        return {"name": self.name, "reason": self.reason}


@dataclass(frozen=True, slots=True)
class Promise:
    """What a certificate promises.

    Attributes
    ----------
    target_class : the class in words, with its speeds
    unseen_max_m, unseen_max_s : L and T; inf: not bounded
    longest : the stretch that decides; None where every way is in view from entry to exit
    into_first : the longest way into the first view; None where every way begins in view
    targets : names of the targets; empty for a site
    at_once, served : how many targets at once are asked for, and how many it holds for (None: any number)
    cameras, agents : fixed cameras and agents that it rests on
    limit_m, limit_s : what is allowed; None: not limited
    limit_source : where the limit comes from
    span : the part of a target's way that it covers
    nobody_sees : targets that no camera ever sees
    never_seen_m : length of road, both directions, that no camera sees
    blind : cameras that see none of the ways
    refusals : what keeps it from being given, in words
    """

    target_class: str
    unseen_max_m: float
    unseen_max_s: float
    longest: UnseenWay | None = None
    into_first: UnseenWay | None = None
    targets: tuple[str, ...] = ()
    at_once: int | None = None
    served: int | None = None
    cameras: int = 0
    agents: int = 0
    limit_m: float | None = None
    limit_s: float | None = None
    limit_source: str = "stated"
    span: str = "from entering the site to leaving it"
    nobody_sees: tuple[str, ...] = ()
    never_seen_m: float = 0.0
    blind: tuple[BlindCamera, ...] = ()
    refusals: tuple[str, ...] = field(default=())

    @property
    def bounded(self) -> bool:
        """Whether the longest unseen stretch is finite in metres and in seconds."""
        return math.isfinite(self.unseen_max_m) and math.isfinite(self.unseen_max_s)

    @property
    def enough(self) -> bool:
        """Whether it holds for as many targets as asked for."""
        return self.served is None or (self.at_once is not None and self.at_once <= self.served)

    @property
    def verdict(self) -> str:
        """``certified`` or ``not certified``."""
        good = self.bounded and self.enough and not self.refusals and not self.nobody_sees
        return "certified" if good and self._within() else "not certified"

    def _within(self) -> bool:
        far = self.limit_m is not None and self.unseen_max_m > self.limit_m + _SLACK
        late = self.limit_s is not None and self.unseen_max_s > self.limit_s + _SLACK
        return not (far or late)

    @property
    def sentence(self) -> str:
        """The promise in one sentence."""
        who = self.target_class + (f" ({', '.join(self.targets)})" if 0 < len(self.targets) <= 4 else "")
        return f"{who}, {self._count()}: {self._stretch()}, {self.span}{self._limit()}."

    def _count(self) -> str:
        if self.served is None:
            return "any number at once"
        return "one at a time" if self.served == 1 else f"up to {self.served} at once"

    def _stretch(self) -> str:
        if self.refusals:
            return "nothing is promised"
        if not self.bounded:
            return "may stay out of view without end"
        if self.unseen_max_m <= _CONTACT_M:
            return "always in view, 0 m and 0 s unseen"
        return f"out of view for at most {self.unseen_max_m:.1f} m and {self.unseen_max_s:.1f} s at a stretch"

    def _limit(self) -> str:
        parts = [f"{v:g} {u}" for v, u in ((self.limit_m, "m"), (self.limit_s, "s")) if v is not None]
        return f" (allowed: {' and '.join(parts)}, {self.limit_source})" if parts else ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Everything that speaks against a certificate, the weightiest first; empty when certified."""
        out = [*self.refusals]
        why = f": camera {self.blind[0].name} {self.blind[0].reason}" if self.blind else ""
        out += [f"no camera ever sees {name}{why}" for name in self.nobody_sees]
        if self.longest is not None and not self.bounded:
            out.append(_describe(self.longest))
        elif self.longest is not None and not self._within():
            out.append(f"{_describe(self.longest)} exceeds what is allowed{self._limit()}")
        if not self.enough:
            asked = "any number of targets" if self.at_once is None else f"{self.at_once} targets at once"
            out.append(f"asked for {asked}, it holds for {self.served}")
        return tuple(dict.fromkeys(out))

    def as_dict(self) -> dict[str, Any]:
        """Return the promise as plain data for JSON; infinite values become None."""
        return {
            "sentence": self.sentence,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "target_class": self.target_class,
            "targets": list(self.targets),
            "targets_at_once": self.at_once,
            "targets_served": self.served,
            "cameras": self.cameras,
            "agents": self.agents,
            "bounded": self.bounded,
            "unseen_max_m": _finite(self.unseen_max_m),
            "unseen_max_s": _finite(self.unseen_max_s),
            "longest": None if self.longest is None else self.longest.as_dict(),
            "into_first_view": None if self.into_first is None else self.into_first.as_dict(),
            "never_seen_m": _finite(self.never_seen_m),
            "nobody_sees": list(self.nobody_sees),
            "limit_m": self.limit_m,
            "limit_s": self.limit_s,
            "limit_source": self.limit_source,
            "span": self.span,
            "blind_cameras": [camera.as_dict() for camera in self.blind],
        }


def join_promises(parts: list[Promise]) -> Promise:
    """Return the promise that holds for every target of several classes: the worst of each figure.

    A camera is blind when it sees none of the ways of any class.
    """
    first = parts[0]
    worst = max(parts, key=lambda p: (p.unseen_max_s, p.unseen_max_m))
    blind = [{c.name for c in p.blind} for p in parts]
    served = [p.served for p in parts if p.served is not None]
    entries = [p.into_first for p in parts if p.into_first is not None]
    return replace(
        first,
        target_class="; ".join(dict.fromkeys(p.target_class for p in parts)),
        unseen_max_m=max(p.unseen_max_m for p in parts),
        unseen_max_s=max(p.unseen_max_s for p in parts),
        longest=worst.longest,
        into_first=max(entries, key=lambda w: (w.time_s, w.length_m), default=None),
        targets=tuple(name for p in parts for name in p.targets),
        at_once=None if any(p.at_once is None for p in parts) else max(p.at_once or 0 for p in parts),
        served=min(served) if served else None,
        span="; ".join(dict.fromkeys(p.span for p in parts)),
        nobody_sees=tuple(name for p in parts for name in p.nobody_sees),
        never_seen_m=max(p.never_seen_m for p in parts),
        blind=tuple(c for c in first.blind if all(c.name in names for names in blind)),
        refusals=tuple(dict.fromkeys(r for p in parts for r in p.refusals)),
    )


def with_claims(report: dict[str, Any], promise: Promise) -> dict[str, Any]:
    """Return a report with the promise at its head and the two claims apart.

    ``claims.unseen`` is the verdict of the promise; ``claims.estimate`` holds the ``certificates``: whether the
    estimate survives what is promised. A certificate that was not asked about is not certified.
    """
    estimate: dict[str, Any] = dict(report["certificates"])
    estimate.setdefault("sound", {"verdict": "not certified", "reason": _NO_ESTIMATOR})
    estimate.setdefault("learned", {"verdict": "not certified", "reason": _NO_MODEL})
    if not report["transitions"] and promise.unseen_max_m > _CONTACT_M:
        for name, part in estimate.items():
            if part["verdict"] == "certified":  # over nothing
                reason = "no way leads from view to view, and targets are out of view"
                estimate[name] = {**part, "verdict": "not certified", "reason": reason}
    reason = "; ".join(promise.reasons) or promise.sentence
    return {
        "promise": promise.as_dict(),
        "claims": {"unseen": {"verdict": promise.verdict, "reason": reason}, "estimate": estimate},
        **report,
        "certificates": estimate,
    }


def _describe(way: UnseenWay) -> str:
    ends = ""
    if way.source is not None or way.sink is not None:
        ends = f" (from {way.source or 'the entry'} to {way.sink or 'the exit'})"
    long = (
        f"{way.length_m:.1f} m, {way.time_s:.1f} s" if math.isfinite(way.length_m + way.time_s) else "no end"
    )
    return f"unseen stretch {way.kind}{ends}, {long}" + (f": {way.reason}" if way.reason else "")


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

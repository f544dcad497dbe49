"""Counting handoffs on the truth.

A handoff is *attempted* each time a target, after being lost, enters a region other than the one where it was
last seen. It is *completed* when the target is seen there within ``grace_s`` of entering; its delay is the time
from entering to being seen.

With ``every_entry`` each entry into a region after the start is attempted, seen before or not: a team that never looks
then misses them all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Handoff", "HandoffTracker"]


@dataclass(slots=True)
class Handoff:
    """One attempted handoff of one target; ``t_seen_s`` is NaN while (or when never) seen there."""

    target: int
    from_region: int
    to_region: int
    t_lost_s: float
    t_enter_s: float
    t_seen_s: float = float("nan")

    @property
    def delay_s(self) -> float:
        """Time from entering the region to being seen there, s."""
        return self.t_seen_s - self.t_enter_s

    def completed(self, grace_s: float) -> bool:
        """Whether the target was seen within ``grace_s`` of entering."""
        return bool(self.delay_s <= grace_s + 1e-9)


class HandoffTracker:
    """Follows one target through the network.

    Parameters
    ----------
    target : index of the target
    grace_s : time allowed between entering a region and being seen there, s
    every_entry : count every entry into a region, not only those of a target that was seen elsewhere and lost
    """

    def __init__(self, target: int, grace_s: float, every_entry: bool = False) -> None:
        self.target, self._every = target, every_entry
        self.grace_s = grace_s
        self.handoffs: list[Handoff] = []
        self.visits: list[tuple[float, int]] = []  # (time, region) of every first sighting of a visit
        self._last_seen_region = -1
        self._t_lost_s = float("nan")
        self._seen = False
        self._region = -1
        #: how often the target entered a region, seen or not
        self.entries = 0
        self._open: Handoff | None = None
        self._lap = 1

    def update(self, t_s: float, region: int, seen_by: int) -> None:
        """Advance to ``t_s``: the target is truly in ``region`` (-1: none) and seen by ``seen_by`` (-1: nobody)."""
        seen = seen_by >= 0
        if self._seen and not seen:
            self._t_lost_s = t_s
        entered = region >= 0 and region != self._region and t_s > 0.0
        self.entries += entered
        if entered and (self._every or self._lost_elsewhere(region)):
            self._open = Handoff(self.target, self._last_seen_region, region, self._t_lost_s, t_s)
            self.handoffs.append(self._open)
        if region != self._region and self._open is not None and region != self._open.to_region:
            self._open = None  # left again unseen: the attempt has failed
        if seen:
            self._sighted(t_s, region if region >= 0 else seen_by)
        self._seen, self._region = seen, region

    def _lost_elsewhere(self, region: int) -> bool:
        return not self._seen and self._last_seen_region not in (-1, region)

    def _sighted(self, t_s: float, region: int) -> None:
        if self._open is not None:
            self._open.t_seen_s = t_s
            self._open = None
        if region != self._last_seen_region:
            self.visits.append((t_s, region))
            self._lap += len(self.visits) > 1 and region == self.visits[0][1]
        self._last_seen_region = region

    @property
    def lap(self) -> int:
        """Number of the current lap, from 1: a lap ends when the region of the first sighting is visited again."""
        return self._lap

    @property
    def attempted(self) -> int:
        """Handoffs whose outcome is known to count: all attempted so far."""
        return len(self.handoffs)

    @property
    def completed(self) -> int:
        """Handoffs completed within the grace time."""
        return sum(h.completed(self.grace_s) for h in self.handoffs)

    def delays_s(self) -> np.ndarray:
        """Delays of all handoffs in which the target was seen at last, (n,), s."""
        delays = np.array([h.delay_s for h in self.handoffs], dtype=float)
        return np.asarray(delays[np.isfinite(delays)])

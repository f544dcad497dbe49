"""Who does what: the handoff rule of the built-in system.

Every agent looks only at estimates. In order: follow a target believed to be inside its region; go to the
predicted entry of the target that arrives first; else loiter (harris2020, section 4.1). An estimate whose error
radius exceeds the region's size says nothing of use: the agent then loiters, which is where it sees most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from camnet.simulation.entries import Entry
from camnet.types import Array, BoolArray, TargetEstimate

__all__ = ["Role", "Task", "assign"]


class Role(IntEnum):
    """What an agent is doing."""

    LOITER = 0
    INTERCEPT = 1
    TRACK = 2


@dataclass(frozen=True, eq=False, slots=True)
class Task:
    """Role of one agent, the target it concerns (-1: none) and the entry to meet it at."""

    role: Role
    target: int = -1
    entry: Entry | None = None


def assign(
    estimates: Sequence[TargetEstimate],
    entries: Sequence[Sequence[Entry | None]],
    inside: BoolArray,
    seen_by: BoolArray,
    radius_limit_m: Array,
) -> list[Task]:
    """Give every agent its task.

    Parameters
    ----------
    estimates : M estimates
    entries : ``entries[m][j]``, predicted entry of target m into region j
    inside : (M, N) whether the estimate of target m lies in region j
    seen_by : (N, M) whether agent j measures target m now
    radius_limit_m : (N,) error radius from which an estimate is of no use to agent j, m
    """
    return [
        _task(j, estimates, entries, inside[:, j], seen_by[j], float(limit))
        for j, limit in enumerate(radius_limit_m)
    ]


def _task(
    j: int,
    estimates: Sequence[TargetEstimate],
    entries: Sequence[Sequence[Entry | None]],
    inside: BoolArray,
    seen: BoolArray,
    limit: float,
) -> Task:
    # what is seen is inside, though noise may put its estimate beyond the wall
    present = [m for m in np.flatnonzero(inside | seen).tolist() if seen[m] or estimates[m].radius_m <= limit]
    if present:  # a target in view before one only believed to be there, then the one best known
        m = min(present, key=lambda i: (not seen[i], estimates[i].radius_m))
        return Task(Role.TRACK, m)
    coming = [(entry, m) for m, row in enumerate(entries) if (entry := row[j]) and entry.radius_m <= limit]
    if coming:
        entry, m = min(coming, key=lambda item: (not item[0].direct, item[0].t_s))
        return Task(Role.INTERCEPT, m, entry)
    return Task(Role.LOITER)

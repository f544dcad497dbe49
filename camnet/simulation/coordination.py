"""Who does what: the handoff rule of the built-in system.

Every agent looks only at estimates. In order: follow a target believed to be inside its region; go to the
predicted entry of the target that arrives first; else loiter (harris2020, section 4.1).
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
) -> list[Task]:
    """Give every agent its task.

    Parameters
    ----------
    estimates : M estimates
    entries : ``entries[m][j]``, predicted entry of target m into region j
    inside : (M, N) whether the estimate of target m lies in region j
    seen_by : (N, M) whether agent j measures target m now
    """
    return [_task(j, estimates, entries, inside[:, j], seen_by[j]) for j in range(inside.shape[1])]


def _task(
    j: int,
    estimates: Sequence[TargetEstimate],
    entries: Sequence[Sequence[Entry | None]],
    inside: BoolArray,
    seen: Array | BoolArray,
) -> Task:
    present = np.flatnonzero(inside)
    if present.size:  # a target in view before one only believed to be there, then the one best known
        m = min(present, key=lambda i: (not seen[i], estimates[i].radius_m))
        return Task(Role.TRACK, int(m))
    coming = [(entry.direct, entry, m) for m, row in enumerate(entries) if (entry := row[j]) is not None]
    if coming:
        _, entry, m = min(coming, key=lambda item: (not item[0], item[1].t_s))
        return Task(Role.INTERCEPT, m, entry)
    return Task(Role.LOITER)

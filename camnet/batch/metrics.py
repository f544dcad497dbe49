"""Figures of an episode from the counters; names and meaning are those of `RunStatistics.episode`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from camnet.batch.state import (
    ATTEMPTED,
    COLLISIONS,
    COMPLETED,
    COUNT,
    CYCLE,
    DELAYED,
    DELAYS,
    EFFORT,
    ENTRIES,
    ERRORS,
    EXITS,
    INSIDE,
    LAP,
    NEAREST,
    SEEN,
    SENSES,
    TRACKING,
    State,
)
from camnet.simulation.metrics import delay_summary

__all__ = ["episode_of"]

_GROUPS = ("seen", "unseen", "unseen_first_lap")


def _root(total: float, count: float, scale: float = 1.0) -> float | None:
    return scale * math.sqrt(total / count) if count > 0 else None


def episode_of(state: State, e: int) -> dict[str, Any]:
    """Return the figures of environment ``e``, ready for JSON (unknown ones are None).

    ``tracking_rmse_m`` is the agents' distance from their references. The percentile of the delays is over the first
    `DELAYS` handoffs.
    """
    c = state.count[e]
    errors = {name: c[ERRORS + 3 * k : ERRORS + 3 * k + 3] for k, name in enumerate(_GROUPS)}
    periods = float(state.clock[e, COUNT]) * state.bodies.shape[1]
    return {
        "time_in_view": float(c[SEEN] / max(c[SENSES], 1.0)),
        "time_inside": float(c[INSIDE] / max(state.clock[e, CYCLE] * state.target.shape[1], 1.0)),
        "entries": int(c[ENTRIES]),
        "handoffs": {"attempted": int(c[ATTEMPTED]), "completed": int(c[COMPLETED])},
        "reacquisition_delay_s": delay_summary(state.delays[e, : min(int(c[DELAYED]), DELAYS)]),
        "position_rmse_m": {name: _root(v[1], v[0]) for name, v in errors.items()},
        "orientation_rmse_deg": {name: _root(v[2], v[0], 180.0 / math.pi) for name, v in errors.items()},
        "collisions": int(c[COLLISIONS]),
        "region_exits": int(c[EXITS]),
        "control_effort_m2ps": float(c[EFFORT]),
        "least_agent_distance_m": float(c[NEAREST]) if np.isfinite(c[NEAREST]) else None,
        "laps": [int(lap) for lap in state.track[e, :, LAP]],
        "tracking_rmse_m": _root(c[TRACKING + 1], periods),
    }

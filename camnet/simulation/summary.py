"""The figures of a run, in the form that others rely on."""

from __future__ import annotations

from typing import Any

import numpy as np

from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.metrics import ErrorRecord, delay_summary

__all__ = ["summarise"]


def summarise(
    simulation: NetworkSimulation, errors: dict[str, list[ErrorRecord]], wall_s: float, interrupted: bool
) -> dict[str, Any]:
    """Put the figures of one run together.

    Returns
    -------
    dict
        Ready for JSON. RMSE rows pool all targets; ``unseen`` is taken from the third lap on.
    """
    rows = {name: _pooled(records).summary() for name, records in errors.items()}
    driving = simulation.filter_names[0]
    simulated_s = simulation.snapshot.t_s
    return {
        "time_in_view": simulation.time_in_view(),
        "handoffs": {
            "attempted": sum(t.attempted for t in simulation.trackers),
            "completed": sum(t.completed for t in simulation.trackers),
        },
        "reacquisition_delay_s": delay_summary(np.concatenate([t.delays_s() for t in simulation.trackers])),
        **rows[driving],
        "baselines": {name: row for name, row in rows.items() if name != driving},
        "dwell": simulation.dwell_summary(),
        "controller": simulation.controller_summary(),
        "collisions": simulation.collision_count,
        "region_exits": simulation.region_exits,
        "laps": [t.lap for t in simulation.trackers],
        "simulated_s": simulated_s,
        "interrupted": interrupted,
        "real_time_factor": simulated_s / wall_s if wall_s > 0 else None,
    }


def _pooled(records: list[ErrorRecord]) -> ErrorRecord:
    pool = ErrorRecord()
    for record in records:
        pool.lap += record.lap
        pool.seen += record.seen
        pool.position_m += record.position_m
        pool.angle_rad += record.angle_rad
    return pool

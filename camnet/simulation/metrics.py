"""Errors of every estimator against the truth, seen and unseen, lap by lap."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import angle_between
from camnet.types import Array, TargetEstimate

__all__ = ["STEADY_LAP", "ErrorRecord", "delay_summary", "finite_or_none"]

#: ``unseen`` figures are taken from this lap on; ``unseen_first_lap`` stands beside them
STEADY_LAP = 3


def finite_or_none(value: float) -> float | None:
    """JSON has no NaN: a figure without samples is null."""
    return float(value) if math.isfinite(value) else None


@cached_njit
def _pose_error(p_hat: Array, q_hat: Array, p: Array, q: Array) -> tuple[float, float]:
    """Distance, m, and angle, rad, between two poses."""
    square = 0.0
    for k in range(3):
        square += (p_hat[k] - p[k]) ** 2
    return math.sqrt(square), angle_between(q_hat, q)


class ErrorRecord:
    """Position (m) and orientation (rad) errors of one estimator, one sample per sensing instant."""

    def __init__(self) -> None:
        self._samples: list[tuple[int, bool, float, float]] = []

    def add(self, lap: int, seen: bool, estimate: TargetEstimate, p_world: Array, q_world: Array) -> None:
        """Record one instant; nothing is recorded before the first sighting."""
        if math.isfinite(estimate.last_seen_s):
            self.note(lap, seen, _pose_error(estimate.p_world, estimate.q_world, p_world, q_world))

    def note(self, lap: int, seen: bool, errors: tuple[float, float]) -> None:
        """Record the errors of one instant."""
        self._samples.append((lap, seen, *errors))

    @property
    def latest_m(self) -> float:
        """Position error of the last sample, m (0 before the first)."""
        return self._samples[-1][2] if self._samples else 0.0

    @staticmethod
    def pooled(records: Iterable[ErrorRecord]) -> ErrorRecord:
        """Return one record with the samples of all."""
        pool = ErrorRecord()
        for record in records:
            pool._samples += record._samples
        return pool

    def summary(self) -> dict[str, Any]:
        """RMSE of position (m) and orientation (deg): seen, unseen from lap 3 on, unseen on the first lap."""
        table = np.array(self._samples, dtype=float).reshape(-1, 4)
        lap, seen, position, angle = table[:, 0], table[:, 1] > 0, table[:, 2], np.degrees(table[:, 3])
        masks = {
            "seen": seen,
            "unseen": ~seen & (lap >= STEADY_LAP),
            "unseen_first_lap": ~seen & (lap == 1),
        }
        return {
            "position_rmse_m": {name: _rms(position[mask]) for name, mask in masks.items()},
            "orientation_rmse_deg": {name: _rms(angle[mask]) for name, mask in masks.items()},
        }


def _rms(errors: Array) -> float | None:
    return float(np.sqrt(np.mean(errors**2))) if errors.size else None


def delay_summary(delays_s: Array) -> dict[str, float | None]:
    """Mean and 95th percentile of reacquisition delays, s."""
    if delays_s.size == 0:
        return {"mean": None, "p95": None}
    return {"mean": float(delays_s.mean()), "p95": float(np.percentile(delays_s, 95))}

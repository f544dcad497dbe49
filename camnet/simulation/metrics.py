"""Errors of every estimator against the truth, seen and unseen, lap by lap."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from camnet.geometry.rotations_compiled import angle_between
from camnet.types import Array, TargetEstimate

__all__ = ["STEADY_LAP", "ErrorRecord", "delay_summary", "finite_or_none"]

#: ``unseen`` figures are taken from this lap on; ``unseen_first_lap`` stands beside them
STEADY_LAP = 3


def finite_or_none(value: float) -> float | None:
    """JSON has no NaN: a figure without samples is null."""
    return float(value) if math.isfinite(value) else None


@dataclass(slots=True)
class ErrorRecord:
    """Position (m) and orientation (rad) errors of one estimator, one sample per sensing instant."""

    lap: list[int] = field(default_factory=list)
    seen: list[bool] = field(default_factory=list)
    position_m: list[float] = field(default_factory=list)
    angle_rad: list[float] = field(default_factory=list)

    def add(self, lap: int, seen: bool, estimate: TargetEstimate, p_world: Array, q_world: Array) -> None:
        """Record one instant; nothing is recorded before the first sighting."""
        if not math.isfinite(estimate.last_seen_s):
            return
        d = estimate.p_world - p_world
        self.lap.append(lap)
        self.seen.append(seen)
        self.position_m.append(math.sqrt(float(d @ d)))
        self.angle_rad.append(float(angle_between(estimate.q_world, q_world)))

    def summary(self) -> dict[str, Any]:
        """RMSE of position (m) and orientation (deg): seen, unseen from lap 3 on, unseen on the first lap."""
        lap = np.array(self.lap, dtype=int)
        seen = np.array(self.seen, dtype=bool)
        position = np.array(self.position_m)
        angle = np.degrees(np.array(self.angle_rad))
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

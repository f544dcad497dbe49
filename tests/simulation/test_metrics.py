"""Errors are pooled by lap and by what was seen."""

from __future__ import annotations

import json

import numpy as np
import pytest

from camnet.simulation.metrics import ErrorRecord, delay_summary
from camnet.types import TargetEstimate


def estimate(offset: float, angle: float = 0.0, known: bool = True) -> TargetEstimate:
    q = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    last = 0.0 if known else -np.inf
    return TargetEstimate(0.0, np.array([offset, 0.0, 0.0]), q, np.zeros(3), np.zeros(3), True, last, 0, 0.1)


ORIGIN, UPRIGHT = np.zeros(3), np.array([-1.0, 0.0, 0.0, 0.0])  # the other sign: the same orientation


def test_rows_are_root_mean_squares_of_their_own_samples() -> None:
    record = ErrorRecord()
    for lap, seen, offset in (
        (1, True, 0.1),
        (1, False, 3.0),
        (2, False, 100.0),
        (3, False, 1.0),
        (4, False, 7.0),
    ):
        record.add(lap, seen, estimate(offset, angle=0.2), ORIGIN, UPRIGHT)
    rows = record.summary()
    assert rows["position_rmse_m"]["seen"] == pytest.approx(0.1)
    assert rows["position_rmse_m"]["unseen_first_lap"] == pytest.approx(3.0)
    assert rows["position_rmse_m"]["unseen"] == pytest.approx(5.0)  # lap 2 belongs to neither
    assert rows["orientation_rmse_deg"]["unseen"] == pytest.approx(np.degrees(0.2))


def test_before_the_first_sighting_nothing_counts_and_json_gets_nulls() -> None:
    record = ErrorRecord()
    record.add(1, False, estimate(1.0, known=False), ORIGIN, UPRIGHT)
    assert record.summary()["position_rmse_m"] == {"seen": None, "unseen": None, "unseen_first_lap": None}
    json.dumps(record.summary(), allow_nan=False)
    assert delay_summary(np.array([])) == {"mean": None, "p95": None}

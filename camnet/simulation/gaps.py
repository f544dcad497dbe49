"""Gaps between sightings: what each estimator predicted for the instant and the camera of the re-sighting."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from camnet.estimation.protocol import TargetFilter
from camnet.geometry.regions import Region
from camnet.simulation.entries import Entry, predict_entries
from camnet.types import Array

__all__ = ["Gap", "GapRecorder", "miss", "summarise_gaps"]


@dataclass(slots=True)
class Gap:
    """One gap of one target, closed by a re-sighting.

    Attributes
    ----------
    target : index of the target
    from_camera, to_camera : who saw it before and after
    lost_s, seen_s : when, s
    next_camera : for each estimator the camera it expected (-1: none)
    error_m : for each estimator the distance between prediction and truth at the re-sighting, m
    expected_s : for each estimator when it expected the target in the next camera's region, s (NaN: never)
    """

    target: int
    from_camera: int
    lost_s: float
    next_camera: dict[str, int]
    to_camera: int = -1
    seen_s: float = math.nan
    error_m: dict[str, float] = field(default_factory=dict)
    expected_s: dict[str, float] = field(default_factory=dict)


class GapRecorder:
    """Collects the gaps of one target.

    Parameters
    ----------
    target : index of the target
    regions : region of every camera
    lookahead_s, dt_s : horizon and step of the predictions of the next camera
    """

    def __init__(self, target: int, regions: tuple[Region, ...], lookahead_s: float, dt_s: float) -> None:
        self.gaps: list[Gap] = []
        self._target, self._regions = target, regions
        self._lookahead_s, self._dt_s = lookahead_s, dt_s
        self._open: Gap | None = None
        self._camera = -1
        self._last_p = np.full(3, np.nan)

    @property
    def is_open(self) -> bool:
        """Whether the target is lost."""
        return self._open is not None

    def seen(self, t_s: float, camera: int, p_world: Array, miss_m: Mapping[str, float]) -> None:
        """Take a sighting at the true position ``p_world`` (3,).

        ``miss_m`` is how far from it each estimator expected the target, before it was corrected with the sighting
        (`miss`); it is read only if a gap `is_open`.
        """
        if self._open is not None:
            gap, self._open = self._open, None
            gap.to_camera, gap.seen_s = camera, t_s
            gap.error_m = dict(miss_m)
            gap.error_m["last_seen"] = float(np.linalg.norm(self._last_p - p_world))
            self.gaps.append(gap)
        self._camera, self._last_p = camera, p_world.copy()

    def unseen(self, t_s: float, filters: Mapping[str, TargetFilter]) -> None:
        """Take an instant without a sighting; the first one after a sighting opens a gap."""
        if self._camera < 0 or self._open is not None:
            return
        entries = {name: self._next_entry(f) for name, f in filters.items() if name != "ideal"}
        expected = {name: -1 if entry is None else entry.region for name, entry in entries.items()}
        times = {name: math.nan if entry is None else entry.t_s for name, entry in entries.items()}
        expected["last_seen"] = self._camera
        self._open = Gap(self._target, self._camera, t_s, expected, expected_s=times)

    def _next_entry(self, filter_: TargetFilter) -> Entry | None:
        entries = predict_entries(filter_.rollout(self._lookahead_s, self._dt_s), self._regions)
        coming = [e for e in entries if e is not None]
        return min(coming, key=lambda e: (not e.direct, e.t_s)) if coming else None


def miss(filter_: TargetFilter, t_s: float, p_world: Array) -> float:
    """Error of the prediction carried to ``t_s`` along its velocity (it is at most one frame old), m."""
    estimate = filter_.estimate
    predicted = estimate.p_world + (t_s - estimate.t_s) * estimate.v_world
    return float(np.linalg.norm(predicted - p_world))


def summarise_gaps(gaps: list[Gap]) -> dict[str, Any]:
    """Median and 90th percentile of the errors at re-sighting, and how often the next camera was foreseen."""
    content: dict[str, Any] = {"count": len(gaps)}
    if not gaps:
        return content
    for name in gaps[0].error_m:
        errors = np.array([gap.error_m[name] for gap in gaps])
        content[name] = {
            "median_error_m": float(np.median(errors)),
            "p90_error_m": float(np.percentile(errors, 90)),
        }
    content["next_camera_accuracy"] = {
        name: float(np.mean([gap.next_camera[name] == gap.to_camera for gap in gaps]))
        for name in gaps[0].next_camera
    }
    return content

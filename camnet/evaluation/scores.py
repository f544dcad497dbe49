"""What an episode is scored by, and how the score is taken down decision by decision, whatever the back end."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.env.settings import RewardSettings
from camnet.evaluation.set_metrics import IdentityCounter, gospa, ospa
from camnet.types import Array, BoolArray

__all__ = ["METRICS", "EpisodeRecorder", "Instant", "Metric", "Score", "score_of"]

#: one episode's figures; a figure that an episode does not have (no handoff was attempted) is NaN
Score = dict[str, float]


@dataclass(frozen=True, slots=True)
class Metric:
    """A column of the table: its unit, whether more is better, and what it is."""

    unit: str
    more_is_better: bool
    meaning: str


METRICS: dict[str, Metric] = {
    "return": Metric("", True, "sum of the shared reward"),
    "normalised": Metric("", True, "(return - blind) / (bound - blind) of the same episode"),
    "bound": Metric(
        "", True, "return of a team that sees all targets in regions, at once and without effort"
    ),
    "time_in_view": Metric("", True, "share of target-time in which a camera sees the target"),
    "handoff_success": Metric("", True, "handoffs completed / attempted"),
    "reacquisition_delay_s": Metric("s", False, "mean time from entering a region to being seen there"),
    "position_rmse_seen_m": Metric("m", False, "RMSE of the estimate while some camera sees the target"),
    "position_rmse_unseen_m": Metric("m", False, "RMSE of the prediction while nobody sees it, all laps"),
    "ospa_m": Metric("m", False, "mean OSPA distance (order 2) of estimates and targets"),
    "gospa_m": Metric("m", False, "mean GOSPA distance (order 2, alpha 2)"),
    "id_switches": Metric("", False, "identity switches (CLEAR MOT)"),
    "control_effort_m2ps": Metric("m^2/s", False, "integral of the agents' squared speeds"),
    "least_agent_distance_m": Metric("m", True, "least distance between two agents"),
    "collisions": Metric("", False, "collisions that began"),
    "region_exits": Metric("", False, "times an agent left its region"),
    "dwell_violations": Metric("", False, "dwell times outside the certificate's bounds"),
    "certificate_violations": Metric(
        "", False, "claims of a sound certificate that the run broke (must be 0)"
    ),
}


@dataclass(frozen=True, eq=False, slots=True)
class Instant:
    """Truth and estimates of M targets after one decision.

    Attributes
    ----------
    truth, estimates : (M, 3) positions in the world, m
    known : (M,) whether the target was ever seen
    seen : (M,) whether some camera truly sees it
    """

    truth: Array
    estimates: Array
    known: BoolArray
    seen: BoolArray


class EpisodeRecorder:
    """Takes one episode down.

    Parameters
    ----------
    cutoff_m : cutoff of OSPA, GOSPA and matches
    """

    def __init__(self, cutoff_m: float) -> None:
        self.cutoff_m = cutoff_m
        self._identity = IdentityCounter(cutoff_m)
        self._return = 0.0
        self._squares: dict[bool, list[float]] = {True: [], False: []}
        self._sets: list[tuple[float, float]] = []

    def add(self, reward: float, now: Instant) -> None:
        """Take down one decision."""
        self._return += reward
        known = now.known
        errors = np.sum((now.estimates[known] - now.truth[known]) ** 2, axis=1)
        for square, seen in zip(errors.tolist(), now.seen[known].tolist(), strict=True):
            self._squares[bool(seen)].append(square)
        estimates = now.estimates[known]
        self._sets.append(
            (ospa(now.truth, estimates, self.cutoff_m), gospa(now.truth, estimates, self.cutoff_m))
        )
        self._identity.add(now.truth, estimates, np.flatnonzero(known).tolist())

    def score(self, episode: Mapping[str, Any]) -> Score:
        """Put the episode's figures together; ``episode`` is what the environment reports at its end."""
        sets = np.mean(self._sets, axis=0) if self._sets else (math.nan, math.nan)
        own = {
            "return": self._return,
            "position_rmse_seen_m": _rms(self._squares[True]),
            "position_rmse_unseen_m": _rms(self._squares[False]),
            "ospa_m": float(sets[0]),
            "gospa_m": float(sets[1]),
            "id_switches": float(self._identity.switches),
        }
        return score_of(episode, own)


def score_of(episode: Mapping[str, Any], own: Mapping[str, float]) -> Score:
    """Score from what the environment reports at an episode's end and what a recorder has taken down."""
    handoffs = episode["handoffs"]
    attempted = handoffs["attempted"]
    weights = RewardSettings()
    most = weights.in_view * episode["duration_s"] * episode["time_inside"]
    found = {
        "bound": most + weights.reacquired * episode["entries"],
        "normalised": math.nan,  # takes a blind team's episode, too
        "time_in_view": float(episode["time_in_view"]),
        "handoff_success": handoffs["completed"] / attempted if attempted else math.nan,
        "reacquisition_delay_s": _number(episode["reacquisition_delay_s"]["mean"]),
        "control_effort_m2ps": float(episode["control_effort_m2ps"]),
        "least_agent_distance_m": _number(episode["least_agent_distance_m"]),
        "collisions": float(episode["collisions"]),
        "region_exits": float(episode["region_exits"]),
        "dwell_violations": _number(episode.get("dwell_violations")),
        "certificate_violations": _number(episode.get("certificate_violations")),
        **own,
    }
    return {name: found[name] for name in METRICS}


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _rms(squares: list[float]) -> float:
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan

"""The predictor that everybody seen so far has taught: lessons like this exit vote for the place and for the camera.

The answer is an estimate of the conditional distribution of the re-sighting place, given exit position x, exit
velocity v and elapsed time t, and of its centre (Nadaraya 1964, Watson 1964, with the mode or the geometric median in
place of the mean). It is told nothing of the gap's end but the time asked for.

| symbol | name | meaning |
| --- | --- | --- |
| phi | ``_features`` | ``(x / s_x, v / s_v, log t / s_t)``, (5,) |
| w_j | `vote_weights` | weights of the nearest lessons |
| x_j0, x_j1 | ``start``, ``end`` | exit and entry of lesson j |
| c | ``carry`` | vote ``x_j1 + c (x - x_j0)``: 0 repeats the place, 1 repeats the displacement |
| m | `faded_velocity` | prior mean, one vote of weight ``exp(-prior_distance)`` |

Radius: the distance that holds the stated share of the votes, times the same quantile of the latest ratios of error
to that distance (split conformal prediction, Vovk et al. 2005, over a moving window).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camnet.estimation.crossing.library import LessonLibrary
from camnet.estimation.crossing.location import geometric_median, mode, weighted_mean
from camnet.estimation.crossing.neighbours import nearest_lessons, vote_weights
from camnet.estimation.crossing.settings import CrossingSettings
from camnet.estimation.crossing.sightings import (
    CrossingPrediction,
    ExitState,
    Lesson,
    Sighting,
    faded_velocity,
    only_camera,
)
from camnet.types import Array, IntArray

__all__ = ["CrossingPredictor"]

_MIN_SPREAD_M = 1.0
_MIN_RECORD = 20

Prior = Callable[[ExitState, float], Array]


@dataclass(frozen=True, eq=False, slots=True)
class _Votes:
    """Places (n, 2) with weights (n,), the nearest lesson's being 1; lessons (k,) come first, the prior last."""

    places: Array
    weights: Array
    cameras: IntArray


class CrossingPredictor:
    """Learns from every crossing that it is told of, predicts from those known before the exit.

    Parameters
    ----------
    settings : all options
    cameras : number of cameras
    prior : position (2,) expected at a time if nothing is known of the place; None: the exit velocity, fading
    """

    def __init__(self, settings: CrossingSettings, cameras: int, prior: Prior | None = None) -> None:
        self._settings = settings
        self._cameras = cameras
        self._library = LessonLibrary()
        self._prior = prior or (lambda exit, t_s: faded_velocity(exit, t_s, settings.prior_memory_s))
        self._locate = _locator(settings)
        self._ratios: list[float] = []
        self._ratio_known_s: list[float] = []

    @property
    def lessons(self) -> int:
        """Lessons learned so far."""
        return self._library.count

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Predict the place of a target at ``t_s``, last seen at ``exit``.

        Parameters
        ----------
        exit : the last sighting
        t_s : later than it, s

        Returns
        -------
        CrossingPrediction
            From lessons known before ``exit.t_s`` (``information: exit``) or before ``t_s`` (``now``).
        """
        known_s = exit.t_s if self._settings.information == "exit" else t_s
        votes = self._votes(exit, t_s, self._library.known_before(known_s))
        place = self._locate(votes.places, votes.weights)
        heard = votes.weights[: len(votes.cameras)]
        return CrossingPrediction(
            place,
            self._spread(place, votes) * self._calibration(known_s),
            self._camera_shares(exit, votes.cameras, heard),
            float(heard.sum() ** 2 / (heard @ heard)) if len(heard) else 0.0,
        )

    def next_camera(self, exit: ExitState) -> Array:
        """Probability (C,) of each camera to see a target next, whenever that is, from what was known at the exit."""
        known = self._library.known_before(exit.t_s)
        if known == 0:
            return only_camera(self._cameras, exit.camera)
        index, distance2 = self._nearest(self._features(exit, exit.t_s + 1.0)[:4], exit, known)
        weights = vote_weights(distance2, self._settings.bandwidth_rank, self._settings.bandwidth_floor)
        return self._camera_shares(exit, self._library.camera[index], weights)

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Seen motion teaches nothing about gaps here."""

    def learn(self, lesson: Lesson) -> None:
        """Learn a crossing; a plain one (neither reversed nor extended) is first predicted, to calibrate the radius.

        Raises
        ------
        DataError
            The lesson became known before the one learned last.
        """
        s = self._settings
        if (lesson.reversed and not s.learn_reversed) or (lesson.extended and not s.learn_extended):
            return
        if not (lesson.reversed or lesson.extended):
            self._record_error(lesson)
        self._library.append(
            self._features(lesson.exit, lesson.entry.t_s),
            s.reversed_penalty * lesson.reversed + s.extended_penalty * lesson.extended,
            lesson.exit.t_s,
            lesson.known_s,
            lesson.exit.p_world,
            lesson.entry.p_world,
            lesson.entry.camera,
            lesson.exit.target,
        )

    def _features(self, exit: ExitState, t_s: float) -> Array:
        s = self._settings
        x, v = exit.p_world / s.position_scale_m, exit.v_world / s.velocity_scale_mps
        return np.array([x[0], x[1], v[0], v[1], math.log(max(t_s - exit.t_s, 1e-3)) / s.log_time_scale])

    def _nearest(self, query: Array, exit: ExitState, known: int) -> tuple[IntArray, Array]:
        s, rows = self._settings, self._library
        bonuses = (s.same_target_bonus, s.recency_bonus, s.recency_s)
        index, distance2 = nearest_lessons(
            query,
            exit.t_s,
            exit.target,
            rows.features[:known],
            rows.penalty[:known],
            rows.t_s[:known],
            rows.target[:known],
            bonuses,
            s.neighbours,
        )
        return index, distance2

    def _votes(self, exit: ExitState, t_s: float, known: int) -> _Votes:
        s, rows = self._settings, self._library
        prior = self._prior(exit, t_s)[None]
        if known == 0:
            return _Votes(prior, np.ones(1), np.empty(0, dtype=np.int64))
        index, distance2 = self._nearest(self._features(exit, t_s), exit, known)
        weights = vote_weights(distance2, s.bandwidth_rank, s.bandwidth_floor)
        places = rows.end[index] + s.carry * (exit.p_world - rows.start[index])
        if s.prior_distance is not None:
            places = np.concatenate([places, prior])
            weights = np.append(weights, math.exp(-s.prior_distance))
        return _Votes(places, weights, rows.camera[index])

    def _camera_shares(self, exit: ExitState, cameras: IntArray, weights: Array) -> Array:
        if len(cameras) == 0:
            return only_camera(self._cameras, exit.camera)
        shares = np.bincount(cameras, weights=weights, minlength=self._cameras)
        return np.asarray(shares / shares.sum())

    def _spread(self, place: Array, votes: _Votes) -> float:
        """Distance from ``place`` that holds the stated share of the votes, m."""
        distance = np.hypot(*(votes.places - place).T)
        order = np.argsort(distance)
        share = np.cumsum(votes.weights[order]) / votes.weights.sum()
        k = min(int(np.searchsorted(share, self._settings.coverage)), len(order) - 1)
        return max(float(distance[order[k]]), _MIN_SPREAD_M)

    def _record_error(self, lesson: Lesson) -> None:
        votes = self._votes(lesson.exit, lesson.entry.t_s, self._library.known_before(lesson.exit.t_s))
        place = self._locate(votes.places, votes.weights)
        error = float(np.hypot(*(lesson.entry.p_world - place)))
        self._ratios.append(error / self._spread(place, votes))
        self._ratio_known_s.append(lesson.known_s)

    def _calibration(self, known_s: float) -> float:
        """Quantile of the latest ratios of error to spread that were known before ``known_s``."""
        stop = bisect_left(self._ratio_known_s, known_s)
        latest = self._ratios[max(stop - self._settings.calibration_size, 0) : stop]
        if len(latest) < _MIN_RECORD:
            return math.inf
        return float(np.quantile(latest, self._settings.coverage))


def _locator(settings: CrossingSettings) -> Callable[[Array, Array], Array]:
    if settings.location == "mode":
        return lambda places, weights: mode(places, weights, settings.mode_width_m)
    return geometric_median if settings.location == "geometric_median" else weighted_mean

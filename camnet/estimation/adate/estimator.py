r"""Adaptive trajectory estimation (li2019, section IV, algorithm on p. 9).

One update at time k, with the window [xi_T, k] of states that still change:

1. predict the new state and linearise the window about the last trajectory            (21), (24)
2. transition covariances of the window with the adapted densities                     (72), `scores`
3. covariances of the observations from the residuals of the last trajectory           (37)-(39), `observing`, `weights`
4. Gauss-Newton step of the sparse MAP                                                 (27)-(34), `descent`, `chain`
5. adapt the densities of Q and the scales of R                                        (35)-(39), `adapting`
6. truncation: freeze the states that no longer change                                 (40)-(41), `adapting`

The window's prior is the exact marginal of the frozen states, carried by the forward pass (the paper takes the
last frozen
state as known). A track starts with a linear constant-velocity smoother and hands over to the steering model once
its velocity is significant: before that the heading, on which the model turns, is not known at all.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import DataError
from camnet.estimation.adate.adapting import adapt, store, truncate
from camnet.estimation.adate.descent import engage, solve
from camnet.estimation.adate.observing import append, begin
from camnet.estimation.adate.rollout import predict_step
from camnet.estimation.adate.settings import AdateSettings
from camnet.estimation.adate.smoothing import drifting, outlying, smoothed_covariances
from camnet.estimation.adate.track import Track
from camnet.estimation.adate.track_file import load_track, save_track
from camnet.estimation.kalman.checks import check_observations
from camnet.estimation.pls.model import PowerLimitedSteering, SteeringModel
from camnet.types import Array

__all__ = ["AdaptiveTrajectoryEstimator"]


class AdaptiveTrajectoryEstimator:
    """Sparse MAP over a sliding window with adaptive covariances; cost per update independent of the track's age.

    Parameters
    ----------
    model : motion model, `PowerLimitedSteering` by default (`ConstantTurn` gives the constant-turn baseline)
    dt_s : time between updates, s
    settings : iterations, adaptation, truncation, start
    """

    def __init__(
        self,
        model: SteeringModel | None = None,
        dt_s: float = 1.0,
        settings: AdateSettings | None = None,
    ) -> None:
        self.model = PowerLimitedSteering() if model is None else model
        self.settings = AdateSettings() if settings is None else settings
        if not (math.isfinite(dt_s) and dt_s > 0.0):
            raise DataError(f"dt_s: {dt_s!r} is not a time step; give a finite number of seconds above 0")
        self.dt_s = float(dt_s)
        self._track = Track(self.model, self.dt_s, self.settings)

    # ---------------------------------------------------------------- what is known

    @property
    def steps(self) -> int:
        """Number of updates so far."""
        return self._track.steps

    @property
    def restarts(self) -> int:
        """Times a trajectory that lost the observations was started again."""
        return self._track.restarts

    @property
    def fallbacks(self) -> int:
        """Steps that stayed at the linear solution because a restart failed too."""
        return self._track.fallbacks

    @property
    def power_scale(self) -> float:
        """Learnt factor on the density of the specific power."""
        return self._track.power_scale

    @property
    def steering_scale(self) -> float:
        """Learnt factor on the density of the turn rate."""
        return self._track.steering_scale

    @property
    def trajectory(self) -> Array:
        """States (k,10) so far, each at its latest estimate; a copy."""
        return self._track.all[: self.steps].copy()

    @property
    def causal_state(self) -> Array:
        """State (10,) at the last update, from the observations so far."""
        out: Array = self._track.all[self.steps - 1].copy()
        return out

    @property
    def covariance(self) -> Array:
        """Covariance (10,10) of `causal_state`, positive definite."""
        out: Array = self._track.causal_cov.copy()
        return out

    @property
    def window(self) -> int:
        """Number of states updated by the last update."""
        return self._track.win.n

    def predict(self, horizon_s: float, step_s: float | None = None) -> tuple[Array, Array, Array]:
        """Mean path of the target after the last update, as if nothing more were seen; the estimator is left as it is.

        Parameters
        ----------
        horizon_s : how far ahead, s
        step_s : step of the path, s; `dt_s` when left out

        Returns
        -------
        times (n,) s after the last update, means (n,10), covariances (n,10,10)
        """
        step = self.dt_s if step_s is None else float(step_s)
        if not (step > 0.0 and horizon_s >= step):
            raise DataError(f"horizon_s: {horizon_s!r} does not hold one step of {step!r} s")
        count = int(horizon_s / step + 1e-9)
        mean, cov = self.causal_state, self.covariance
        means, covs = np.empty((count, 10)), np.empty((count, 10, 10))
        for k in range(count):
            self.carry(mean, cov, step)
            means[k], covs[k] = mean, cov
        return step * np.arange(1.0, count + 1.0), means, covs

    def carry(self, mean: Array, cov: Array, step_s: float) -> None:
        """Advance a mean (10,) and its covariance (10,10) in place by ``step_s``, with the densities learnt so far."""
        t = self._track
        predict_step(t.par, mean, cov, step_s, t.rest, t.power_scale, t.steering_scale)

    def inherit(self, other: AdaptiveTrajectoryEstimator) -> None:
        """Begin with the densities that another track of the same model has learnt."""
        self._track.power_scale = other.power_scale
        self._track.steering_scale = other.steering_scale

    def smoothed_covariances(self) -> Array:
        """Return the covariances (k,10,10) of `trajectory`, by a backward pass over all states so far."""
        return smoothed_covariances(self._track)

    def outlying(self) -> dict[int, bool]:
        """By observer of the last update: whether its observation is an outlier or part of a drift."""
        return outlying(self._track)

    def drifting(self) -> dict[int, bool]:
        """By observer so far: whether its last residuals do not average out; nobody with fewer than three observers."""
        return drifting(self._track)

    def save(self, path: Path | str) -> None:
        """Write the whole track to a file that `load` goes on from; an interrupted call leaves no half file."""
        save_track(self, Path(path))

    @classmethod
    def load(cls, path: Path | str) -> AdaptiveTrajectoryEstimator:
        """Return an estimator that goes on exactly where the saved one was.

        Raises
        ------
        DataError : the file is not one that `save` wrote
        """
        return load_track(cls, Path(path))

    # ---------------------------------------------------------------- the update

    def update(
        self,
        observations: ArrayLike,
        covariances: ArrayLike,
        observers: ArrayLike | None = None,
        dt_s: float | None = None,
    ) -> Array:
        """Advance by one step and take the observations of that step.

        Parameters
        ----------
        observations : (m,3) positions in the world frame, m; m = 0 when nothing was seen
        covariances : (m,3,3) their covariances as believed, m^2
        observers : (m,) integers that name the observers; 0..m-1 when left out
        dt_s : time since the last update, s; `dt_s` of the estimator when left out

        Returns
        -------
        (10,) the causal state

        Raises
        ------
        DataError : shapes do not fit, values are not finite or a covariance is not positive definite
        """
        obs, cov = check_observations(observations, covariances)
        ids = _names(observers, len(obs))
        if self.steps == 0 and not len(obs):
            raise DataError("observations: the first update must hold at least one observation to start from")
        track = self._track
        if dt_s is not None and not (math.isfinite(dt_s) and dt_s > 0.0):
            raise DataError(f"dt_s: {dt_s!r} is not a time step; give a finite number of seconds above 0")
        track.elapsed_s = self.dt_s if dt_s is None else float(dt_s)
        append(track, obs, cov, ids)
        if track.steps == 0:
            begin(track)
        track.steps += 1
        if track.steps > len(track.all):
            track.all = np.concatenate([track.all, np.zeros_like(track.all)])
        solve(track)
        if track.rest:
            engage(track)
        adapt(track)
        store(track)
        truncate(track)
        return self.causal_state


def _names(observers: ArrayLike | None, count: int) -> list[int]:
    """Who made the observations, as integers; 0..m-1 when not said."""
    if observers is None or not count:
        return list(range(count))
    ids = [int(i) for i in np.asarray(observers).ravel()]
    if len(ids) != count or len(set(ids)) != count:
        raise DataError(f"observers: {ids!r} must name each of the {count} observations once")
    return ids

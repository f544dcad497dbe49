"""Kalman, extended and unscented Kalman filters with fixed-lag smoothing, with the interface of AdaTE."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import ConfigError, DataError
from camnet.estimation.kalman.checks import check_observations
from camnet.estimation.kalman.kernels import (
    observe,
    predict_linearised,
    predict_unscented,
    smooth_lag,
    smoother_gain,
)
from camnet.estimation.kalman.models import STEERING, LinearModel, kernel_model
from camnet.estimation.pls.model import SteeringModel
from camnet.types import Array

__all__ = ["ExtendedKalmanFilter", "KalmanFilter", "UnscentedKalmanFilter"]

_SD = {6: (5.0,), 9: (5.0, 1.0)}


class KalmanFilter:
    """Kalman filter with a fixed-lag smoother; extended when the model is a steering model.

    Parameters
    ----------
    model : `LinearModel` (made for the same ``dt_s``), what makes one for a time step, or a steering model of
        `camnet.estimation.pls`
    dt_s : time between updates, s
    lag : steps that the smoother goes back at each update; 0 for the filter alone
    mean, covariance : prior of the first state (n,), (n,n); from the first observation when left out
    significance : normalised squared speed at which a steering model takes over from constant velocity
    """

    def __init__(
        self,
        model: LinearModel | SteeringModel | Callable[[float], LinearModel],
        dt_s: float = 1.0,
        lag: int = 50,
        mean: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        significance: float = 12.0,
    ) -> None:
        if not (math.isfinite(dt_s) and dt_s > 0.0):
            raise ConfigError(f"dt_s: {dt_s!r} is not a time step; give a finite number of seconds above 0")
        if lag < 0:
            raise ConfigError(f"lag: {lag!r} is negative; give a number of steps, 0 for no smoothing")
        if (mean is None) != (covariance is None):
            raise ConfigError("mean, covariance: give both or neither")
        self._of_step = None if isinstance(model, LinearModel | SteeringModel) else model
        if not isinstance(model, LinearModel | SteeringModel):
            model = model(float(dt_s))
        self.model, self.dt_s, self.lag = model, float(dt_s), int(lag)
        self._kind, self._par, self._f, self._q = kernel_model(model)
        n = len(self._f)
        self.size = n
        self.steps = 0
        self._x, self._p = np.zeros(n), np.eye(n)
        self._xp, self._pp, self._c = np.zeros(n), np.eye(n), np.zeros((n, n))
        self._given = mean is not None
        if mean is not None:
            self._x[:], self._p[:] = np.asarray(mean, dtype=float), np.asarray(covariance, dtype=float)
        self._rest = self._kind == STEERING and not self._given
        self._significance = significance
        rows = 256
        self._filtered, self._predicted = np.zeros((rows, n)), np.zeros((rows, n))
        self._gains, self._all = np.zeros((rows, n, n)), np.zeros((rows, n))

    @property
    def trajectory(self) -> Array:
        """States (k,n) so far, each smoothed by the ``lag`` steps after it; a copy."""
        return self._all[: self.steps].copy()

    @property
    def causal_state(self) -> Array:
        """State (n,) after the last update."""
        return self._x.copy()

    @property
    def covariance(self) -> Array:
        """Covariance (n,n) of `causal_state`."""
        return self._p.copy()

    def update(self, observations: ArrayLike, covariances: ArrayLike, dt_s: float | None = None) -> Array:
        """Advance by one step and take that step's observations; see `check_observations`.

        Parameters
        ----------
        dt_s : time since the last update, s, where it is not the filter's; a linear model must be made by step then

        Returns
        -------
        (n,) the filtered state
        """
        obs, cov = check_observations(observations, covariances)
        if dt_s is not None and dt_s != self.dt_s:
            self._retime(dt_s)
        if self.steps == 0 and not self._given:
            self._begin(obs, cov)
        else:
            if self.steps > 0:
                self._predict()
                self._x, self._xp = self._xp, self._x
                self._p, self._pp = self._pp, self._p
            if len(obs):
                self._remember_prediction()
                observe(self._x, self._p, obs, cov)
            elif self.lag:
                self._remember_prediction()
        if self._rest:
            self._engage()
        self._keep()
        return self._x

    def _retime(self, dt_s: float) -> None:
        """Make the steps from here on ``dt_s`` long."""
        if not (math.isfinite(dt_s) and dt_s > 0.0):
            raise ConfigError(f"dt_s: {dt_s!r} is not a time step; give a finite number of seconds above 0")
        if self._of_step is not None:
            self.model = self._of_step(dt_s)
            _, _, self._f, self._q = kernel_model(self.model)
        elif self._kind != STEERING:
            raise ConfigError(
                f"dt_s: {dt_s!r}: this linear model is for {self.dt_s} s; give what makes one for a step"
            )
        self.dt_s = dt_s

    def _begin(self, obs: Array, cov: Array) -> None:
        if not len(obs):
            raise DataError("observations: the first update must hold at least one observation to start from")
        info = np.linalg.inv(cov)
        total = np.linalg.inv(info.sum(axis=0))
        self._x[:3] = total @ np.einsum("kij,kj->i", info, obs)
        self._p[:3, :3] = total
        if self._kind == STEERING:
            self._x[6] = 0.5
            sd = [5.0] * 3 + [0.2] + [0.05] * 3
        else:
            sd = [s for s in _SD.get(self.size, (5.0,) * (self.size // 3 - 1)) for _ in range(3)]
        self._p[range(3, self.size), range(3, self.size)] = np.square(sd)

    def _predict(self) -> None:
        predict_linearised(
            self._kind, self._par, self._f, self._q, self.dt_s, self._rest,
            self._x, self._p, self._xp, self._pp, self._c,
        )  # fmt: skip

    def _engage(self) -> None:
        """Hand over from constant velocity to the steering model once the velocity is significant."""
        v = self._x[3:6]
        if v @ np.linalg.solve(self._p[3:6, 3:6], v) < self._significance:
            return
        self._rest = False
        speed = float(np.linalg.norm(v))
        self._x[6] = speed * (self._par[1] * speed + self._par[2])
        self._p[6:, :] = 0.0
        self._p[:, 6:] = 0.0
        self._p[range(6, 10), range(6, 10)] = np.square([0.2, 0.05, 0.05, 0.05])

    def _remember_prediction(self) -> None:
        if self.lag and self.steps > 0:
            if self.steps == len(self._all):
                self._grow()
            self._predicted[self.steps] = self._x
            smoother_gain(self._p, self._c, self._gains[self.steps - 1])

    def _keep(self) -> None:
        if self.steps == len(self._all):
            self._grow()
        self._filtered[self.steps] = self._x
        if self.lag:
            smooth_lag(self.steps, self.lag, self._filtered, self._predicted, self._gains, self._all)
        else:
            self._all[self.steps] = self._x
        self.steps += 1

    def _grow(self) -> None:
        for name in ("_filtered", "_predicted", "_gains", "_all"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros_like(old)]))


class ExtendedKalmanFilter(KalmanFilter):
    """Extended Kalman filter: the prediction through the exact derivative of the model's flow."""


class UnscentedKalmanFilter(KalmanFilter):
    """Unscented Kalman filter: the prediction by scaled sigma points.

    Parameters
    ----------
    alpha, beta, kappa : scaling of the sigma points; the defaults give no negative weight, so that the
        covariance stays positive definite
    others : as in `KalmanFilter`
    """

    def __init__(
        self,
        model: LinearModel | SteeringModel | Callable[[float], LinearModel],
        dt_s: float = 1.0,
        lag: int = 50,
        mean: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        significance: float = 12.0,
        alpha: float = 1.0,
        beta: float = 0.1,
        kappa: float = 0.0,
    ) -> None:
        super().__init__(model, dt_s, lag, mean, covariance, significance)
        self._scaling = np.array([alpha, beta, kappa], dtype=float)
        if not alpha**2 * (self.size + kappa) > 0.0:
            raise ConfigError(f"alpha {alpha!r}, kappa {kappa!r}: alpha^2 (n + kappa) must be above 0")

    def _predict(self) -> None:
        predict_unscented(
            self._kind, self._par, self._f, self._q, self.dt_s, self._rest, self._scaling,
            self._x, self._p, self._xp, self._pp, self._c,
        )  # fmt: skip

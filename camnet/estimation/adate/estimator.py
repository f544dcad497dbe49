r"""Adaptive trajectory estimation (li2019, section IV, algorithm on p. 9).

One update at time k, with the window [xi_T, k] of states that still change:

1. predict the new state and linearise the window about the last trajectory            (21), (24)
2. transition covariances of the window with the adapted densities                     (72), `scores`
3. covariances of the observations from the residuals of the last trajectory           (37)-(39), `weights`
4. Gauss-Newton step of the sparse MAP, damped so that the objective never rises         (27)-(34), `chain`, `objective`
5. adapt the densities of Q and the scales of R                                        (35)-(39)
6. truncation: freeze the states that no longer change                                 (40)-(41)

The window's prior is the exact marginal of the frozen states, carried by the forward pass (the paper takes the
last frozen
state as known). A track starts with a linear constant-velocity smoother and hands over to the steering model once
its velocity is significant: before that the heading, on which the model turns, is not known at all.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from camnet.errors import DataError
from camnet.estimation.adate.chain import backward, forward
from camnet.estimation.adate.rollout import predict_step
from camnet.estimation.adate.scores import fade, scores
from camnet.estimation.adate.settings import AdateSettings
from camnet.estimation.adate.weights import GATE, LOCAL, NONE, STUDENT, combine, learn_scale, reweight
from camnet.estimation.adate.window import Window
from camnet.estimation.kalman.checks import check_observations
from camnet.estimation.pls.model import PowerLimitedSteering, SteeringModel
from camnet.estimation.pls.noise import channel_covariances, transition
from camnet.types import Array

__all__ = ["AdaptiveTrajectoryEstimator"]

_RULES: Final = {"local": LOCAL, "gate": GATE, "student": STUDENT, "none": NONE}
#: weights of the truncation index: position, velocity, power and turn rate (40)
_PSI: Final = np.array([1.0] * 3 + [0.25] * 3 + [1.0 / 9.0] * 4)


@njit(cache=True, error_model="numpy")
def _linearise(
    n: int,
    par: Array,
    s: Array,
    tau: Array,
    rest: bool,
    nxt: Array,
    jac: Array,
    q_power: Array,
    q_steer: Array,
    q_iso: Array,
) -> None:
    for i in range(n - 1):
        resting = transition(par, s[i], tau[i], rest, nxt[i], jac[i])
        channel_covariances(par, s[i], nxt[i], tau[i], resting, jac[i], q_power[i], q_steer[i], q_iso[i])


@njit(cache=True, error_model="numpy")
def _largest_defect(n: int, s: Array, nxt: Array, q: Array) -> float:
    worst = 0.0
    for i in range(n - 1):
        total = 0.0
        for m in range(10):
            e = s[i + 1, m] - nxt[i, m]
            total += e * e / q[i, m, m]
        if not total <= worst:
            worst = total if total == total else math.inf
    return worst


@njit(cache=True, error_model="numpy")
def _mix(
    first: int, n: int, power: float, steer: float, q_power: Array, q_steer: Array, q_iso: Array, q: Array
) -> None:
    for i in range(first, n - 1):
        for a in range(10):
            for b in range(10):
                q[i, a, b] = power * q_power[i, a, b] + steer * q_steer[i, a, b] + q_iso[i, a, b]


class AdaptiveTrajectoryEstimator:
    """Sparse MAP over a sliding window with adaptive covariances; cost per update independent of the track's age.

    Parameters
    ----------
    model : motion model, `PowerLimitedSteering` by default (`ConstantTurn` gives the constant-turn baseline)
    dt_s : time between updates, s
    settings : iterations, adaptation, truncation, start

    Attributes
    ----------
    steps : number of updates so far
    restarts : times a trajectory that lost the observations was started again
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
        self.steps = 0
        self.restarts = 0
        self.fallbacks = 0
        self.power_scale = 1.0
        self.steering_scale = 1.0
        self._par = self.model.parameters
        self._win = Window(self.settings.truncation.limit)
        self._start = 0
        self._rest = True
        self._all = np.zeros((256, 10))
        self._mean = np.zeros(10)
        self._cov: Array = np.eye(10)
        self._causal_cov: Array = np.eye(10)
        self._ids: dict[int, int] = {}
        self._scale = np.tile(np.eye(3), (self._win.slots, 1, 1))
        self._weight = np.zeros(self._win.slots)
        a = self.settings.adaptation
        self._rule = _RULES[a.observation]
        self._rule_par = np.array(
            [a.drift_span, a.drift_gate, a.outlier_gate, a.memory_s, a.student_dof, a.scale_memory],
            dtype=float,
        )
        self._keep_q = False

    # ---------------------------------------------------------------- what is known

    @property
    def trajectory(self) -> Array:
        """States (k,10) so far, each at its latest estimate; a copy."""
        return self._all[: self.steps].copy()

    @property
    def causal_state(self) -> Array:
        """State (10,) at the last update, from the observations so far."""
        out: Array = self._all[self.steps - 1].copy()
        return out

    @property
    def covariance(self) -> Array:
        """Covariance (10,10) of `causal_state`, positive definite."""
        out: Array = self._causal_cov.copy()
        return out

    @property
    def window(self) -> int:
        """Number of states updated by the last update."""
        return self._win.n

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
            predict_step(self._par, mean, cov, step, self._rest, self.power_scale, self.steering_scale)
            means[k], covs[k] = mean, cov
        return step * np.arange(1.0, count + 1.0), means, covs

    # ---------------------------------------------------------------- the update

    def update(
        self, observations: ArrayLike, covariances: ArrayLike, observers: ArrayLike | None = None
    ) -> Array:
        """Advance by one step and take the observations of that step.

        Parameters
        ----------
        observations : (m,3) positions in the world frame, m; m = 0 when nothing was seen
        covariances : (m,3,3) their covariances as believed, m^2
        observers : (m,) integers that name the observers; 0..m-1 when left out

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
        self._append(obs, cov, ids)
        if self.steps == 0:
            self._begin()
        self.steps += 1
        if self.steps > len(self._all):
            self._all = np.concatenate([self._all, np.zeros_like(self._all)])
        self._solve()
        if self._rest:
            self._engage()
        self._adapt()
        self._store()
        self._truncate()
        return self.causal_state

    def _append(self, obs: Array, cov: Array, ids: list[int]) -> None:
        win = self._win
        new = [i for i in ids if i not in self._ids]
        for i in new:
            self._ids[i] = len(self._ids)
        if len(self._ids) > win.slots:
            win.widen(2 * len(self._ids))
            extra = win.slots - len(self._weight)
            self._scale = np.concatenate([self._scale, np.tile(np.eye(3), (extra, 1, 1))])
            self._weight = np.concatenate([self._weight, np.zeros(extra)])
        win.append()
        for row, i in enumerate(ids):
            slot = self._ids[i]
            win.obs[-1, slot], win.given[-1, slot], win.has[-1, slot] = obs[row], cov[row], True
        win.tau[-1] = self.dt_s
        if win.n > 1:
            transition(self._par, win.s[-2], self.dt_s, self._rest, win.s[-1], win.jac[-2])

    def _begin(self) -> None:
        """Prior of the first state: where it was seen, with a wide velocity."""
        win, start = self._win, self.settings.start
        win.s[0] = 0.0
        self._weigh()
        win.s[0, :3] = win.z[0]
        self._mean[:] = win.s[0]
        spread = [100.0 * float(np.trace(win.rbar[0]))] * 3 + [start.speed_sd_m_s**2] * 3
        self._cov = np.diag([*spread, start.power_sd**2, *[start.turn_sd_rad_s**2] * 3])

    def _weigh(self, plain: bool = False) -> None:
        """Step 3: covariances of the observations in force, and their combination."""
        w = self._win
        rule = NONE if plain or self.steps == 0 else self._rule
        reweight(
            rule,
            w.n,
            w.s,
            w.tau,
            w.obs,
            w.given,
            w.has,
            self._scale,
            self._weight,
            self._rule_par,
            w.r,
            w.sound,
        )
        combine(w.n, w.obs, w.has, w.r, w.z, w.rbar, w.seen)

    def _solve(self) -> None:
        """Take Gauss-Newton steps until the transitions close, from a linear start when they do not."""
        self._weigh()
        if self._rest:
            self._linearise()
            self._pass()
            self._win.s[:] += self._win.d
            return
        before = self._win.s.copy()
        if not self._converge() and not self._restart(before):
            self._fall_back(before)

    def _converge(self) -> bool:
        """Gauss-Newton steps; whether every transition is closed to within its noise."""
        most = max(self.settings.iterations, self.settings.rescue)
        self._linearise()
        for k in range(most):
            self._pass()
            moved = self._step()
            self._linearise()
            closed = self._defect() < self.settings.closed
            if closed and (k + 1 >= self.settings.iterations or moved < self.settings.tolerance):
                return True
        return False

    def _restart(self, before: Array) -> bool:
        """Start the window again from the linear constant-velocity smoother, which has one solution."""
        self.restarts += 1
        self._smooth_linearly(before)
        self._steer()
        return self._converge()

    def _fall_back(self, before: Array) -> None:
        """Leave the window at the linear solution for this step."""
        self.fallbacks += 1
        self._smooth_linearly(before)

    def _smooth_linearly(self, before: Array) -> None:
        w = self._win
        w.s[:] = before
        self._rest, self._keep_q = True, False
        self._linearise()
        self._pass()
        w.s[:] += w.d
        self._rest = False

    def _steer(self) -> None:
        """Power and turn rate of the window for its velocities: equilibrium power, no turn."""
        w = self._win
        speed = np.linalg.norm(w.s[:, 3:6], axis=1)
        w.s[:, 6] = speed * (self._par[1] * speed + self._par[2])
        w.s[:, 7:10] = 0.0

    def _linearise(self) -> None:
        w = self._win
        _linearise(w.n, self._par, w.s, w.tau, self._rest, w.nxt, w.jac, w.q_power, w.q_steer, w.q_iso)
        first = w.n - 2 if self._keep_q else 0  # (35) keeps what it adapted
        _mix(first, w.n, self.power_scale, self.steering_scale, w.q_power, w.q_steer, w.q_iso, w.q)

    def _defect(self) -> float:
        """Largest squared transition error of the window in units of its variances (inf when not finite)."""
        w = self._win
        return float(_largest_defect(w.n, w.s, w.nxt, w.q))

    def _pass(self) -> None:
        w = self._win
        forward(
            w.n, w.s, w.nxt, w.jac, w.q, w.z, w.rbar, w.seen, self._mean, self._cov,
            w.pred_d, w.pred_p, w.filt_d, w.filt_p, w.gain, w.s_inv, w.y,
        )  # fmt: skip
        backward(w.n, w.jac, w.seen, w.pred_d, w.pred_p, w.gain, w.s_inv, w.y, w.d, w.lam)
        self._pred_mean = w.s + w.pred_d

    def _step(self) -> float:
        """Apply the step, shortened so that no velocity turns over; returns the largest change."""
        w = self._win
        speed = np.linalg.norm(w.s[:, 3:6], axis=1)
        change = np.linalg.norm(w.d[:, 3:6], axis=1)
        step = min(1.0, float(np.min((speed + 0.3) / (change + 1e-12))))
        w.s[:] += step * w.d
        return float(np.max(np.abs(step * w.d)))

    def _engage(self) -> None:
        """Hand over from constant velocity to the steering model once the velocity is significant."""
        w, start = self._win, self.settings.start
        v, p = w.s[-1, 3:6], w.filt_p[-1, 3:6, 3:6]
        if w.n < 5 or v @ np.linalg.solve(p, v) < start.significance:
            return
        self._rest = False
        linear = w.s.copy()
        self._steer()
        self._anchor()
        if not self._converge():
            w.s[:] = linear
            self._linearise()
            self._rest = True

    def _anchor(self) -> None:
        """Prior of the window's first state for the steering model: near its equilibrium speed (below (10))."""
        w, start = self._win, self.settings.start
        v = w.s[0, 3:6]
        speed = float(np.linalg.norm(v))
        along = v / speed
        slope = 1.0 / math.sqrt(self._par[2] ** 2 + 4.0 * self._par[1] * w.s[0, 6]) if self._par[2] else 0.0
        self._mean[3:] = w.s[0, 3:]
        cov = np.zeros((10, 10))
        cov[:3, :3] = self._cov[:3, :3]
        cov[3:6, 3:6] = start.speed_sd_m_s**2 * (np.eye(3) - np.outer(along, along))
        cov[3:6, 3:6] += (start.balance_sd_m_s**2 + (slope * start.power_sd) ** 2) * np.outer(along, along)
        cov[3:6, 6] = cov[6, 3:6] = slope * start.power_sd**2 * along
        cov[range(6, 10), range(6, 10)] = [start.power_sd**2, *[start.turn_sd_rad_s**2] * 3]
        self._cov = cov

    def _adapt(self) -> None:
        """Step 5."""
        w, a = self._win, self.settings.adaptation
        if a.process == "score" and not self._rest:
            num_p, den_p, num_s, den_s = scores(
                w.n, a.process_lag, w.jac, w.seen, w.gain, w.s_inv, w.lam, w.q_power, w.q_steer
            )
            if den_p > 0.0:
                top = math.log(a.process_range)
                g = a.process_gain
                for name, num, den in (("power_scale", num_p, den_p), ("steering_scale", num_s, den_s)):
                    log = math.log(getattr(self, name)) + g * min(num / den - 1.0, 3.0)
                    setattr(self, name, math.exp(min(max(log, -top), top)))
        elif a.process == "fading":
            fade(w.n, w.s, w.nxt, w.q, w.tau, a.memory_s)
            self._keep_q = not self._rest
        row = w.n - 1 - a.process_lag
        if a.learn_scale and row >= 0 and not self._rest:
            learn_scale(
                w.s[row], w.obs[row], w.given[row], w.has[row], w.sound[row], 10.0 * a.scale_memory,
                self._scale, self._weight,
            )  # fmt: skip

    def _store(self) -> None:
        """Write the window into the trajectory and take the truncation index (40).

        Steps after the last observation hold the mean of the prediction (`rollout`); the window keeps the flow.
        """
        w, t = self._win, self.settings.truncation
        old = self._all[self._start : self.steps]
        theta = ((w.s - old) ** 2) @ _PSI
        known = np.isfinite(w.change)
        w.change[:] = np.where(
            known, (1.0 - t.average) * np.where(known, w.change, 0.0) + t.average * theta, theta
        )
        w.change[-1] = np.inf
        if w.seen[-1]:
            old[:] = w.s
            self._causal_cov = w.filt_p[-1].copy()
            return
        blind = int(np.argmax(w.seen[::-1])) if w.seen.any() else w.n
        old[: w.n - blind] = w.s[: w.n - blind]
        mean = self._all[self.steps - 2].copy()
        predict_step(
            self._par, mean, self._causal_cov, self.dt_s, self._rest, self.power_scale, self.steering_scale
        )
        old[-1] = mean

    def _truncate(self) -> None:
        """Step 6: freeze what no longer changes (41); its marginal becomes the window's prior."""
        w, t = self._win, self.settings.truncation
        seen = np.flatnonzero(w.seen)
        last = int(seen[-t.keep]) if len(seen) > t.keep else 0
        loud = np.flatnonzero(w.change > t.threshold)
        quiet = int(loud[0]) if len(loud) else last
        drop = max(min(last, quiet), w.n - t.limit)
        if drop > 0:
            self._mean = self._pred_mean[drop].copy()
            self._cov = w.pred_p[drop].copy()
            w.drop(drop)
            self._pred_mean = self._pred_mean[drop:]
            self._start += drop


def _names(observers: ArrayLike | None, count: int) -> list[int]:
    """Who made the observations, as integers; 0..m-1 when not said."""
    if observers is None or not count:
        return list(range(count))
    ids = [int(i) for i in np.asarray(observers).ravel()]
    if len(ids) != count or len(set(ids)) != count:
        raise DataError(f"observers: {ids!r} must name each of the {count} observations once")
    return ids

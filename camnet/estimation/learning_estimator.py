"""The learning estimator and predictor of one target over several operating regions (harris2020 ch. 3, 4; parikh2018).

Every region j has its own weights W_j and history stack: they are kept while the target is elsewhere and go on when it
returns. When the target leaves O_j the predictor runs on with W_j, and the path across the gap, once the target has been
found again, is learned into stack j: the next time the target leaves O_j, the gap is known.

State in the world frame (default): then f = 0 and a camera's own velocity, with its noise, enters nowhere; the velocities
to be learned are functions of the world pose; nothing jumps when another camera takes over; and a camera that moves after
the loss does not matter. The relative form (state with respect to the camera, f from its motion) is the same law in other
coordinates; see ``frames``.

Departures from the printed laws, each with its setting: a new sighting restarts the pose at the measurement
(``reset_on_sighting``: the pose is measured, and the transient of a large error would be learned as velocity through the
term ``Gamma sigma eta_til^T``); the prior mean of the gap remedies is blended in also while the target is seen, since
W_hat is as empty there on the first visit; the laws of regions that are not in force run on in one go at the next visit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis, evaluate
from camnet.estimation.concurrent_learning import SWITCHING, MotionModel, correct_pose, output_error
from camnet.estimation.gap import EndState, PoseHistory, gap_windows
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.propagate import COLUMNS, PRIORS, TWIST_OUTPUTS, UNIT, advance, model_twist, roll_out
from camnet.estimation.protocol import Rollout
from camnet.estimation.radius import ErrorRadius
from camnet.estimation.settings import EstimatorSettings
from camnet.estimation.windows import WindowCollector
from camnet.geometry.rotations_compiled import align_sign, multiply, normalise
from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["LearningEstimator"]

#: longest step of the predictor's integration, s
MAX_STEP_S = 0.05
#: windows refused in a row as outliers before the target is believed to have changed its ways
CHANGE_AFTER = 5
#: eigenvalues for the diagnostics are computed at most this often, s
EIGENVALUE_PERIOD_S = 5.0


@dataclass
class _Gap:
    """A gap that was crossed and waits for the velocity at its far end."""

    model: int
    exit: EndState
    entry_s: float


class _OutlierGate:
    """Refuses windows whose residual is far from the recent ones; gives in after several refusals in a row."""

    def __init__(self, gate: float) -> None:
        self._gate = gate
        self._mean_square = np.array([math.inf, math.inf])
        self._refused = 0

    def passes(self, row: Array, increment: Array, weights: Array) -> bool:
        """Whether the window (row (p,), increment (8,)) agrees with the weights (p, 8), where they know anything."""
        residual = increment - row @ weights
        duration = increment[UNIT]
        if abs(residual[UNIT]) > 0.1 * duration:
            return True
        r = np.array([residual[0:3] @ residual[0:3], residual[3:7] @ residual[3:7]]) / duration**2
        if not np.isfinite(self._mean_square).all():
            self._mean_square = r
            return True
        if (r > self._gate**2 * self._mean_square + 1e-6).any() and self._refused < CHANGE_AFTER:
            self._refused += 1
            return False
        self._refused = 0
        self._mean_square += 0.05 * (r - self._mean_square)
        return True


class LearningEstimator:
    """Concurrent-learning estimator and predictor; see the module's head.

    Parameters
    ----------
    settings : gains, stack and remedies
    basis : kernels, shared by all regions' models (the weights are not)
    n_regions : number of operating regions
    rate_hz : sensing rate
    tracking_bounds : (2, 3) lowest and highest position of the tracking space, m; predictions are projected onto it
    name : shown in results
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        basis: RbfBasis,
        n_regions: int,
        rate_hz: float,
        tracking_bounds: Array,
        name: str = "learned",
    ) -> None:
        bounds = np.asarray(tracking_bounds, dtype=float)
        if bounds.shape != (2, 3) or not (bounds[0] < bounds[1]).all():
            raise ConfigError(
                f"tracking_bounds: {bounds.tolist()}, expected (2, 3) with the lower row below the upper"
            )
        if n_regions < 1 or not rate_hz > 0.0:
            raise ConfigError(f"n_regions {n_regions}, rate_hz {rate_hz}: both must be positive")
        self.name = name
        self._settings = settings
        self._basis = basis
        self._dt = 1.0 / rate_hz
        self._low, self._high = bounds[0].copy(), bounds[1].copy()
        self._stacked = settings.form == "stacked"
        self._prior_code = PRIORS[settings.gap.prior]
        self._switch = SWITCHING[settings.switching]
        self._n_regions = n_regions
        count = 1 if settings.share else n_regions
        self._models = [MotionModel(settings, basis.size, self._dt) for _ in range(count)]
        self._settled_s = [0.0] * count
        self._radii = [ErrorRadius() for _ in range(count)]
        self._gates = [_OutlierGate(settings.stack.outlier_gate) for _ in range(count)]
        self._windows = WindowCollector(
            basis.size, settings.stack.window_s, self._dt, settings.stack.average, self._stacked
        )
        self._history = PoseHistory(settings.regression_samples)
        self._eigenvalues: list[tuple[float, float, float]] = [(-math.inf, 0.0, 0.0)] * count
        self._region = -1
        self._model = 0
        self._seen = False
        self._t = -math.inf
        self._last_seen = -math.inf
        self._p = np.full(3, np.nan)
        self._q = np.array([1.0, 0.0, 0.0, 0.0])
        self._prior = np.zeros(6)
        self._twist = np.zeros(6)
        self._sigma = np.zeros(basis.size)
        self._owed = 0.0
        self._exit: EndState | None = None
        self._gap: _Gap | None = None
        self.gaps_learned = 0

    # --- results -------------------------------------------------------------------------------------------------

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        return TargetEstimate(
            t_s=self._t,
            p_world=self._p.copy(),
            q_world=self._q.copy(),
            v_world=self._twist[0:3].copy(),
            w_body=self._twist[3:6].copy(),
            seen=self._seen,
            last_seen_s=self._last_seen,
            region=self._region,
            radius_m=self._radius_at(self._t),
        )

    def _radius_at(self, t_s: float) -> float:
        if self._region < 0:
            return math.inf
        radius = self._radii[self._model]
        unseen = max(0.0, t_s - self._last_seen)
        return radius.base() + radius.growth(float(np.linalg.norm(self._twist[0:3]))) * unseen

    def model(self, region: int) -> MotionModel:
        """What was learned in ``region``."""
        return self._models[self._model_of(region)]

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        if not (horizon_s > 0.0 and dt_s > 0.0):
            raise ConfigError(f"rollout: horizon_s {horizon_s}, dt_s {dt_s}: both must be positive")
        count = max(1, round(horizon_s / dt_s))
        t = self._t + dt_s * np.arange(1, count + 1)
        if self._region < 0:
            return Rollout(
                t, np.full((count, 3), np.nan), np.tile(self._q, (count, 1)), np.full(count, np.inf)
            )
        gap = self._settings.gap
        p, q = roll_out(
            self._p,
            self._q,
            self._prior,
            dt_s,
            count,
            max(1, math.ceil(dt_s / (4.0 * MAX_STEP_S))),
            self._prior_code,
            gap.turn_memory_s,
            gap.handover_s,
            self._stacked,
            self._models[self._model].weights,
            self._basis.centres,
            self._basis.precision,
            self._basis.heading_scale_m,
            self._low,
            self._high,
        )
        start = self._radius_at(self._t)
        growth = self._radii[self._model].growth(float(np.linalg.norm(self._twist[0:3])))
        return Rollout(t, p, q, start + growth * (t - self._t))

    def diagnostics(self) -> dict[str, float]:
        """Per model: stack size, smallest eigenvalues, excitation and its time, weight norm; counts of gaps learned."""
        out = {"gaps_learned": float(self.gaps_learned)}
        for j, model in enumerate(self._models):
            when, smallest, visited = self._eigenvalues[j]
            stack = model.integral if self._settings.alpha > 0.0 else model.instantaneous
            if self._t - when >= EIGENVALUE_PERIOD_S:
                smallest, visited = stack.lambda_min(), stack.lambda_min_visited()
                self._eigenvalues[j] = (self._t, smallest, visited)
            excited = model.excited_s()
            out[f"stack_size_{j}"] = float(model.integral.count + model.instantaneous.count)
            out[f"lambda_min_{j}"] = smallest
            out[f"lambda_min_visited_{j}"] = visited
            out[f"excited_{j}"] = float(math.isfinite(excited))
            out[f"excited_s_{j}"] = excited
            out[f"weight_norm_{j}"] = float(np.linalg.norm(model.weights[:, :UNIT]))
        return out

    # --- advancing -----------------------------------------------------------------------------------------------

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``.

        A measurement older than the state is moved to the state's time along the present velocity.

        Raises
        ------
        ConfigError, DataError
            If the region does not exist or the measurement is not finite.
        """
        p, q = measured_world_pose(measurement)
        t = measurement.t_s
        if self._region >= 0 and t < self._t:
            late = self._t - t
            p, q, t = p + late * self._twist[0:3], q, self._t
        model = self._model_of(region)
        if self._region < 0:
            self._start(t, p, q)
        elif t - self._last_seen > LOST_PERIODS * self._dt or model != self._model:
            self._resight(t, p, q, model)
        else:
            self._correct_seen(t, p, q)
        self._region, self._model, self._seen, self._last_seen, self._t = region, model, True, t, t
        self._learn(t, p, align_sign(q, self._q))

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        if self._region < 0 or t_s <= self._t:
            return
        if self._seen and t_s - self._last_seen > LOST_PERIODS * self._dt:
            self._lose()
        self._advance(t_s)

    def _model_of(self, region: int) -> int:
        if not 0 <= region < self._n_regions:
            raise ConfigError(f"region {region}: expected 0 ... {self._n_regions - 1}")
        return 0 if self._settings.share else region

    def _start(self, t: float, p: Array, q: Array) -> None:
        """First measurement of all."""
        self._p, self._q, self._t = p, q, t
        self._restart_learning()

    def _restart_learning(self) -> None:
        self._windows.clear()
        self._history.clear()
        self._owed = 0.0

    def _lose(self) -> None:
        """The target has just become unseen: remember how it left."""
        self._seen = False
        self._exit = self._history.fit(self._last_seen)
        self._gap = None
        self._restart_learning()

    def _resight(self, t: float, p: Array, q: Array, model: int) -> None:
        """The target is back, or in another region."""
        if self._seen and t - self._last_seen > LOST_PERIODS * self._dt:
            self._lose()
        elif self._seen:
            self._exit = None  # handed over without a gap: nothing to bridge
        self._advance(t)
        self._radii[self._model].crossed(float(np.linalg.norm(p - self._p)), t - self._last_seen)
        if self._settings.gap.learn_across and self._exit is not None:
            self._gap = _Gap(self._model, self._exit, t)
        if model != self._model:
            self._settled_s[self._model] = self._last_seen
            self._models[model].settle(t - self._settled_s[model])
        self._restart_learning()
        if self._settings.reset_on_sighting:
            self._p, self._q = p, align_sign(q, self._q)
        else:
            self._feed_back(p, q, self._dt)

    def _advance(self, t: float) -> None:
        """Motion without feedback up to ``t``, and the weights on their stack alone."""
        duration = t - self._t
        if duration <= 0.0:
            return
        gap = self._settings.gap
        model = self._models[self._model]
        self._p, self._q, _ = advance(
            self._p,
            self._q,
            self._prior,
            duration,
            math.ceil(duration / MAX_STEP_S),
            self._prior_code,
            gap.turn_memory_s,
            gap.handover_s,
            self._stacked,
            model.weights,
            self._basis.centres,
            self._basis.precision,
            self._basis.heading_scale_m,
            self._low,
            self._high,
            self._twist,
        )
        self._t = t
        for _ in range(self._due_steps(duration)):
            model.step()

    def _due_steps(self, duration: float) -> int:
        """Number of nominal weight steps that have fallen due."""
        self._owed += duration
        steps = int(self._owed / self._dt + 0.5)
        self._owed -= steps * self._dt
        return steps

    def _correct_seen(self, t: float, p: Array, q: Array) -> None:
        """(7), (3-8), (4-16) in view: the model's rates at the measured pose, then the feedback."""
        duration = t - self._t
        model = self._models[self._model]
        q = align_sign(q, self._q)
        model_twist(
            p,
            q,
            self._prior,
            self._prior_code > 0,
            self._stacked,
            model.weights,
            self._basis.centres,
            self._basis.precision,
            self._basis.heading_scale_m,
            self._twist,
        )
        self._p = self._p + duration * self._twist[0:3]
        rate = np.concatenate(([0.0], 0.5 * self._twist[3:6]))
        self._q = normalise(self._q + duration * multiply(self._q, rate))
        error = self._feed_back(p, q, duration)
        self._radii[self._model].seen(float(np.linalg.norm(error[0:3])))
        evaluate(p, q, self._basis.centres, self._basis.precision, self._basis.heading_scale_m, self._sigma)
        for i in range(self._due_steps(duration)):
            if i == 0:
                model.step(self._sigma, output_error(error, q, self._stacked))
            else:
                model.step()

    def _feed_back(self, p: Array, q: Array, duration: float) -> Array:
        s = self._settings
        self._p, self._q, error = correct_pose(
            self._p, self._q, p, q, s.k1_per_s, s.k2, self._switch, s.boundary_layer, duration
        )
        return error

    # --- learning ------------------------------------------------------------------------------------------------

    def _learn(self, t: float, p: Array, q: Array) -> None:
        """Put a measured pose into the histories; learn what has become complete."""
        evaluate(p, q, self._basis.centres, self._basis.precision, self._basis.heading_scale_m, self._sigma)
        self._history.push(t, p, q)
        now = self._history.fit(t)
        if now is not None and self._history.count >= self._settings.regression_samples // 3:
            self._prior[0:3], self._prior[3:6] = now.v, now.w
        window = self._windows.push(t, p, q, self._sigma)
        if window is not None:
            model = self._models[self._model]
            if self._gates[self._model].passes(*window, model.weights):
                model.learn_window(t, *window)
            if self._settings.alpha < 1.0:
                self._learn_rate(t)
        if self._gap is not None and t - self._gap.entry_s >= self._settings.gap.entry_s:
            self._learn_gap(t, self._gap)
            self._gap = None

    def _learn_rate(self, t: float) -> None:
        """A regressed rate at the middle of the history, (3-13), (4-20)."""
        state = self._history.fit(self._history.middle_s)
        if state is None:
            return
        rate = np.zeros(COLUMNS)
        rate[0:3], rate[UNIT] = state.v, 1.0
        if self._stacked:
            rate[3:7] = 0.5 * multiply(align_sign(state.q, self._q), np.concatenate(([0.0], state.w)))
        else:
            rate[3:TWIST_OUTPUTS] = state.w
        self._models[self._model].learn_rate(t, self._basis(state.p, state.q), rate)

    def _learn_gap(self, t: float, gap: _Gap) -> None:
        """Reconstruct the path across the gap and put its windows into the stack of the region of exit."""
        entry = self._history.fit(gap.entry_s)
        if entry is None:
            return
        windows = gap_windows(
            gap.exit, entry, self._basis, self._settings.stack.window_s, self._stacked, self._settings.gap
        )
        model = self._models[gap.model]
        for row, increment, weight in windows:
            model.learn_window(t, row, increment, weight)
        self.gaps_learned += bool(windows)

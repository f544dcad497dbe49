"""The learning estimator and predictor of one target over several operating regions (harris2020 ch. 3, 4; parikh2018).

Every region j has its own weights W_j and history stack: they are kept while the target is elsewhere and go on when it
returns. When the target leaves O_j the predictor runs on with W_j, and the path across the gap, once the target has
been found again, is learned into stack j: the next time the target leaves O_j, the gap is known. Estimators of several
targets may hold the same memories (``shared_memories``): what one of them shows, all know.

The state is held in the world frame by default: then f = 0 and a camera's own velocity, with its noise, enters nowhere;
the velocities to be learned are functions of the world pose; nothing jumps when another camera takes over. The relative
form (``frame: relative``) feeds back in camera-relative coordinates with f from the camera's motion. While the target
is unseen the two are the same predictor, since the relative pose follows from the world pose and the known camera pose.

Departures from the printed laws: a new sighting restarts the pose at the measurement (``reset_on_sighting``: the pose
is measured, and the transient of a large error would be learned as velocity through ``Gamma sigma eta_til^T``); the
prior mean of the gap remedies is blended in also while the target is seen, since W_hat is empty there too on the first
visit; the laws of regions that are not in force run on in one go at the next visit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis, evaluate
from camnet.estimation.concurrent_learning import SWITCHING, MotionModel
from camnet.estimation.feedback import relative_feedback
from camnet.estimation.gap import EndState
from camnet.estimation.learner import Learner, RegionMemory
from camnet.estimation.measured_step import measured_step
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.own_pose.spread import own_spread
from camnet.estimation.pace import scaled
from camnet.estimation.propagate import COLUMNS, PRIORS, TWIST_OUTPUTS, UNIT, advance, model_twist, roll_out
from camnet.estimation.protocol import Rollout
from camnet.estimation.road_prior import map_of, offset_of
from camnet.estimation.settings import EstimatorSettings, checked_bounds
from camnet.geometry.rotations_compiled import align_sign
from camnet.geometry.settings import Road
from camnet.types import Array, CameraMotion, PoseMeasurement, TargetEstimate

__all__ = ["LearningEstimator", "shared_memories"]

#: longest step of the predictor's integration, s; a rollout may take four times as long ones
MAX_STEP_S = 0.05


def shared_memories(
    settings: EstimatorSettings, basis: RbfBasis, n_regions: int, rate_hz: float
) -> list[RegionMemory]:
    """Fresh memories of all regions, to be given to the estimators of several targets.

    Targets must then be advanced in a fixed order: at one instant the first one's windows are offered first.
    """
    count = 1 if settings.share else n_regions
    return [RegionMemory(settings, basis.size, 1.0 / rate_hz) for _ in range(count)]


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
    memories : of all regions, shared with other targets' estimators; None: private ones
    roads : for ``gap.prior: road``, which is ``constant_turn`` without any
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        basis: RbfBasis,
        n_regions: int,
        rate_hz: float,
        tracking_bounds: Array,
        name: str = "learned",
        memories: Sequence[RegionMemory] | None = None,
        roads: Sequence[Road] = (),
    ) -> None:
        bounds = checked_bounds(tracking_bounds, n_regions, rate_hz)
        if settings.frame == "relative" and settings.form == "stacked":
            raise ConfigError(
                "estimator.frame 'relative' with form 'stacked': with a turning camera the rates of the relative "
                "quaternion are no function of the target's place; use form 'twist'"
            )
        self.name = name
        self._settings = settings
        self._basis = basis
        self._dt = 1.0 / rate_hz
        self._low, self._high = bounds[0].copy(), bounds[1].copy()
        self._stacked = settings.form == "stacked"
        self._roads = map_of(settings.gap.prior, roads)
        self._prior_code = PRIORS[settings.gap.prior]
        self._relative = settings.frame == "relative"
        self._switch = SWITCHING[settings.switching]
        self._n_regions = n_regions
        private = shared_memories(settings, basis, n_regions, rate_hz) if memories is None else memories
        self._memories = _checked(private, 1 if settings.share else n_regions, basis.size)
        self._memory = self._memories[0]
        self._learner = Learner(settings, basis, self._dt)
        self._region = -1
        self._seen = False
        self._t = -math.inf
        self._last_seen = -math.inf
        self._p = np.full(3, np.nan)
        self._q = np.array([1.0, 0.0, 0.0, 0.0])
        self._prior = np.zeros(6)
        self._twist = np.zeros(6)
        self._sigma = np.zeros(basis.size)
        self._error = np.zeros(COLUMNS)
        self._estimate: TargetEstimate | None = None
        self._exit: EndState | None = None
        self._offset = 0.0
        self._camera: tuple[int, CameraMotion] | None = None
        self._trusted = True

    # --- results -----------------------------------------------------------------------------------------------------

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        if self._estimate is None:
            self._estimate = self._present_estimate()
        return self._estimate

    def _present_estimate(self) -> TargetEstimate:
        return TargetEstimate(
            t_s=self._t,
            p_world=self._p.copy(),
            q_world=self._q.copy(),
            v_world=self._twist[0:3].copy(),
            w_body=self._twist[3:6].copy(),
            seen=self._seen,
            last_seen_s=self._last_seen,
            region=self._region,
            radius_m=self._radius(),
        )

    def _growth(self) -> float:
        return self._memory.radius.growth(math.hypot(*self._twist[0:3].tolist()))

    def _radius(self) -> float:
        if self._region < 0:
            return math.inf
        return self._memory.radius.base() + self._growth() * max(0.0, self._t - self._last_seen)

    def model(self, region: int) -> MotionModel:
        """Return what was learned in ``region``."""
        return self._memory_of(region).model

    def excitation(self, region: int) -> tuple[float, float]:
        """See `camnet.estimation.protocol.Learns`."""
        model = self.model(region)
        return min(model.integral.excited_s, model.instantaneous.excited_s), model.visited.since_s

    def weight_norm(self, region: int) -> float:
        """See `camnet.estimation.protocol.Learns`."""
        return float(np.linalg.norm(self.law_weights(region)))

    def law_weights(self, region: int) -> Array:
        """Return the weights (p, outputs) of a region's model that the update law moves: a view, not to be written."""
        model = self.model(region)
        outputs = TWIST_OUTPUTS if model.form == "twist" else UNIT
        return model.weights[:, :outputs]

    def model_number(self, region: int) -> int:
        """Return which model a region has: its own, or the one that all share."""
        return 0 if self._settings.share else region

    def model_diagnostics(self, region: int) -> dict[str, float]:
        """Return the figures of ``diagnostics`` of one region's model."""
        return self._memory_of(region).diagnostics(self._t)

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        if not (horizon_s > 0.0 and dt_s > 0.0):
            raise ConfigError(f"rollout: horizon_s {horizon_s}, dt_s {dt_s}: both must be positive")
        count = max(1, round(horizon_s / dt_s))
        tau = dt_s * np.arange(1, count + 1, dtype=np.float64)
        if self._region < 0:
            return Rollout(
                self._t + tau,
                np.full((count, 3), np.nan),
                np.tile(self._q, (count, 1)),
                np.full(count, np.inf),
            )
        gap, weights = self._settings.gap, self._paced_weights()
        # kernels that no data has reached have no weight, and add nothing anywhere on the path
        reached = np.flatnonzero(weights.any(axis=1))
        centres, precision = self._basis.centres[reached], self._basis.precision[reached]
        for array in (centres, precision):
            array.setflags(write=False)  # as those of the basis: one compiled form for both
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
            weights[reached],
            centres,
            precision,
            self._basis.heading_scale_m,
            self._low,
            self._high,
            self._road_offset(),
            self._roads,
        )
        return Rollout(self._t + tau, p, q, self._radius() + self._growth() * tau)

    def diagnostics(self) -> dict[str, float]:
        """Count of gaps learned, and per model j ``stack_size_j``, ``lambda_min_j``, ``excited_j`` and others.

        ``prior_on_roads`` is 1 where the prior mean follows known roads, 0 where there are none to follow.

        ``lambda_min_visited_j`` is over the kernels that data has reached: a kernel of another region's road keeps
        ``lambda_min_j`` at zero for ever.
        """
        out = {
            "gaps_learned": float(self._learner.gaps_learned),
            "prior_on_roads": float(len(self._roads.segments) > 0),
        }
        for j, memory in enumerate(self._memories):
            out.update({f"{key}_{j}": value for key, value in memory.diagnostics(self._t).items()})
        return out

    # --- advancing ---------------------------------------------------------------------------------------------------

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``.

        A measurement older than the state is moved to the state's time along the present velocity.

        Raises
        ------
        ConfigError, DataError
            If the region does not exist or the measurement is not finite.
        """
        p, q = measured_world_pose(measurement)
        t, camera = measurement.t_s, (measurement.camera, measurement.motion)
        memory = self._memory_of(region)
        self._estimate = None
        trusted = camera[1].cov is None or own_spread(measurement) <= self._settings.learn_within_m
        if self._region >= 0 and t < self._t:
            p, t = p + (self._t - t) * self._twist[0:3], self._t
        if self._region < 0 or t - self._last_seen > LOST_PERIODS * self._dt or memory is not self._memory:
            if self._region < 0:
                self._p, self._q, self._t = p.copy(), q.copy(), t
                memory.take_up(t)
            else:
                self._resight(t, p, q, memory, trusted)
            basis = self._basis
            evaluate(p, q, basis.centres, basis.precision, basis.heading_scale_m, self._sigma)
        else:
            q = align_sign(q, self._q)
            self._correct_seen(t, p, q, camera)
        self._camera, self._memory, self._region = camera, memory, region
        self._seen, self._last_seen, self._t = True, t, t
        if trusted != self._trusted:  # windows hold what was seen from one world alone
            self._learner.interrupt(t, lost=False)
            self._trusted, self._p = trusted, p.copy()
        self._learner.learn(t, p, q, self._sigma, self._memory, self._prior, trusted)

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        if self._region < 0 or t_s <= self._t:
            return
        self._estimate = None
        if self._seen and t_s - self._last_seen > LOST_PERIODS * self._dt:
            self._lose()
        self._advance(t_s)

    def _memory_of(self, region: int) -> RegionMemory:
        if not 0 <= region < self._n_regions:
            raise ConfigError(f"region {region}: expected 0 ... {self._n_regions - 1}")
        return self._memories[0 if self._settings.share else region]

    def _paced_weights(self) -> Array:
        """Weights (p, 8) that predict: those learned, at the pace at which the target left."""
        weights, pace = self._memory.model.weights, self._learner.pace
        factor = 1.0 if pace is None else pace.scale(self._seen)
        return weights if factor == 1.0 else scaled(weights, factor)

    def _lose(self) -> None:
        """Note that the target has become unseen, and how it left."""
        self._exit = self._learner.interrupt(self._last_seen)
        self._offset = self._road_offset()
        self._seen = False

    def _road_offset(self) -> float:
        """How far left of its way on the road the target is, or was when last seen."""
        if not self._seen:
            return self._offset
        p, v = self._p, self._prior
        return float(offset_of(p[0], p[1], v[0], v[1], self._roads))

    def _resight(self, t: float, p: Array, q: Array, memory: RegionMemory, trusted: bool) -> None:
        """Take the target up again, after a gap or handed over without one."""
        if self._seen and t - self._last_seen > LOST_PERIODS * self._dt:
            self._lose()
        without_gap = self._seen
        self._advance(t)
        if without_gap:
            self._learner.interrupt(self._last_seen, lost=False)
        elif trusted and self._trusted:
            miss = p - self._p
            self._memory.radius.crossed(math.sqrt(float(miss @ miss)), t - self._last_seen)
            if self._settings.gap.learn_across and self._exit is not None:
                self._learner.bridge(self._memory, self._exit, t)
        memory.take_up(t)
        if self._settings.reset_on_sighting:
            self._p, self._q = p.copy(), align_sign(q, self._q)

    def _advance(self, t: float) -> None:
        """Motion without feedback up to ``t``, and the weights on their stack alone: (3-15), (3-17), (4-16), (4-18)."""
        duration = t - self._t
        if duration <= 0.0:
            return
        gap = self._settings.gap
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
            self._paced_weights(),
            self._basis.centres,
            self._basis.precision,
            self._basis.heading_scale_m,
            self._low,
            self._high,
            self._twist,
            self._road_offset(),
            self._roads,
        )
        self._t = t
        for _ in range(self._memory.due_steps(t, self._dt)):
            self._memory.model.step()

    def _correct_seen(self, t: float, p: Array, q: Array, camera: tuple[int, CameraMotion]) -> None:
        """In view, (3-8), (3-10), (4-16), (4-18): the model's rates at the measured pose, then the feedback."""
        duration = t - self._t
        model = self._memory.model
        number, before = self._camera if self._camera is not None else camera
        # another camera's former pose is not known: there the world form stands in, which needs none
        if self._relative and number == camera[0] and self._last_seen == self._t:
            residual = self._relative_step(duration, p, q, before, camera[1])
        else:
            residual = self._world_step(duration, p, q)
        self._memory.radius.seen(residual)
        taken = duration > 0.0 and self._memory.advanced_s >= t  # by another target's estimator
        for i in range(self._memory.due_steps(t, self._dt)):
            if i == 0:
                model.step(self._sigma, self._error)
            else:
                model.step()
        if taken:
            model.add_feedback(self._sigma, self._error)

    def _world_step(self, duration: float, p: Array, q: Array) -> float:
        s = self._settings
        return measured_step(
            self._p,
            self._q,
            self._twist,
            self._sigma,
            self._error,
            p,
            q,
            duration,
            self._prior,
            self._prior_code > 0,
            self._stacked,
            self._memory.model.weights,
            self._basis.centres,
            self._basis.precision,
            self._basis.heading_scale_m,
            s.k1_per_s,
            s.k2,
            self._switch,
            s.boundary_layer,
        )

    def _relative_step(
        self, duration: float, p: Array, q: Array, before: CameraMotion, now: CameraMotion
    ) -> float:
        basis = self._basis
        model_twist(
            p,
            q,
            self._prior,
            self._prior_code > 0,
            self._stacked,
            self._memory.model.weights,
            basis.centres,
            basis.precision,
            basis.heading_scale_m,
            self._twist,
        )
        state = relative_feedback(self._p, self._q, self._twist, duration, p, q, before, now, self._settings)
        self._p[:], self._q[:], self._error[:] = state.p, state.q, state.error
        evaluate(p, q, basis.centres, basis.precision, basis.heading_scale_m, self._sigma)
        return state.residual_m


def _checked(memories: Sequence[RegionMemory], count: int, kernels: int) -> list[RegionMemory]:
    """Return the memories if they are as many as models are needed, over as many kernels."""
    sizes = {len(memory.model.weights) for memory in memories}
    if len(memories) != count or sizes != {kernels}:
        raise ConfigError(
            f"memories: {len(memories)} over {sorted(sizes)} kernels, expected {count} over {kernels}"
        )
    return list(memories)

"""The estimator of parikh2018 with the published settings and nothing else: the row to compare ours with.

| symbol | name | value |
| --- | --- | --- |
| k1, k2, kCL, Gamma | gains | 3, 0.1, 1, I |
| Delta t | window | 0.1 s, from successive frames at 60 Hz (overlapping if candidates come fast) |
| sigma | 81 kernels, 9 x 9, 0.3 m apart | covariance 0.3 I2 |
| N | entries of the stack | 600 |
| form | stacked: the seven rates of (p, q) | W is 81 x 7 |
| candidate period | one window is offered to the stack each | 1 s |

In view     (7), (8):  eta_hat' = W_hat^T sigma(rho(eta)) + k1 eta_til + k2 sgn(eta_til),
                       W_hat' = proj(Gamma sigma eta_til^T + kCL Gamma sum_i Y_i^T (Deta_i - Y_i W_hat))
Not in view (14):      eta_hat' = proj(W_hat^T sigma(rho(eta_hat)));  the sum goes on teaching W_hat

The camera stands still, so f = 0 for a state in the world frame. The paper offered about one window a second, because
its selection by the smallest eigenvalue took that long; 600 entries are then never reached in 600 s with the target
visible some 60 % of the time, so the rule had nothing to choose. It is here all the same. Weights are integrated
implicitly, the stiff part of the law being linear; for these gains that differs little from Euler's rule at 60 Hz.

A measured quaternion takes the sign nearest the estimate. On a closed path the robot comes back to the same place with
the other sign after every turn, so rates of q as a function of position average to nothing. The paper does not say how
it chose signs; with ``fixed_sign`` they follow q0 >= 0, one jump a turn instead, and the rates can be learned.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import SWITCHING, MotionModel, correct_pose, output_error
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.placement import grid_centres
from camnet.estimation.propagate import COLUMNS, PRIORS, UNIT, advance, model_twist, roll_out
from camnet.estimation.protocol import Rollout
from camnet.estimation.road_prior import NO_ROADS
from camnet.estimation.settings import EstimatorSettings, GapSettings, StackSettings
from camnet.geometry.rotations_compiled import align_sign, normalise
from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["PUBLISHED_SETTINGS", "PublishedEstimator", "published_basis"]

PUBLISHED_SETTINGS = EstimatorSettings(
    form="stacked",
    k1_per_s=3.0,
    k2=0.1,
    kcl=1.0,
    gamma=1.0,
    alpha=1.0,
    leakage=0.0,
    switching="sign",
    weight_bound=20.0,
    reset_on_sighting=False,
    stack=StackSettings(size=600, window_s=0.1, average=1, rule="lambda_min", outlier_gate=1e9),
    gap=GapSettings(prior="none", learn_across=False),
)
#: one candidate is offered to the stack each, s
CANDIDATE_PERIOD_S = 1.0
_MAX_STEP_S = 0.05


def published_basis() -> RbfBasis:
    """Nine by nine kernels, 0.3 m apart about the origin, covariance 0.3 I2 m^2."""
    corner = np.array([1.2, 1.2])
    return RbfBasis.create(grid_centres(-corner, corner, 0.3), 0.3)


def _half(q: Array) -> Array:
    """Return q (4,) or -q, whichever has q0 >= 0."""
    return -q if q[0] < 0.0 else q


class PublishedEstimator:
    """See the module's head; the interface is that of ``TargetFilter``.

    Parameters
    ----------
    basis : kernels over the ground plane
    rate_hz : frames a second
    tracking_bounds : (2, 3) bounds of the tracking space, m
    fixed_sign : give every quaternion q0 >= 0 instead of the sign that is nearest the estimate
    name : shown in results
    """

    def __init__(
        self,
        basis: RbfBasis,
        rate_hz: float,
        tracking_bounds: Array,
        fixed_sign: bool = False,
        name: str = "learned_published",
    ) -> None:
        self.name = name
        self._fixed_sign = fixed_sign
        self._basis = basis
        self._dt = 1.0 / rate_hz
        self._low, self._high = (np.array(row, dtype=float) for row in tracking_bounds)
        self.model = MotionModel(PUBLISHED_SETTINGS, basis.size, self._dt)
        self._frames = round(PUBLISHED_SETTINGS.stack.window_s * rate_hz)
        self._window: list[tuple[float, Array, Array, Array]] = []
        self._next_candidate_s = -math.inf
        self._t = self._last_seen = -math.inf
        self._p, self._q = np.full(3, np.nan), np.array([1.0, 0.0, 0.0, 0.0])
        self._twist, self._prior = np.zeros(6), np.zeros(6)
        self._seen = False

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        region = 0 if math.isfinite(self._t) else -1
        return TargetEstimate(
            self._t,
            self._p.copy(),
            self._q.copy(),
            self._twist[:3].copy(),
            self._twist[3:].copy(),
            self._seen,
            self._last_seen,
            region,
            math.inf,
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``."""
        p, q = measured_world_pose(measurement)
        t = measurement.t_s
        if not math.isfinite(self._t):
            self._p, self._q, self._t = p, q, t
        if self._fixed_sign:
            q = _half(q)
            self._q = align_sign(self._q, q)
        else:
            q = align_sign(q, self._q)
        sigma = self._basis(p, q)
        if t - self._last_seen > LOST_PERIODS * self._dt:
            self._window.clear()
        self._observe(t, p, q, sigma)
        self._collect(t, p, q, sigma)
        self._t = self._last_seen = t
        self._seen = True

    def _observe(self, t: float, p: Array, q: Array, sigma: Array) -> None:
        """(7) and (8) over one frame, the model's rates at the measured pose."""
        dt, s = t - self._t, PUBLISHED_SETTINGS
        if dt <= 0.0:
            return
        rates = sigma @ self.model.weights
        p_next, q_next = self._p + dt * rates[0:3], normalise(self._q + dt * rates[3:7])
        code = SWITCHING[s.switching]
        self._p, self._q, error = correct_pose(
            p_next, q_next, p, q, s.k1_per_s, s.k2, code, s.boundary_layer, dt
        )
        self.model.step(sigma, output_error(error, q, True))
        self._rates(p, q)

    def _rates(self, p: Array, q: Array) -> None:
        b = self._basis
        model_twist(
            p,
            q,
            self._prior,
            False,
            True,
            self.model.weights,
            b.centres,
            b.precision,
            b.heading_scale_m,
            self._twist,
        )

    def _collect(self, t: float, p: Array, q: Array, sigma: Array) -> None:
        """Keep the last window; offer it when a candidate is due."""
        if self._window and float(q @ self._window[-1][2]) < 0.0:
            self._window.clear()  # the sign has jumped: no increment across it
        self._window.append((t, p, q, sigma))
        del self._window[: -(self._frames + 1)]
        if len(self._window) <= self._frames or t < self._next_candidate_s:
            return
        self._next_candidate_s = t + CANDIDATE_PERIOD_S - 0.5 * self._dt
        times = np.array([w[0] for w in self._window])
        row = np.trapezoid(np.array([w[3] for w in self._window]), times, axis=0)
        increment = np.zeros(COLUMNS)
        increment[0:3] = p - self._window[0][1]
        increment[3:7] = q - self._window[0][2]
        increment[UNIT] = times[-1] - times[0]
        self.model.learn_window(t, row, increment)

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``: (14), and the weights on their stack alone."""
        if not math.isfinite(self._t) or t_s <= self._t:
            return
        self._seen = t_s - self._last_seen <= LOST_PERIODS * self._dt
        duration, b = t_s - self._t, self._basis
        self._p, self._q, _ = advance(
            self._p, self._q, self._prior, duration, math.ceil(duration / _MAX_STEP_S), PRIORS["none"], 1.0, 1.0,
            True, self.model.weights, b.centres, b.precision, b.heading_scale_m, self._low, self._high, self._twist,
            0.0, NO_ROADS,
        )  # fmt: skip
        if self._fixed_sign:
            self._q = _half(self._q)
        self._t = t_s
        for _ in range(max(1, round(duration / self._dt))):
            self.model.step()

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        count, b = max(1, round(horizon_s / dt_s)), self._basis
        p, q = roll_out(
            self._p, self._q, self._prior, dt_s, count, math.ceil(dt_s / _MAX_STEP_S), PRIORS["none"], 1.0, 1.0,
            True, self.model.weights, b.centres, b.precision, b.heading_scale_m, self._low, self._high,
            0.0, NO_ROADS,
        )  # fmt: skip
        return Rollout(self._t + dt_s * np.arange(1.0, count + 1.0), p, q, np.full(count, np.inf))

    def diagnostics(self) -> dict[str, float]:
        """Entries of the stack, its smallest eigenvalue, norm of the weights."""
        return {
            "stack_size": float(self.model.integral.count),
            "lambda_min": self.model.integral.lambda_min(),
            "weight_norm": float(np.linalg.norm(self.model.weights[:, :UNIT])),
        }

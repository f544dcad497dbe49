"""Update laws of the pose and weight estimates (parikh2018 (7), (8); harris2020 (3-8)-(3-17), (4-16)-(4-20)).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| eta_hat = [p; q] | ``p``, ``q`` | (3,), (4,) | m, - |
| W_hat | ``weights``, columns as in ``propagate`` | (p, 8) | m/s, rad/s |
| G(q) = blockdiag(I3, 1/2 B(q)) | twist form only | (7, 6) | - |
| Gamma = gamma I | ``gamma`` | - | - |
| kCL, alpha | ``kcl``, ``alpha`` | - | - |
| Psi = alpha sum Y_i^T Y_i + (1 - alpha) sum Y_k^T Y_k | ``psi`` | (p, p) | s^2 |
| Q | ``moment``: the same sums of Y^T times increments | (p, 8) | m s, rad s |

In view:      eta_hat' = G W_hat^T sigma + f + k1 eta_til + k2 sgn(eta_til)
              W_hat'   = proj( Gamma sigma (G^T eta_til)^T + kCL Gamma (Q - Psi W_hat) )
Not in view:  W_hat'   = proj( kCL Gamma (Q - Psi W_hat) )

The stacked form of the papers is G = I7. In twist form the error enters the weights through G^T, which is what cancels
``eta_til^T G W_til^T sigma`` in the derivative of V = 1/2 eta_til^T eta_til + 1/2 tr(W_til^T Gamma^-1 W_til).

Departures. The weight law is linear and stiff (rates kCL gamma lambda(Psi)), so it is integrated implicitly:
``(I + dt kCL gamma (Psi + delta I)) W+ = W + dt gamma (sigma (G^T eta_til)^T + kCL Q)``, with the inverse kept and
changed by rank-one updates as windows enter and leave. ``delta`` (``leakage``) is zero in the printed law; without it
directions in which the stack holds almost nothing drift to whatever the noise asks for.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.excitation import VisitedExcitation
from camnet.estimation.projection import project_step
from camnet.estimation.propagate import COLUMNS
from camnet.estimation.selection import DOptimalRule, SelectionRule, SmallestEigenvalueRule, rank_one
from camnet.estimation.selection_secular import SecularEigenvalueRule
from camnet.estimation.settings import EstimatorSettings, StackSettings
from camnet.estimation.stack import Change, HistoryStack
from camnet.estimation.weight_step import weight_step
from camnet.geometry.rotations_compiled import align_sign, normalise
from camnet.types import Array, IntArray

__all__ = ["SWITCHING", "MotionModel", "correct_pose", "implicit_step", "make_rule", "switching"]

#: codes of the switching functions, chosen once at construction
SWITCHING = {"sign": 0, "sat": 1, "tanh": 2}
#: rank-one changes after which the inverse of the implicit step is computed afresh
REFRESH_EVERY = 500
#: cosine between two regressors from which on they are of the same place
ALIKE = 0.5
#: activation below which a kernel has never been reached, s^2
TINY = 1e-12
#: width of the projection's boundary layer as a share of the weight bound
LAYER_SHARE = 0.05


@cached_njit
def switching(x: float, code: int, layer: float) -> float:
    """Sgn(x), or one of its continuous stand-ins with boundary layer ``layer``."""
    if code == 0:
        return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    if code == 1:
        return min(1.0, max(-1.0, x / layer))
    return math.tanh(x / layer)


@cached_njit
def correct_pose(
    p: Array,
    q: Array,
    p_measured: Array,
    q_measured: Array,
    k1: float,
    k2: float,
    code: int,
    layer: float,
    dt: float,
) -> tuple[Array, Array, Array]:
    """Feedback part of (7), (3-8), (4-16) over ``dt``, after the motion part: pose (3,), (4,) and error (7,).

    The linear part is integrated exactly. The measured quaternion is given the sign of the estimate first.
    """
    share = -math.expm1(-k1 * dt)
    q_aligned = align_sign(q_measured, q)
    error = np.empty(7)
    p_next, q_next = np.empty(3), np.empty(4)
    for i in range(3):
        error[i] = p_measured[i] - p[i]
        p_next[i] = p[i] + share * error[i] + dt * k2 * switching(error[i], code, layer)
    for i in range(4):
        error[3 + i] = q_aligned[i] - q[i]
        q_next[i] = q[i] + share * error[3 + i] + dt * k2 * switching(error[3 + i], code, layer)
    return p_next, normalise(q_next), error


@cached_njit
def output_error(error: Array, q: Array, stacked: bool) -> Array:
    """G(q)^T eta_til (8,), padded with zeros: the pose error as seen by the model's outputs."""
    out = np.zeros(COLUMNS)
    if stacked:
        for i in range(7):
            out[i] = error[i]
        return out
    for i in range(3):
        out[i] = error[i]
    a, b, c, d = 0.5 * error[3], 0.5 * error[4], 0.5 * error[5], 0.5 * error[6]
    out[3] = -q[1] * a + q[0] * b + q[3] * c - q[2] * d
    out[4] = -q[2] * a - q[3] * b + q[0] * c + q[1] * d
    out[5] = -q[3] * a + q[2] * b - q[1] * c + q[0] * d
    return out


@cached_njit
def implicit_step(
    weights: Array,
    inverse: Array,
    touched: IntArray,
    moment: Array,
    sigma: Array,
    error: Array,
    dt: float,
    gamma: float,
    kcl: float,
    outputs: int,
    bound: float,
    layer: float,
) -> Array:
    """Weights (p, 8) after ``dt``; ``inverse`` is (I + dt kCL gamma (Psi + delta I))^-1, ``error`` (8,) G^T eta_til.

    ``touched`` lists the kernels that occur in Psi; for the others the inverse is diagonal, and only they are done
    singly. With private models most kernels belong to other regions.
    """
    p = weights.shape[0]
    n = len(touched)
    right = np.empty((p, COLUMNS))
    after = np.empty((p, COLUMNS))
    for k in range(p):
        for o in range(COLUMNS):
            right[k, o] = weights[k, o] + dt * gamma * (sigma[k] * error[o] + kcl * moment[k, o])
            after[k, o] = inverse[k, k] * right[k, o]
    for a in range(n):
        i = touched[a]
        row = np.zeros(COLUMNS)
        for b in range(n):
            k = touched[b]
            m = inverse[i, k]
            for o in range(COLUMNS):
                row[o] += m * right[k, o]
        for o in range(COLUMNS):
            after[i, o] = row[o]
    project_step(weights, after, outputs, bound, layer)
    return after


def make_rule(settings: StackSettings, kernels: int) -> SelectionRule:
    """Return the selection rule that the settings name."""
    if settings.rule == "lambda_min":
        return SecularEigenvalueRule(settings.size, kernels, settings.regularisation)
    if settings.rule == "lambda_min_naive":
        return SmallestEigenvalueRule()
    return DOptimalRule(settings.size, kernels, settings.regularisation)


class MotionModel:
    """Weights and history stacks of one region: everything learned there.

    ``integral`` holds the windows of integral concurrent learning, ``instantaneous`` the measured rates of plain
    concurrent learning (filled only for alpha < 1). Between ``step`` calls ``weights`` (p, 8) is constant.
    """

    def __init__(self, settings: EstimatorSettings, kernels: int, dt_s: float) -> None:
        stack = settings.stack
        self._settings = settings
        self._dt = dt_s
        self._outputs = 6 if settings.form == "twist" else 7
        self.weights = np.zeros((kernels, COLUMNS))
        self.integral = HistoryStack(
            stack.size, kernels, COLUMNS, make_rule(stack, kernels), stack.excitation_threshold
        )
        # one entry even when unused: its share of Psi is then zero
        size = stack.size if settings.alpha < 1.0 else 1
        rule = make_rule(stack.model_copy(update={"size": size}), kernels)
        self.instantaneous = HistoryStack(size, kernels, COLUMNS, rule, stack.excitation_threshold)
        # over the touched kernels alone, in the order in which they were touched; diagonal for the others
        self._inverse = np.zeros((0, 0))
        self._order: IntArray = np.zeros(0, dtype=np.int64)
        self._touched = np.zeros(kernels, dtype=bool)
        self._fade = 1.0 / (1.0 + self._rate(dt_s) * settings.leakage)
        self._moment = np.zeros((kernels, COLUMNS))
        self._none = np.zeros(kernels)
        self._no_error = np.zeros(COLUMNS)
        self._changes = 0
        self.visited = VisitedExcitation(stack.excitation_threshold, stack.excitation_share)

    def _rate(self, dt_s: float) -> float:
        return dt_s * self._settings.kcl * self._settings.gamma

    @property
    def form(self) -> str:
        """``twist`` or ``stacked``: what the outputs are."""
        return self._settings.form

    def can_hold(self, weights: Array) -> bool:
        """Whether the projection can have left such weights (p, 8): inside the ball and its boundary layer."""
        rim = (1.0 + LAYER_SHARE) * self._settings.weight_bound
        return float(np.linalg.norm(weights[:, : self._outputs])) <= rim * (1.0 + 1e-9)

    @property
    def psi(self) -> Array:
        """Composite history stack Psi (p, p), (3-14), (4-21)."""
        a = self._settings.alpha
        return a * self.integral.gram + (1.0 - a) * self.instantaneous.gram

    def learn_window(self, t_s: float, row: Array, increment: Array, weight: float = 1.0) -> bool:
        """Offer an integral window; True if it entered the stack.

        A window of full weight was measured, and says whether places like it are excited already.
        """
        if self._settings.alpha > 0.0 and weight == 1.0:
            self._observe(t_s, row)
        return self._enter(self.integral.offer(t_s, row, increment, weight), self._settings.alpha)

    def learn_rate(self, t_s: float, row: Array, rate: Array, weight: float = 1.0) -> bool:
        """Offer a measured rate (3-13), (4-20); True if it entered the stack."""
        if self._settings.alpha == 0.0 and weight == 1.0:
            self._observe(t_s, row)
        return self._enter(self.instantaneous.offer(t_s, row, rate, weight), 1.0 - self._settings.alpha)

    def _observe(self, t_s: float, row: Array) -> None:
        if len(self._order):
            a, known, pick = self._settings.alpha, row[self._order], np.ix_(self._order, self._order)
            psi = a * self.integral.gram[pick] + (1.0 - a) * self.instantaneous.gram[pick]
            self.visited.observe(t_s, psi, known, float(row @ row - known @ known))

    def _enter(self, change: Change, share: float) -> bool:
        a = self._settings.alpha
        if not change or share == 0.0:
            return bool(change)
        self._moment = a * self.integral.moment + (1.0 - a) * self.instantaneous.moment
        self._touch(change[0][0])
        root = math.sqrt(self._rate(self._dt) * share)
        for row, sign in change:
            rank_one(self._inverse, root * row[self._order], sign)
            self._changes += 1
        if self._changes >= REFRESH_EVERY:
            self._changes = 0
            self._inverse = self._exact_inverse(self._dt)
        return True

    def forget(self, row: Array, before_s: float) -> int:
        """Drop the windows of places like ``row`` (p,) offered before ``before_s``; returns how many.

        Weights of kernels that lose data fade in proportion, so that the support there falls with it.
        """
        dropped, present = 0, self.psi.diagonal().copy()
        for stack in (self.integral, self.instantaneous):
            length = np.linalg.norm(stack.rows, axis=1) * np.linalg.norm(row)
            alike = (stack.rows @ row > ALIKE * length) & (stack.entered_s < before_s)
            if alike.any():
                stack.forget(alike)
                dropped += int(alike.sum())
        if dropped:
            a = self._settings.alpha
            self._moment = a * self.integral.moment + (1.0 - a) * self.instantaneous.moment
            self._inverse = self._exact_inverse(self._dt)
            left = self.psi.diagonal() / np.maximum(present, TINY)
            self.weights = self.weights * np.where(present > TINY, np.minimum(left, 1.0), 1.0)[:, None]
            self._changes = 0
            self.visited.clear()
        return dropped

    def _touch(self, row: Array) -> None:
        """Give every kernel that occurs in ``row`` for the first time its own row of the inverse."""
        new = np.flatnonzero((row != 0.0) & ~self._touched)
        if len(new) == 0:
            return
        n, m = len(self._order), len(new)
        inverse = self._fade * np.eye(n + m)
        inverse[:n, :n] = self._inverse
        self._inverse, self._order = inverse, np.concatenate((self._order, new))
        self._touched[new] = True

    def _exact_inverse(self, dt_s: float) -> Array:
        eye, pick = np.eye(len(self._order)), np.ix_(self._order, self._order)
        matrix = eye + self._rate(dt_s) * (self.psi[pick] + self._settings.leakage * eye)
        inverse = np.linalg.inv(matrix)
        return np.asarray(0.5 * (inverse + inverse.T), dtype=np.float64)

    def step(self, sigma: Array | None = None, error: Array | None = None) -> None:
        """Advance the weights by one nominal step, with (sigma (p,), G^T eta_til (8,)) or without feedback."""
        self.weights = self._stepped(
            self._inverse,
            self._fade,
            self._dt,
            self._none if sigma is None else sigma,
            self._no_error if error is None else error,
        )

    def add_feedback(self, sigma: Array, error: Array) -> None:
        """Add the feedback (sigma (p,), G^T eta_til (8,)) of one more target to the step that was taken last.

        The implicit step is linear, so this gives what one step with the sum of all feedbacks gives (up to the
        projection, which then acts twice).
        """
        s = self._settings
        share = self._dt * s.gamma * np.outer(sigma, error)
        touched = self._inverse @ share[self._order]
        after = self.weights + self._fade * share
        after[self._order] = self.weights[self._order] + touched
        project_step(self.weights, after, self._outputs, s.weight_bound, LAYER_SHARE * s.weight_bound)
        self.weights = after

    def _stepped(self, inverse: Array, fade: float, dt_s: float, sigma: Array, error: Array) -> Array:
        s = self._settings
        return weight_step(
            self.weights,
            inverse,
            self._order,
            fade,
            self._moment,
            sigma,
            error,
            dt_s * s.gamma,
            s.kcl,
            self._outputs,
            s.weight_bound,
            LAYER_SHARE * s.weight_bound,
        )

    def settle(self, duration_s: float, steps: int = 6) -> None:
        """Advance the weights by ``duration_s`` on the stack alone, in a few long implicit steps.

        The law runs on while a region is not in force; doing it when the region is needed again costs one inverse.
        """
        if self.integral.count + self.instantaneous.count == 0 or duration_s <= 0.0:
            return
        dt = duration_s / steps
        inverse = self._exact_inverse(dt)
        fade = 1.0 / (1.0 + self._rate(dt) * self._settings.leakage)
        for _ in range(steps):
            self.weights = self._stepped(inverse, fade, dt, self._none, self._no_error)

    def excited_s(self) -> float:
        """Time T since which finite excitation (3-19) holds, s (inf while it does not).

        Over all kernels, or over the places visited: see ``excitation`` for what the latter supports.
        """
        return min(self.integral.excited_s, self.instantaneous.excited_s, self.visited.since_s)

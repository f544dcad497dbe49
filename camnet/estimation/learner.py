"""What the learning estimator remembers of each region, and how measured poses become entries of the stacks.

Every region has a ``RegionMemory``: its motion model, error radius and outlier gate, private to one target or shared by
several. For each target one ``Learner`` turns its stream of measured poses into integral windows (3-11), regressed
rates (3-13) and, after a re-sighting, windows of the path across the gap, and offers them to the memory in force (the
gap's windows to the memory of the region that was left).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.gap import EndState, PoseHistory, gap_windows
from camnet.estimation.pace import Pace
from camnet.estimation.propagate import COLUMNS, TWIST_OUTPUTS, UNIT
from camnet.estimation.radius import ErrorRadius
from camnet.estimation.settings import EstimatorSettings
from camnet.estimation.windows import WindowCollector
from camnet.geometry.rotations_compiled import align_sign, multiply
from camnet.types import Array

__all__ = ["Learner", "OutlierGate", "RegionMemory"]

#: windows refused in a row as outliers before the target is believed to have changed its ways
CHANGE_AFTER = 5
#: the same for windows that are merely suspect
SUSPECT_AFTER = 10
#: at most this many times the mean square counts of a suspect window's square
SUSPECT_COUNTS = 2.0
#: share of a new residual in the running mean square
RESIDUAL_SHARE = 0.05
#: residuals of windows below this are never far, (m/s)^2 and (rad/s)^2
RESIDUAL_FLOOR = 1e-6
#: the gate judges a window only where the model answers for the motion to within this
KNOWN_WITHIN = 0.1
#: eigenvalues for the diagnostics are computed at most this often, s
EIGENVALUE_PERIOD_S = 5.0


class OutlierGate:
    """Refuses windows far from what the model says, and notes when the target has changed its ways.

    A window is far beyond ``gate`` times the recent root mean square residual, and suspect from half of that on. Far
    windows are refused; when ``CHANGE_AFTER`` far or ``SUSPECT_AFTER`` suspect ones come in a row, the target has
    changed. ``changed_s`` is when that run began (inf while nothing has changed); it stays, and everything passes,
    until ``CHANGE_AFTER`` windows in a row agree with the model again. ``changes`` counts the runs.
    """

    def __init__(self, gate: float) -> None:
        self._gate = gate
        self._mean_square = np.array([math.inf, math.inf])
        self._far_run, self._suspect_run, self._agreed = 0, 0, 0
        self._run_began_s = math.inf
        self.changed_s = math.inf
        self.refused = 0
        self.changes = 0

    def passes(self, row: Array, increment: Array, weights: Array, t_s: float = 0.0) -> bool:
        """Whether the window (row (p,), increment (8,)) may enter beside the weights (p, 8)."""
        residual = increment - row @ weights
        duration = increment[UNIT]
        if abs(residual[UNIT]) > KNOWN_WITHIN * duration:
            return True
        r = np.array([residual[0:3] @ residual[0:3], residual[3:7] @ residual[3:7]]) / duration**2
        if not np.isfinite(self._mean_square).all():
            self._mean_square = r
            return True
        far = bool((r > self._gate**2 * self._mean_square + RESIDUAL_FLOOR).any())
        suspect = far or bool((r > (0.5 * self._gate) ** 2 * self._mean_square + RESIDUAL_FLOOR).any())
        if not far:
            # a suspect window counts little, so that a slow change is not taken for noise
            share = np.minimum(r, SUSPECT_COUNTS * self._mean_square) if suspect else r
            self._mean_square += RESIDUAL_SHARE * (share - self._mean_square)
        return self._judge(far, suspect, t_s)

    def _judge(self, far: bool, suspect: bool, t_s: float) -> bool:
        if suspect and self._suspect_run == 0:
            self._run_began_s = t_s
        self._suspect_run = self._suspect_run + 1 if suspect else 0
        self._far_run = self._far_run + 1 if far else 0
        self._agreed = 0 if suspect else self._agreed + 1
        if self._agreed >= CHANGE_AFTER:
            self.changed_s = math.inf
        if math.isfinite(self.changed_s):
            return True
        if self._far_run > CHANGE_AFTER or self._suspect_run > SUSPECT_AFTER:
            self.changes += 1
            self.changed_s = self._run_began_s
            return True
        self.refused += far
        return not far

    def contradicts(
        self, row: Array, increment: Array, weight: float, path_std_mps: float, weights: Array
    ) -> bool:
        """Whether a window of a reconstructed path is suspect, given the path's own uncertainty."""
        residual = increment - row @ weights
        duration = increment[UNIT]
        if abs(residual[UNIT]) > KNOWN_WITHIN * duration or not math.isfinite(self._mean_square[0]):
            return False
        variance = 3.0 * path_std_mps**2 * (1.0 / weight - 1.0) + self._mean_square[0]
        return bool(residual[0:3] @ residual[0:3] > (0.5 * self._gate) ** 2 * variance * duration**2)


class RegionMemory:
    """Everything kept of one region while the target is elsewhere.

    Several targets' estimators may hold one memory. Its weights then follow one law with the feedback of every target
    in view, ``W_hat' = proj(Gamma sum_m sigma_m (G^T eta_til_m)^T + kCL Gamma (Q - Psi W_hat))``: who comes first at an
    instant takes the step, the others add their feedback to it. ``advanced_s`` is up to when it has been taken.
    """

    def __init__(self, settings: EstimatorSettings, kernels: int, dt_s: float) -> None:
        self._alpha = settings.alpha
        self._forgetting = settings.stack.forgetting
        self._path_std_mps = settings.gap.path_std_mps
        self.forgotten = 0
        self.model = MotionModel(settings, kernels, dt_s)
        self.radius = ErrorRadius()
        self.gate = OutlierGate(settings.stack.outlier_gate)
        self.advanced_s = 0.0
        self._owed_s = 0.0
        self._checked_s = -math.inf
        self._lambda_min, self._lambda_min_visited = 0.0, 0.0

    def take_up(self, t_s: float) -> None:
        """Bring the weights up to ``t_s`` on the stack alone, if nobody has: the law runs on while not in force."""
        if t_s > self.advanced_s:
            self.model.settle(t_s - self.advanced_s)
            self.advanced_s = t_s
        self._owed_s = 0.0

    def due_steps(self, t_s: float, dt_s: float) -> int:
        """Count the nominal weight steps of ``dt_s`` that have fallen due up to ``t_s``; they count as taken."""
        self._owed_s += max(0.0, t_s - self.advanced_s)
        self.advanced_s = max(t_s, self.advanced_s)
        steps = int(self._owed_s / dt_s + 0.5)
        self._owed_s -= steps * dt_s
        return steps

    def learn(self, t_s: float, row: Array, increment: Array) -> None:
        """Offer a measured window to the stack if the gate lets it; after a change, what it contradicts goes first."""
        if not self.gate.passes(row, increment, self.model.weights, t_s):
            return
        if self._forgetting and math.isfinite(self.gate.changed_s):
            self.forgotten += self.model.forget(row, self.gate.changed_s)
        self.model.learn_window(t_s, row, increment)

    def knows(self, row: Array, increment: Array) -> bool:
        """Whether the model answers for the motion in this window, and for places visited before."""
        lacking = abs(increment[UNIT] - float(row @ self.model.weights[:, UNIT]))
        return lacking <= KNOWN_WITHIN * increment[UNIT] and math.isfinite(self.model.excited_s())

    def learn_path(self, t_s: float, began_s: float, windows: Sequence[tuple[Array, Array, float]]) -> None:
        """Offer the windows of a path across a gap that began at ``began_s``.

        If most of them contradict what was learned of the gap before, that goes first.
        """
        against = sum(
            self.gate.contradicts(*window, self._path_std_mps, self.model.weights) for window in windows
        )
        if self._forgetting and 2 * against > len(windows):
            for row, _, _ in windows:
                self.forgotten += self.model.forget(row, began_s)
        for row, increment, weight in windows:
            self.model.learn_window(t_s, row, increment, weight)
            if self._alpha < 1.0:
                # mean sigma and mean rate over the window: plain concurrent learning's entry for the same path
                duration = increment[UNIT]
                self.model.learn_rate(t_s, row / duration, increment / duration, weight)

    def diagnostics(self, t_s: float) -> dict[str, float]:
        """Sizes, eigenvalues (at most ``EIGENVALUE_PERIOD_S`` old), excitation and weight norm."""
        stack = self.model.integral if self._alpha > 0.0 else self.model.instantaneous
        if t_s - self._checked_s >= EIGENVALUE_PERIOD_S:
            self._checked_s = t_s
            self._lambda_min, self._lambda_min_visited = stack.lambda_min(), stack.lambda_min_visited()
        excited = self.model.excited_s()
        return {
            "stack_size": float(self.model.integral.count + self.model.instantaneous.count),
            "lambda_min": self._lambda_min,
            "lambda_min_visited": self._lambda_min_visited,
            "excited": float(math.isfinite(excited)),
            "excited_s": excited,
            "weight_norm": float(np.linalg.norm(self.model.weights[:, :UNIT])),
            "outliers": float(self.gate.refused),
            "changes": float(self.gate.changes),
            "forgotten": float(self.forgotten),
        }


@dataclass(frozen=True, slots=True)
class _Gap:
    """A gap that was crossed and waits for the velocity at its far end."""

    memory: RegionMemory
    exit: EndState
    entry_s: float


class Learner:
    """Collects measured poses of one uninterrupted sighting after another."""

    def __init__(self, settings: EstimatorSettings, basis: RbfBasis, dt_s: float) -> None:
        self._settings = settings
        self._basis = basis
        self._stacked = settings.form == "stacked"
        stack = settings.stack
        self._windows = WindowCollector(basis.size, stack.window_s, dt_s, stack.average, self._stacked)
        self._history = PoseHistory(settings.regression_samples)
        self._gap: _Gap | None = None
        self.gaps_learned = 0
        self.pace = Pace() if settings.gap.pace else None

    def interrupt(self, last_seen_s: float, lost: bool = True) -> EndState | None:
        """End the sighting, ``lost`` or handed over; returns how the target left (None if it was too short to tell)."""
        state = self._history.fit(last_seen_s)
        if self.pace is not None:
            self.pace.leave(lost)
        self._windows.clear()
        self._history.clear()
        self._gap = None
        return state

    def bridge(self, memory: RegionMemory, exit_: EndState, entry_s: float) -> None:
        """Remember to learn the gap that has just ended, for the region that was left."""
        self._gap = _Gap(memory, exit_, entry_s)

    def learn(
        self,
        t_s: float,
        p: Array,
        q: Array,
        sigma: Array,
        memory: RegionMemory,
        motion: Array,
        trusted: bool = True,
    ) -> None:
        """Take a measured pose and its sigma (p,); writes the present ``motion`` (6,) once enough poses are there.

        Of a pose that is not ``trusted`` only the present motion is taken.
        """
        history = self._history
        if 3 * (history.count + 1) < self._settings.regression_samples:
            history.push(t_s, p, q)
        else:
            history.push_and_fit(t_s, p, q, motion)
        if not trusted:
            return
        window = self._windows.push(t_s, p, q, sigma)
        if window is not None:
            if self.pace is not None and memory.knows(*window):
                self.pace.observe(*window, memory.model.weights)
            memory.learn(t_s, *window)
            if self._settings.alpha < 1.0:
                self._learn_rate(t_s, q, memory)
        if self._gap is not None and t_s - self._gap.entry_s >= self._settings.gap.entry_s:
            self._learn_gap(t_s, self._gap)
            self._gap = None

    def _learn_rate(self, t_s: float, q: Array, memory: RegionMemory) -> None:
        """Offer a regressed rate at the middle of the history, (3-13), (4-20)."""
        state = self._history.fit(self._history.middle_s)
        if state is None:
            return
        rate = np.zeros(COLUMNS)
        rate[0:3], rate[UNIT] = state.v, 1.0
        if self._stacked:
            rate[3:7] = 0.5 * multiply(align_sign(state.q, q), np.concatenate(([0.0], state.w)))
        else:
            rate[3:TWIST_OUTPUTS] = state.w
        memory.model.learn_rate(t_s, self._basis(state.p, state.q), rate)

    def _learn_gap(self, t_s: float, gap: _Gap) -> None:
        """Reconstruct the path across the gap and put its windows into the stack of the region of exit."""
        entry = self._history.fit(gap.entry_s)
        if entry is None:
            return
        windows = gap_windows(
            gap.exit, entry, self._basis, self._settings.stack.window_s, self._stacked, self._settings.gap
        )
        gap.memory.learn_path(t_s, gap.exit.t_s, windows)
        self.gaps_learned += bool(windows)

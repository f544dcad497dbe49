"""State of one track between updates, and the compiled steps that run over its window."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.adate.settings import AdateSettings
from camnet.estimation.adate.weights import GATE, LOCAL, NONE, STUDENT
from camnet.estimation.adate.window import Window
from camnet.estimation.pls.model import SteeringModel
from camnet.estimation.pls.noise import channel_covariances, transition
from camnet.types import Array

__all__ = ["Track", "largest_defect", "linearise_window", "mix"]

_RULES: Final = {"local": LOCAL, "gate": GATE, "student": STUDENT, "none": NONE}


class Track:
    """What the stages of an update read and write.

    Attributes
    ----------
    par, settings, dt_s : parameter vector of the model, settings, time between updates unless said otherwise
    elapsed_s : time between the last two updates
    frozen : filtered covariance, transition (10,10) and predicted covariance of the next of every frozen state
    win, start : the window, and the number of states frozen before it
    mean, cov : (10,), (10,10) prior of the window's first state
    all, steps : (K,10) trajectory with room to grow, number of updates
    causal_cov : (10,10) covariance of the last state
    pred_mean : (n,10) means of the forward pass
    rest : whether the linear constant-velocity smoother is at work
    keep_q : whether the covariances Q hold what (35) adapted
    power_scale, steering_scale : factors of the two densities
    ids, scale, weight : slots of the observers; scales (slots,3,3) of their covariances and how sure they are
    rule, rule_par : which rule adapts R, and its parameters
    restarts, fallbacks : times the window was started again; times it stayed at the linear solution
    """

    def __init__(self, model: SteeringModel, dt_s: float, settings: AdateSettings) -> None:
        self.par, self.settings, self.dt_s = model.parameters, settings, dt_s
        self.elapsed_s = dt_s
        self.frozen: list[tuple[Array, Array, Array]] = []
        self.win, self.start = Window(settings.truncation.limit), 0
        self.mean, self.cov = np.zeros(10), np.eye(10)
        self.all, self.steps = np.zeros((256, 10)), 0
        self.causal_cov: Array = np.eye(10)
        self.pred_mean: Array = np.zeros((0, 10))
        self.rest, self.keep_q = True, False
        self.power_scale = self.steering_scale = 1.0
        self.ids: dict[int, int] = {}
        self.scale: Array = np.tile(np.eye(3), (self.win.slots, 1, 1))
        self.weight: Array = np.zeros(self.win.slots)
        a = settings.adaptation
        self.rule = _RULES[a.observation]
        self.rule_par = np.array(
            [a.drift_span, a.drift_gate, a.outlier_gate, a.memory_s, a.student_dof, a.scale_memory],
            dtype=float,
        )
        self.restarts = self.fallbacks = 0


@cached_njit(error_model="numpy")
def linearise_window(
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
    """Transitions, Jacobians and the three parts of the process covariance of the window's n - 1 steps (21), (24)."""
    for i in range(n - 1):
        resting = transition(par, s[i], tau[i], rest, nxt[i], jac[i])
        channel_covariances(par, s[i], nxt[i], tau[i], resting, jac[i], q_power[i], q_steer[i], q_iso[i])


@cached_njit(error_model="numpy")
def largest_defect(n: int, s: Array, nxt: Array, q: Array) -> float:
    """Return the largest squared transition error in units of its variances (inf when not finite)."""
    worst = 0.0
    for i in range(n - 1):
        total = 0.0
        for m in range(10):
            e = s[i + 1, m] - nxt[i, m]
            total += e * e / q[i, m, m]
        if not total <= worst:
            worst = total if total == total else math.inf
    return worst


@cached_njit(error_model="numpy")
def mix(
    first: int, n: int, power: float, steer: float, q_power: Array, q_steer: Array, q_iso: Array, q: Array
) -> None:
    """Process covariances from step ``first`` on: the parts, scaled by the learnt factors."""
    for i in range(first, n - 1):
        for a in range(10):
            for b in range(10):
                q[i, a, b] = power * q_power[i, a, b] + steer * q_steer[i, a, b] + q_iso[i, a, b]

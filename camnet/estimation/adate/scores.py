r"""Adaptation of the transition covariance (li2019, section IV.B) by the likelihood's own gradient.

With Q = kA Q_A + kT Q_T + Q_iso and the multipliers lam of `chain.backward`, the log-likelihood L of the
observations has

    dL/dk = 1/2 (lam' Q_k lam - trace(Q_k Lam)),      Lam = Cov(lam)                       (de Jong, 1989)

so lam' Q_k lam / trace(Q_k Lam) has mean one when k is right. Its logarithm, taken once for each transition
at a fixed lag, drives log k: a density that explains the manoeuvres, learnt while running.

**Departure.** (35) mixes Q with e e^T of the smoothed residual e. A smoothed residual is much smaller than the
disturbance it
estimates (its covariance is Q Lam Q, not Q), so (35) shrinks Q by t_m/(t_m + tau) at almost every update whatever the
motion does, and its rank-one term makes Q nearly singular. `fade` keeps (35) as an option.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray

__all__ = ["fade", "scores"]


@cached_njit(error_model="numpy")
def scores(
    n: int,
    lag: int,
    jac: Array,
    seen: BoolArray,
    gain: Array,
    s_inv: Array,
    lam: Array,
    q_power: Array,
    q_steer: Array,
) -> tuple[float, float, float, float]:
    """Normalised scores of the transition ``lag`` steps before the last: power and steering.

    Returns
    -------
    num_power, den_power, num_steer, den_steer : lam' Q_k lam and trace(Q_k Lam) (zeros when the window is too short)
    """
    target = n - 1 - lag  # the transition target-1 -> target has the multiplier lam[target]
    if target < 1:
        return 0.0, 0.0, 0.0, 0.0
    m = np.zeros((10, 10))  # Lam before the observation of step i, from the last step backwards
    t = np.empty((10, 10))
    for i in range(n - 1, target - 1, -1):
        if seen[i]:
            # (I - K H)' M (I - K H) + H' S^-1 H: first the columns 0-2 of M (I - K H), then its rows 0-2
            k = gain[i]
            for a in range(10):
                for b in range(3):
                    acc = m[a, b]
                    for c in range(10):
                        acc -= m[a, c] * k[c, b]
                    t[a, b] = acc
            for a in range(10):
                for b in range(3):
                    m[a, b] = t[a, b]
            for a in range(3):
                for b in range(10):
                    acc = m[a, b]
                    for c in range(10):
                        acc -= k[c, a] * m[c, b]
                    if b < 3:
                        acc += s_inv[i, a, b]
                    t[a, b] = acc
            for a in range(3):
                for b in range(10):
                    m[a, b] = t[a, b]
                    m[b, a] = t[a, b]
        if i == target:
            break
        # Phi' M Phi
        j = jac[i - 1]
        for a in range(10):
            for b in range(10):
                if b < 3:
                    t[a, b] = m[a, b]
                else:
                    acc = m[a, b] if b >= 6 else 0.0
                    for c in range(6):
                        acc += m[a, c] * j[c, b - 3]
                    t[a, b] = acc
        for b in range(10):
            for a in range(10):
                if a < 3:
                    m[a, b] = t[a, b]
                else:
                    acc = t[a, b] if a >= 6 else 0.0
                    for c in range(6):
                        acc += j[c, a - 3] * t[c, b]
                    m[a, b] = acc
    np_, dp, ns, ds = 0.0, 0.0, 0.0, 0.0
    v = lam[target]
    qa = q_power[target - 1]
    qs = q_steer[target - 1]
    for a in range(10):
        for b in range(10):
            vv = v[a] * v[b]
            np_ += qa[a, b] * vv
            dp += qa[a, b] * m[a, b]
            ns += qs[a, b] * vv
            ds += qs[a, b] * m[a, b]
    return np_, dp, ns, ds


@cached_njit(error_model="numpy")
def fade(n: int, s: Array, nxt: Array, q: Array, tau: Array, memory: float) -> None:
    """Fading-memory update (35)-(36) of every transition covariance of the window, with its floor.

    The floor of 1e-12 of the trace keeps the printed rule from making Q singular.
    """
    e = np.empty(10)
    for i in range(n - 1):
        for m in range(10):
            e[m] = s[i + 1, m] - nxt[i, m]
        total = memory + tau[i]
        for a in range(10):
            for b in range(10):
                q[i, a, b] = (memory * q[i, a, b] + tau[i] * e[a] * e[b]) / total
            q[i, a, a] += 1e-12 * math.fabs(q[i, a, a])

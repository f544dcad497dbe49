r"""Prediction without observations: mean and covariance of the steering model by the cubature rule.

The flow at the mean is the most probable path, not the mean: with an uncertain turn rate the possible paths fan out and
their mean falls short of any one of them. Over a gap the mean is what has the least squared error. Each step
carries 2 n points m +- sqrt(n) L e_j (L L^T = P, equal weights) through the flow and adds Q: Arasaratnam and
Haykin 2009,
the reference [31] of li2019. Equal positive weights keep every covariance positive definite.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.kalman.linalg import cholesky
from camnet.estimation.pls.noise import channel_covariances, transition
from camnet.types import Array

__all__ = ["predict_step"]


@cached_njit(error_model="numpy")
def predict_step(
    par: Array, mean: Array, cov: Array, tau: float, rest: bool, power: float, steer: float
) -> None:
    """Advance ``mean`` (10,) and ``cov`` (10,10) in place by ``tau`` s without an observation.

    Parameters
    ----------
    par : parameter vector of the model
    rest : constant-velocity limit whatever the speed
    power, steer : factors on the two densities
    """
    n = 10
    low = np.empty((n, n))
    pts = np.empty((2 * n, n))
    jac = np.empty((6, 7))
    s = np.empty(n)
    qa = np.empty((n, n))
    qs = np.empty((n, n))
    qi = np.empty((n, n))
    cholesky(cov, low)
    resting = transition(par, mean, tau, rest, s, jac)
    channel_covariances(par, mean, s, tau, resting, jac, qa, qs, qi)
    root = math.sqrt(float(n))
    for j in range(n):
        for side in range(2):
            sign = root if side == 0 else -root
            for m in range(n):
                s[m] = mean[m] + sign * low[m, j]
            transition(par, s, tau, rest, pts[2 * j + side], jac)
    for m in range(n):
        acc = 0.0
        for k in range(2 * n):
            acc += pts[k, m]
        mean[m] = acc / (2 * n)
    for a in range(n):
        for b in range(a + 1):
            acc = 0.0
            for k in range(2 * n):
                acc += (pts[k, a] - mean[a]) * (pts[k, b] - mean[b])
            cov[a, b] = acc / (2 * n) + power * qa[a, b] + steer * qs[a, b] + qi[a, b]
            cov[b, a] = cov[a, b]

r"""Process covariance of one step, positive definite by construction (li2019, (72)-(79)).

    Q = integral over s in (0, tau) of B(s) D B(s)^T ds,    B(s) = d s(tau) / d [p, cT](s),   D = diag(D_A, D_T)   (72)

The integral is taken by the three-point Gauss-Legendre rule with the exact derivative of the flow from each node to the end of
the step: a sum of squares, of full rank while the body moves. A small isotropic density on the velocity keeps it positive
definite at rest, where power and steering act on nothing.

**Departure.** (78)-(79) drop powers of tau (and 1 - E where E is meant) and give indefinite matrices; the integral (72)
itself is evaluated here.

Below ``rest_speed`` the heading is undefined and the model degenerates (dv/dp ~ 1/r). There the transition
is the limit that keeps an estimator alive: constant velocity with white acceleration of density ``rest_density``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.estimation.pls.flow import flow, flow_derivative

__all__ = ["PARAMETERS", "process_covariance", "transition"]

#: order of the parameter vector handed to the kernels
PARAMETERS = (
    "kind",
    "alpha",
    "beta",
    "power_density",
    "steering_density_x",
    "steering_density_y",
    "steering_density_z",
    "velocity_density",
    "rest_speed",
    "rest_density",
)

_X3 = np.array([0.1127016653792583, 0.5, 0.8872983346207417])
_W3 = np.array([5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0])


@njit(cache=True, error_model="numpy")
def transition(par, s, tau, rest, out, jac):  # type: ignore[no-untyped-def]
    """Flow and derivative of one step; constant velocity when ``rest`` or slower than ``rest_speed``.

    Returns
    -------
    bool : whether the constant-velocity limit was used
    """
    r2 = s[3] * s[3] + s[4] * s[4] + s[5] * s[5]
    if rest or r2 < par[8] * par[8]:
        for i in range(10):
            out[i] = s[i]
        for i in range(6):
            for j in range(7):
                jac[i, j] = 0.0
        for i in range(3):
            out[i] += tau * s[3 + i]
            jac[i, i] = tau
            jac[3 + i, i] = 1.0
        return True
    flow_derivative(int(par[0]), s, tau, par[1], par[2], out, jac)
    return False


@njit(cache=True, error_model="numpy")
def process_covariance(par, s, tau, rest, q):  # type: ignore[no-untyped-def]
    """Fill ``q`` (10,10) with the covariance (72) of a step of ``tau`` from ``s``.

    Parameters
    ----------
    par : parameter vector, see `PARAMETERS`
    rest : take the constant-velocity limit whatever the speed
    """
    out = np.empty(10)
    mid = np.empty(10)
    jac = np.empty((6, 7))
    density = np.empty(4)
    for i in range(4):
        density[i] = par[3 + i]
    for i in range(10):
        for j in range(10):
            q[i, j] = 0.0
    iso = par[7]
    r2 = s[3] * s[3] + s[4] * s[4] + s[5] * s[5]
    resting = rest or r2 < par[8] * par[8]
    if not resting:
        kind = int(par[0])
        for k in range(3):
            flow(kind, s, _X3[k] * tau, par[1], par[2], mid)
            flow_derivative(kind, mid, (1.0 - _X3[k]) * tau, par[1], par[2], out, jac)
            w = _W3[k] * tau
            for i in range(6):
                for j in range(i + 1):
                    acc = 0.0
                    for m in range(4):
                        acc += jac[i, 3 + m] * density[m] * jac[j, 3 + m]
                    q[i, j] += w * acc
                for m in range(4):
                    q[6 + m, i] += w * density[m] * jac[i, 3 + m]
        end2 = out[3] * out[3] + out[4] * out[4] + out[5] * out[5]
        if end2 < par[8] * par[8]:
            iso += par[9]
    else:
        iso += par[9]
    for m in range(4):
        q[6 + m, 6 + m] = tau * density[m]
    for i in range(3):
        q[i, i] += iso * tau**3 / 3.0
        q[3 + i, i] += iso * tau * tau / 2.0
        q[3 + i, 3 + i] += iso * tau
    for i in range(10):
        for j in range(i):
            q[j, i] = q[i, j]
    return math.isfinite(q[0, 0])

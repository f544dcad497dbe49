r"""Process covariance of one step, positive definite by construction (li2019, (72)-(79)).

    Q = integral over s in (0, tau) of B(s) D B(s)^T ds,    B(s) = d s(tau) / d [p, cT](s),   D = diag(D_A, D_T)   (72)

B is interpolated over the step by the polynomial that has its exact value and slope at both ends: with g = [u/r, -[v]x]

    B_v(sig) = a sig + b sig^2 + c sig^3,   B_x(sig) = a/2 sig^2 + b sig^3 + c sig^4,   sig = tau - s
    a = g(end),   B(tau) = Phi[:, p cT],   B'(tau) = Phi[:, v] g(start)

and the integral is taken by the four-point Gauss-Legendre rule (with B from the flow at every node where the squared
speed changes by more than a factor of two in the step): a sum of squares, of full rank while the body moves. A small
isotropic density on the velocity keeps it positive definite at rest, where power and steering act on nothing.

**Departure.** (78)-(79) drop powers of tau (and 1 - E where E is meant) and give indefinite matrices; the integral (72)
itself is evaluated here.

Below ``rest_speed`` the heading is undefined and the model degenerates (dv/dp ~ 1/r). There the transition
is the limit that keeps an estimator alive: constant velocity with white acceleration of density ``rest_density``.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.pls.flow import POWER_LIMITED, flow, flow_derivative
from camnet.types import Array

__all__ = ["PARAMETERS", "channel_covariances", "process_covariance", "transition"]

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

# Gauss-Legendre, four points on [0, 1]
_X4 = np.array([0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262])
_W4 = np.array([0.17392742256872692, 0.32607257743127307, 0.32607257743127307, 0.17392742256872692])


@cached_njit(error_model="numpy")
def transition(par: Array, s: Array, tau: float, rest: bool, out: Array, jac: Array) -> bool:
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


@cached_njit(error_model="numpy")
def _gain(kind: int, s: Array, g: Array) -> None:
    """Effect (3,4) of power and angular velocity on the acceleration: [u/r, -[v]x]."""
    r2 = s[3] * s[3] + s[4] * s[4] + s[5] * s[5]
    inv = 1.0 / r2 if r2 > 0.0 and kind == POWER_LIMITED else 0.0
    for i in range(3):
        g[i, 0] = s[3 + i] * inv
    g[0, 1], g[0, 2], g[0, 3] = 0.0, s[5], -s[4]
    g[1, 1], g[1, 2], g[1, 3] = -s[5], 0.0, s[3]
    g[2, 1], g[2, 2], g[2, 3] = s[4], -s[3], 0.0


@cached_njit(error_model="numpy")
def _moving(par: Array, s: Array, end: Array, tau: float, jac: Array, q_power: Array, q_steer: Array) -> None:
    """Add the integral (72) of a moving body to the lower triangles of ``q_power`` and ``q_steer``."""
    kind = int(par[0])
    start_gain = np.empty((3, 4))
    end_gain = np.empty((3, 4))
    _gain(kind, s, start_gain)
    _gain(kind, end, end_gain)
    second = np.empty((6, 4))  # coefficients b and c over tau^2 (v rows) and tau^3 (x rows)
    third = np.empty((6, 4))
    for i in range(3):
        for m in range(4):
            slope_x, slope_v = 0.0, 0.0
            for c in range(3):
                slope_x += jac[i, c] * start_gain[c, m]
                slope_v += jac[3 + i, c] * start_gain[c, m]
            a = end_gain[i, m]
            rest_v = jac[3 + i, 3 + m] - a * tau  # b tau^2 + c tau^3
            rest_x = jac[i, 3 + m] - 0.5 * a * tau * tau  # b tau^3 + c tau^4
            tilt_v = (slope_v - a) * tau  # 2 b tau^2 + 3 c tau^3
            tilt_x = (slope_x - a * tau) * tau  # 3 b tau^3 + 4 c tau^4
            third[3 + i, m] = tilt_v - 2.0 * rest_v
            second[3 + i, m] = rest_v - third[3 + i, m]
            third[i, m] = tilt_x - 3.0 * rest_x
            second[i, m] = rest_x - third[i, m]
    b = np.empty((6, 4))
    for k in range(4):
        x = _X4[k]
        for i in range(3):
            for m in range(4):
                a = end_gain[i, m]
                b[3 + i, m] = x * (a * tau + x * (second[3 + i, m] + x * third[3 + i, m]))
                b[i, m] = x * x * (0.5 * a * tau * tau + x * (second[i, m] + x * third[i, m]))
        _accumulate(par, b, _W4[k] * tau, q_power, q_steer)


@cached_njit(error_model="numpy")
def _accumulate(par: Array, b: Array, w: float, q_power: Array, q_steer: Array) -> None:
    """Add w B D B' of one node, B (6,4) over the identity of the power and turn rate."""
    for i in range(6):
        for j in range(i + 1):
            q_power[i, j] += w * par[3] * b[i, 0] * b[j, 0]
            q_steer[i, j] += w * (
                par[4] * b[i, 1] * b[j, 1] + par[5] * b[i, 2] * b[j, 2] + par[6] * b[i, 3] * b[j, 3]
            )
        q_power[6, i] += w * par[3] * b[i, 0]
        for m in range(3):
            q_steer[7 + m, i] += w * par[4 + m] * b[i, 1 + m]


@cached_njit(error_model="numpy")
def _changing(par: Array, s: Array, tau: float, q_power: Array, q_steer: Array) -> None:
    """As `_moving` where the speed changes much within the step: B from the flow at every node."""
    mid = np.empty(10)
    end = np.empty(10)
    jac = np.empty((6, 7))
    for k in range(4):
        flow(int(par[0]), s, _X4[k] * tau, par[1], par[2], mid)
        flow_derivative(int(par[0]), mid, (1.0 - _X4[k]) * tau, par[1], par[2], end, jac)
        _accumulate(par, jac[:, 3:7], _W4[k] * tau, q_power, q_steer)


@cached_njit(error_model="numpy")
def channel_covariances(
    par: Array,
    s: Array,
    end: Array,
    tau: float,
    resting: bool,
    jac: Array,
    q_power: Array,
    q_steer: Array,
    q_iso: Array,
) -> None:
    """Parts of (72) by source: random power, random steering, isotropic velocity; Q is their sum.

    Parameters
    ----------
    par : parameter vector, see `PARAMETERS`
    s, end, tau, jac : state, next state, step in s and derivative, as `transition` gives them
    resting : what `transition` returned
    q_power, q_steer, q_iso : (10,10) outputs, each positive semidefinite
    """
    q_power[:] = 0.0
    q_steer[:] = 0.0
    q_iso[:] = 0.0
    iso = par[7]
    if not resting:
        before = s[3] * s[3] + s[4] * s[4] + s[5] * s[5]
        after = end[3] * end[3] + end[4] * end[4] + end[5] * end[5]
        if 0.5 * before < after < 2.0 * before:
            _moving(par, s, end, tau, jac, q_power, q_steer)
        else:
            _changing(par, s, tau, q_power, q_steer)
        resting = after < par[8] * par[8]
    if resting:
        iso += par[9]
    q_power[6, 6] = tau * par[3]
    for m in range(3):
        q_steer[7 + m, 7 + m] = tau * par[4 + m]
        q_iso[m, m] = iso * tau**3 / 3.0
        q_iso[3 + m, m] = iso * tau * tau / 2.0
        q_iso[3 + m, 3 + m] = iso * tau
    for i in range(10):
        for j in range(i):
            q_power[j, i] = q_power[i, j]
            q_steer[j, i] = q_steer[i, j]
            q_iso[j, i] = q_iso[i, j]


@cached_njit(error_model="numpy")
def process_covariance(
    par: Array, s: Array, end: Array, tau: float, resting: bool, jac: Array, q: Array
) -> None:
    """Fill ``q`` (10,10) with the whole covariance (72); arguments as in `channel_covariances`."""
    steer = np.empty((10, 10))
    iso = np.empty((10, 10))
    channel_covariances(par, s, end, tau, resting, jac, q, steer, iso)
    for i in range(10):
        for j in range(10):
            q[i, j] += steer[i, j] + iso[i, j]

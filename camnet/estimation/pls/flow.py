r"""Flow of the 10-state steering models and its exact derivative (li2019, (14), (17), (20), (24), appendix C).

State s = [x (3), v (3), p, cT (3)]: position m, velocity m/s, specific power m^2/s^3, angular velocity rad/s.
With p and cT held over a step,

    v(t) = r(t) R(t) u,   R(t) = exp(t [cT]x),   u = v/|v|                                        (17), (20)
    x(t) = x + integral of v over (0, t)

where r(t) is the exact speed transition (`camnet.estimation.pls.speed`). The derivative blocks used as Phi (24) are

    dv/dv = (r/r0) R + (Psi - r/r0) (R u) u^T,   dv/dp = P R u,   dv/dcT = -[v(t)]x J(t)
    J(t) = t I + (1 - cos th)/|c|^2 [c]x + (th - sin th)/|c|^3 [c]x^2,   th = |c| t

and the position rows are the integral of the velocity rows, by the four-point Radau rule with the step's end as a node.

**Departure.** The paper's Phi (63)-(71) satisfies Phi s ~ flow(s) but is not the derivative of the flow
(`linear_form` gives its regular form for comparison); Gauss-Newton needs the derivative, and the offset
flow(s) - Phi s.

`CONSTANT_TURN` is the same model with the speed held: the constant-turn baseline in the same ten states.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.pls.speed import speed_transition
from camnet.types import Array

__all__ = ["CONSTANT_TURN", "POWER_LIMITED", "flow", "flow_derivative", "linear_form", "skew"]

POWER_LIMITED = 0
CONSTANT_TURN = 1

# Radau, right end included, order 7, on [0, 1]
_NODE = np.array([0.088587959512704, 0.409466864440735, 0.787659461760847, 1.0])
_WEIGHT = np.array([0.220462211176768, 0.388193468843172, 0.328844319980060, 0.0625])


def skew(a: Array) -> Array:
    """Matrix [a]x with [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@cached_njit(error_model="numpy")
def _turn(c: Array, t: float, rot: Array) -> tuple[float, float]:
    """Fill ``rot`` (3,3) with exp(t [c]x); return the coefficients of J(t)."""
    c2 = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    th2 = c2 * t * t
    if th2 < 1e-8:
        a1 = t * (1.0 - th2 / 6.0)
        a2 = t * t * (0.5 - th2 / 24.0)
        a3 = t * t * t * (1.0 / 6.0 - th2 / 120.0)
    else:
        norm = math.sqrt(c2)
        th = norm * t
        sin = math.sin(th)
        half = math.sin(0.5 * th)
        a1 = sin / norm
        a2 = 2.0 * half * half / c2
        a3 = (th - sin) / (c2 * norm)
    for i in range(3):
        for j in range(3):
            rot[i, j] = a2 * c[i] * c[j]
        rot[i, i] += 1.0 - a2 * c2
    rot[0, 1] -= a1 * c[2]
    rot[0, 2] += a1 * c[1]
    rot[1, 0] += a1 * c[2]
    rot[1, 2] -= a1 * c[0]
    rot[2, 0] -= a1 * c[1]
    rot[2, 1] += a1 * c[0]
    return a2, a3


@cached_njit(error_model="numpy")
def flow(kind: int, s: Array, tau: float, alpha: float, beta: float, out: Array) -> None:
    """State after ``tau`` written to ``out`` (10,); p and cT stay.

    Parameters
    ----------
    kind : `POWER_LIMITED` or `CONSTANT_TURN`
    s : (10,) state
    tau : step, s
    alpha, beta : damping 1/s and resistance m/s^2
    """
    c = s[7:10]
    r0 = math.sqrt(s[3] * s[3] + s[4] * s[4] + s[5] * s[5])
    inv = 1.0 / r0 if r0 > 0.0 else 0.0
    rot = np.empty((3, 3))
    for i in range(10):
        out[i] = s[i]
    for k in range(4):
        t = _NODE[k] * tau
        ratio = 1.0
        if kind == POWER_LIMITED:
            ratio = speed_transition(r0, s[6], t, alpha, beta)[0] * inv
        _turn(c, t, rot)
        for i in range(3):
            vi = ratio * (rot[i, 0] * s[3] + rot[i, 1] * s[4] + rot[i, 2] * s[5])
            out[i] += tau * _WEIGHT[k] * vi
            if k == 3:
                out[3 + i] = vi


@cached_njit(error_model="numpy")
def flow_derivative(
    kind: int, s: Array, tau: float, alpha: float, beta: float, out: Array, jac: Array
) -> None:
    """As `flow`, and ``jac`` (6, 7): derivative of (x, v) after the step by (v, p, cT) before it.

    The whole Phi (10, 10) is [[I, jac[:3]], [0, jac[3:]], [0, 0, I4]] in columns x, (v, p, cT).
    """
    c = s[7:10]
    r0 = math.sqrt(s[3] * s[3] + s[4] * s[4] + s[5] * s[5])
    inv = 1.0 / r0 if r0 > 0.0 else 0.0
    c2 = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    rot = np.empty((3, 3))
    tang = np.empty((3, 3))
    ru = np.empty(3)
    for i in range(10):
        out[i] = s[i]
    for i in range(6):
        for j in range(7):
            jac[i, j] = 0.0
    for k in range(4):
        t = _NODE[k] * tau
        r1, psi, power = r0, 1.0, 0.0
        if kind == POWER_LIMITED:
            r1, psi, power = speed_transition(r0, s[6], t, alpha, beta)
        ratio = r1 * inv
        a2, a3 = _turn(c, t, rot)
        for i in range(3):  # J(t)
            for j in range(3):
                tang[i, j] = a3 * c[i] * c[j]
            tang[i, i] += t - a3 * c2
        tang[0, 1] -= a2 * c[2]
        tang[0, 2] += a2 * c[1]
        tang[1, 0] += a2 * c[2]
        tang[1, 2] -= a2 * c[0]
        tang[2, 0] -= a2 * c[1]
        tang[2, 1] += a2 * c[0]
        for i in range(3):
            ru[i] = (rot[i, 0] * s[3] + rot[i, 1] * s[4] + rot[i, 2] * s[5]) * inv
        w = tau * _WEIGHT[k]
        for i in range(3):
            i1 = (i + 1) % 3
            i2 = (i + 2) % 3
            out[i] += w * r1 * ru[i]
            for j in range(3):
                dv = ratio * rot[i, j] + (psi - ratio) * ru[i] * s[3 + j] * inv
                # row i of -[v]x J: (v x)_i picks -(v_{i+1} J_{i+2} - v_{i+2} J_{i+1})
                dc = -r1 * (ru[i1] * tang[i2, j] - ru[i2] * tang[i1, j])
                jac[i, j] += w * dv
                jac[i, 4 + j] += w * dc
                if k == 3:
                    jac[3 + i, j] = dv
                    jac[3 + i, 4 + j] = dc
            jac[i, 3] += w * power * ru[i]
            if k == 3:
                jac[3 + i, 3] = power * ru[i]
                out[3 + i] = r1 * ru[i]


def linear_form(s: Array, tau: float, alpha: float, beta: float, shift: float = 0.0) -> Array:
    """Give the paper's transition matrix (24), (70)-(71) in its regular form, for comparison.

    Expanded about the equilibrium speed -z2 = 2 p/(beta + gamma) instead of -z1, so that h = 2/(beta + gamma) stays
    finite through p = 0 and |v+| = E |v| + (1 - E) h p holds exactly; ``shift`` is the compensation Dv (18).

    Parameters
    ----------
    s : (10,) state with non-zero velocity
    tau : step, s

    Returns
    -------
    (10, 10) matrix with Phi s ~ flow(s) for small |cT| tau
    """
    v, p = s[3:6], s[6]
    r = float(np.linalg.norm(v))
    gamma = math.sqrt(max(beta * beta + 4.0 * alpha * p, 0.0))
    h = 2.0 / (beta + gamma)
    r1, psi, _ = speed_transition(r, p, tau, alpha, beta)
    e = (r1 - h * p) / (r - h * p) if abs(r - h * p) > 1e-9 * r else psi
    e += shift / r
    phi = e + (1.0 - e) * h * p / r  # (69)
    out = np.eye(10)
    out[3:6, 3:6] = e * np.eye(3)  # (70)
    out[3:6, 6] = (1.0 - e) * h * v / r
    out[3:6, 7:10] = -tau * phi * skew(v)
    out[0:3, 3:6] = 0.5 * tau * (1.0 + e) * np.eye(3)  # (71)
    out[0:3, 6] = 0.5 * tau * (1.0 - e) * h * v / r
    out[0:3, 7:10] = -0.5 * tau * tau * phi * skew(v)
    return out

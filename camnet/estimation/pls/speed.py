r"""Exact speed transition of the power-limited steering model (li2019, (15), (17), appendix A).

With the specific power held over a step the speed obeys one scalar equation,

    dr/dt = p/r - alpha r - beta = -D(r)/r,    D(r) = alpha r^2 + beta r - p    (15)

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| r, r1 | speed before and after the step | m/s | (15) |
| p | specific power | m^2/s^3 | (10) |
| gamma | sqrt(beta^2 + 4 alpha p) | m/s^2 | (48) |
| z1 | (beta + gamma)/(2 alpha) | m/s | (47) |
| req | equilibrium speed -z2 = 2 p/(beta + gamma) | m/s | (47) |
| E | (r1 - req)/(r - req) = exp(y) | 1 | see below |
| Psi | dr1/dr | 1 | |
| P | dr1/dp | s^2/m | |

**Departure.** The paper solves (50) for the speed and expands about the root -z1, with h = 2/(beta - gamma), which is
singular where p crosses zero. Writing r1 = req + E (r - req) turns (50) into

    G(y) = req y + gamma tau + z1 log(1 + a (exp(y) - 1)) = 0,    a = (r - req)/(r + z1)

which is monotone in y = log E, regular at p = 0 and at r = req, and is solved to convergence by Newton's
method inside a
bracket. The derivatives Psi and P follow by differentiating G. Where p is so negative that the roots are close
or complex (gamma^2 <= beta^2/4) the travel time itself is the equation: D is then bounded away from zero.
Both branches end at rest (r1 = 0) when the body stops within the step, which the paper's formula does not cover.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit

__all__ = ["compensation", "equilibrium_speed", "speed_transition"]

_ITERATIONS = 80
_TOLERANCE = 4e-16
# Gauss-Legendre, five points on [-1, 1]
_X5 = np.array([-0.906179845938664, -0.5384693101056831, 0.0, 0.5384693101056831, 0.906179845938664])
_W5 = np.array(
    [0.23692688505618908, 0.47862867049936647, 0.5688888888888889, 0.47862867049936647, 0.23692688505618908]
)


def equilibrium_speed(p: float, alpha: float, beta: float) -> float:
    """Speed at which power and resistance balance; 0 for p <= 0 (li2019, below (10)).

    Parameters
    ----------
    p : specific power, m^2/s^3
    alpha, beta : damping 1/s and resistance m/s^2, both positive
    """
    return 2.0 * p / (beta + math.sqrt(beta * beta + 4.0 * alpha * p)) if p > 0.0 else 0.0


@cached_njit(error_model="numpy")
def _root_form(r: float, p: float, tau: float, alpha: float, beta: float) -> tuple[float, float, float]:
    """Branch with two well separated real roots: Newton on G(y); returns (r1, Psi, P)."""
    gamma = math.sqrt(beta * beta + 4.0 * alpha * p)
    z1 = (beta + gamma) / (2.0 * alpha)
    req = 2.0 * p / (beta + gamma)
    away = r - req
    a = away / (r + z1)
    if away == 0.0:
        y = -gamma * tau / req if req > 0.0 else 0.0
    elif abs(req) <= 1e-13 * (1.0 + r):  # p = 0: r' = -(alpha r + beta) in closed form
        em1 = math.expm1(-gamma * tau / z1) / a
        if em1 <= -1.0:
            return 0.0, 0.0, 0.0
        y = math.log1p(em1)
    else:
        # bracket of the root, then a first guess from the linearised speed equation
        l_inf = math.log((req + z1) / (r + z1))  # log(1 - a), the limit of the last term of G
        if req > 0.0:
            e1, e2 = -gamma * tau / req, -(gamma * tau + z1 * l_inf) / req
            low, high = min(e1, e2), min(max(e1, e2), 0.0)
        else:
            stop = -req / away  # E at which the speed is zero
            low, high = math.log(stop), 0.0
            if req * low + gamma * tau + z1 * math.log1p(a * (stop - 1.0)) >= 0.0:
                return 0.0, 0.0, 0.0
        lam = -(p / max(r * r, 1e-12) + alpha)
        gain = math.expm1(lam * tau) / lam if abs(lam * tau) > 1e-8 else tau
        guess = r + (p / max(r, 1e-6) - alpha * r - beta) * gain
        fraction = (guess - req) / away
        y = math.log(fraction) if fraction > 0.0 else low
        if not (low <= y <= high):
            y = low if away < 0.0 else high
        for _ in range(_ITERATIONS):
            em1 = math.expm1(y)
            value = req * y + gamma * tau + z1 * math.log1p(a * em1)
            slope = req + z1 * a * (1.0 + em1) / (1.0 + a * em1)
            if value > 0.0:
                high = y
            else:
                low = y
            new = y - value / slope
            if not (low <= new <= high):
                new = 0.5 * (low + high)
            done = abs(new - y) <= _TOLERANCE * (1.0 + abs(new))
            y = new
            if done:
                break
    em1 = math.expm1(y)
    e = 1.0 + em1
    r1 = req + e * away if e < 0.5 else r + em1 * away
    if r1 <= 0.0:
        return 0.0, 0.0, 0.0
    psi = e * (r1 + z1) * r / ((r + z1) * r1)
    # dy/dp = -G_p / G_y at fixed r and tau; d(req)/dp = d(z1)/dp = 1/gamma, d(gamma)/dp = 2 alpha/gamma
    q = a * em1
    q_p = -em1 * (2.0 * r + z1 - req) / (gamma * (r + z1) ** 2)
    g_p = (y + 2.0 * alpha * tau + math.log1p(q)) / gamma + z1 * q_p / (1.0 + q)
    g_y = r1 * (gamma / alpha) / (r1 + z1)
    pow_ = -em1 / gamma - away * e * g_p / g_y
    return r1, psi, pow_


@cached_njit(error_model="numpy")
def _travel_time(r0: float, r1: float, p: float, alpha: float, beta: float) -> float:
    """Time to slow from r0 to r1 where D > 0 throughout, the integral of u/D(u) (45)."""
    d0 = alpha * r0 * r0 + beta * r0 - p
    d1 = alpha * r1 * r1 + beta * r1 - p
    upper = 2.0 * alpha * r0 + beta
    lower = 2.0 * alpha * r1 + beta
    g2 = beta * beta + 4.0 * alpha * p
    x = (upper - lower) / (upper * lower - g2)
    if g2 * x * x > 1e-10:
        root = math.sqrt(g2)
        inverse = math.atanh(root * x) / root
    elif g2 * x * x < -1e-10:
        root = math.sqrt(-g2)
        inverse = math.atan2(root * (upper - lower), upper * lower - g2) / root
    else:
        inverse = x * (1.0 + g2 * x * x / 3.0)
    # integral of 1/D is 2 * inverse
    return 0.5 * math.log(d0 / d1) / alpha - beta / alpha * inverse


@cached_njit(error_model="numpy")
def _braking_form(r: float, p: float, tau: float, alpha: float, beta: float) -> tuple[float, float, float]:
    """Branch of strong braking: Newton on the travel time in the variable w = r^2/2; returns (r1, Psi, P)."""
    if r <= 0.0 or tau >= _travel_time(r, 0.0, p, alpha, beta):
        return 0.0, 0.0, 0.0
    low, high = 0.0, 0.5 * r * r
    d0 = alpha * r * r + beta * r - p
    w = max(high - d0 * tau, 0.0)
    for _ in range(_ITERATIONS):
        r1 = math.sqrt(2.0 * w)
        value = tau - _travel_time(r, r1, p, alpha, beta)
        if value > 0.0:
            high = w
        else:
            low = w
        new = w - value * (alpha * r1 * r1 + beta * r1 - p)  # dT/dw = -1/D
        if not (low <= new <= high):
            new = 0.5 * (low + high)
        done = abs(new - w) <= _TOLERANCE * (0.5 * r * r)
        w = new
        if done:
            break
    r1 = math.sqrt(2.0 * w)
    if r1 <= 0.0:
        return 0.0, 0.0, 0.0
    d1 = alpha * r1 * r1 + beta * r1 - p
    integral = 0.0  # of u / D(u)^2 between r1 and r
    for k in range(5):
        u = 0.5 * (r + r1) + 0.5 * (r - r1) * _X5[k]
        d = alpha * u * u + beta * u - p
        integral += _W5[k] * u / (d * d)
    integral *= 0.5 * (r - r1)
    return r1, d1 * r / (d0 * r1), d1 / r1 * integral


@cached_njit(error_model="numpy")
def speed_transition(r: float, p: float, tau: float, alpha: float, beta: float) -> tuple[float, float, float]:
    """Speed after ``tau`` and its derivatives, with the specific power held (17).

    Parameters
    ----------
    r : speed, m/s (>= 0)
    p : specific power, m^2/s^3, any sign
    tau : step, s (>= 0)
    alpha, beta : damping 1/s and resistance m/s^2, both positive

    Returns
    -------
    r1, dr1/dr, dr1/dp : all zero once the body has stopped; p > 0 starts a body from rest
    """
    if tau <= 0.0:
        return r, 1.0, 0.0
    if r <= 0.0 and p <= 0.0:
        return 0.0, 0.0, 0.0
    if beta * beta + 4.0 * alpha * p > 0.25 * beta * beta:
        return _root_form(r, p, tau, alpha, beta)
    return _braking_form(r, p, tau, alpha, beta)


@cached_njit(error_model="numpy")
def compensation(r: float, p: float, tau: float, alpha: float, beta: float, power_density: float) -> float:
    """Mean shift of the speed by the random power during the step, (18) and appendix B.

    **Departure.** The integral of (58) gives the factor 1/mu^2; (18) and (60) print 1/mu (their units do not match).
    Near mu = 0 the series of the bracket is used. Returns 0 where the expansion does not hold (rest, or r^2 + tau mu
    not positive).
    """
    mu = p - r * (alpha * r + beta)
    r2 = r * r
    if r2 <= 0.0 or r2 + tau * mu <= 0.1 * r2:
        return 0.0
    x = tau * mu / r2
    if abs(x) < 1e-3:
        bracket = 1.0 / 3.0 - x / 2.0 + 0.6 * x * x  # (1 - 2 log(1+x)/x + 1/(1+x)) / x^2
    else:
        bracket = (1.0 - 2.0 * math.log1p(x) / x + 1.0 / (1.0 + x)) / (x * x)
    return -0.5 * power_density * tau**3 / (r2 * r) * bracket

"""The model straight from its differential equation: slow, readable, the oracle of the compiled kernels.

Nothing here shares a formula with `speed`, `flow` or `noise` but equation (14) itself.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from camnet.estimation.pls.model import PowerLimitedSteering
from camnet.types import Array

__all__ = ["derivative", "ode_flow", "rate", "simulate"]


def rate(s: Array, alpha: float, beta: float) -> Array:
    """Right-hand side of (14) without the random controls, at a state (10,) with non-zero velocity."""
    v, p, c = s[3:6], s[6], s[7:10]
    speed = np.linalg.norm(v)
    axial = -alpha * v - beta * v / speed + p * v / speed**2
    return np.concatenate([v, axial + np.cross(c, v), np.zeros(4)])


def ode_flow(s: Array, tau_s: float, alpha: float, beta: float) -> Array:
    """Solution of (14) after ``tau_s`` by an eighth-order Runge-Kutta method; the body must not stop on the way."""
    solution = solve_ivp(
        lambda _, y: rate(y, alpha, beta), (0.0, tau_s), s, method="DOP853", rtol=1e-13, atol=1e-14
    )
    return np.asarray(solution.y[:, -1], dtype=float)


def derivative(s: Array, tau_s: float, alpha: float, beta: float) -> Array:
    """Differentiate: (10,10) of `ode_flow` by fourth-order central differences."""
    out = np.empty((10, 10))
    for j in range(10):
        h = 1e-4 * max(abs(s[j]), 0.1)
        if 3 <= j < 6:
            h = 1e-3 * float(np.linalg.norm(s[3:6]))
        e = np.zeros(10)
        e[j] = h
        near = ode_flow(s + e, tau_s, alpha, beta) - ode_flow(s - e, tau_s, alpha, beta)
        far = ode_flow(s + 2 * e, tau_s, alpha, beta) - ode_flow(s - 2 * e, tau_s, alpha, beta)
        out[:, j] = (8.0 * near - far) / (12.0 * h)
    return out


def simulate(
    model: PowerLimitedSteering, s: Array, tau_s: float, count: int, substeps: int, rng: np.random.Generator
) -> Array:
    """Draw ``count`` end states (count,10) of the system (14) by Heun's method, from ``s`` (10,) or (count,10).

    Bodies must not come near rest: the drift is singular there.
    """
    dt = tau_s / substeps
    y = np.array(np.broadcast_to(s, (count, 10)))
    steering = np.broadcast_to(np.asarray(model.steering_density), (3,))

    def drift(z: Array) -> Array:
        v, p, c = z[:, 3:6], z[:, 6:7], z[:, 7:10]
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        axial = (-model.alpha - model.beta / speed + p / speed**2) * v
        return np.hstack([v, axial + np.cross(c, v), np.zeros((len(z), 4))])

    for _ in range(substeps):
        noise = np.zeros_like(y)
        noise[:, 6] = rng.normal(0.0, np.sqrt(model.power_density * dt), count)
        noise[:, 7:10] = rng.normal(0.0, np.sqrt(steering * dt), (count, 3))
        k1 = drift(y)
        k2 = drift(y + dt * k1 + noise)
        y = y + 0.5 * dt * (k1 + k2) + noise
    return y

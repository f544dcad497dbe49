"""Motion models of the Kalman family: linear ones as matrices, steering ones through their compiled transition.

| model | states | source |
| --- | --- | --- |
| constant velocity | x, v | white acceleration |
| constant acceleration | x, v, a | white jerk, or any Q (the baseline of li2019, section V.A) |
| constant turn, power-limited steering | x, v, p, cT | `camnet.estimation.pls` |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import ConfigError
from camnet.estimation.pls.model import SteeringModel
from camnet.types import Array

__all__ = ["LINEAR", "STEERING", "LinearModel", "constant_acceleration", "constant_velocity", "kernel_model"]

LINEAR, STEERING = 0, 1


@dataclass(frozen=True, eq=False)
class LinearModel:
    """x+ = F x + noise of covariance Q, for one fixed step; the first three states are the position.

    Parameters
    ----------
    transition : F (n,n)
    noise : Q (n,n), positive semidefinite

    Raises
    ------
    ConfigError : shapes do not fit or Q is not symmetric positive semidefinite
    """

    transition: Array
    noise: Array

    def __post_init__(self) -> None:
        f = np.ascontiguousarray(self.transition, dtype=float)
        q = np.ascontiguousarray(self.noise, dtype=float)
        if f.ndim != 2 or f.shape[0] != f.shape[1] or f.shape[0] < 3 or q.shape != f.shape:
            raise ConfigError(
                f"transition {f.shape} and noise {q.shape}: give two (n,n) matrices with n >= 3"
            )
        if not np.allclose(q, q.T) or np.linalg.eigvalsh(q)[0] < -1e-12 * np.trace(q):
            raise ConfigError("noise: the matrix must be symmetric and positive semidefinite")
        for name, value in (("transition", f), ("noise", q)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)


def constant_velocity(dt_s: float, density: float) -> LinearModel:
    """Constant velocity in three dimensions with white acceleration of ``density`` (m/s)^2/s."""
    f = np.eye(6)
    f[:3, 3:] = dt_s * np.eye(3)
    q = np.kron(np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]]), np.eye(3))
    return LinearModel(f, density * q)


def constant_acceleration(dt_s: float, density: float = 1e-4, noise: ArrayLike | None = None) -> LinearModel:
    """Constant acceleration (1)-(3): white jerk of ``density`` (m/s^2)^2/s, or the covariance ``noise`` (9,9)."""
    f = np.kron(np.array([[1.0, dt_s, dt_s**2 / 2.0], [0.0, 1.0, dt_s], [0.0, 0.0, 1.0]]), np.eye(3))
    powers = np.array([[20.0, 8.0, 6.0], [8.0, 3.0, 2.0], [6.0, 2.0, 1.0]])
    order = np.array([[5, 4, 3], [4, 3, 2], [3, 2, 1]])
    q = np.kron(density * dt_s**order / powers, np.eye(3))
    return LinearModel(f, q if noise is None else np.asarray(noise, dtype=float))


def kernel_model(model: LinearModel | SteeringModel) -> tuple[int, Array, Array, Array]:
    """Give what the kernels take: kind, parameter vector, F and Q (unused ones are small dummies)."""
    if isinstance(model, LinearModel):
        unused = np.zeros(10)
        unused.setflags(write=False)  # as those of the steering models: one compiled form for both
        return LINEAR, unused, model.transition.copy(), model.noise.copy()
    return STEERING, model.parameters, np.eye(10), np.zeros((10, 10))

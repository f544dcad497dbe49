"""The power-limited steering model as one immutable object (li2019, section III)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import ConfigError
from camnet.estimation.pls.flow import CONSTANT_TURN, POWER_LIMITED, flow
from camnet.estimation.pls.noise import process_covariance, transition
from camnet.estimation.pls.speed import compensation
from camnet.types import Array

__all__ = ["ConstantTurn", "PowerLimitedSteering", "SteeringModel"]


def _finite(name: str, value: float, positive: bool) -> float:
    if not np.isfinite(value) or value < 0.0 or (positive and value == 0.0):
        bound = "above 0" if positive else "at least 0"
        raise ConfigError(f"{name}: {value!r} is not allowed; give a finite number {bound}")
    return float(value)


@dataclass(frozen=True, eq=False)
class SteeringModel:
    """Common part of the two 10-state models: state [x (3) m, v (3) m/s, p m^2/s^3, cT (3) rad/s].

    Attributes
    ----------
    parameters : vector for the compiled kernels, see `camnet.estimation.pls.noise.PARAMETERS`
    """

    parameters: Array = field(init=False, repr=False)

    def step(self, state: ArrayLike, tau_s: float) -> Array:
        """State (10,) after ``tau_s`` with power and angular velocity held (17), (20)."""
        s = np.asarray(state, dtype=float)
        out = np.empty(10)
        par = self.parameters
        flow(int(par[0]), s, float(tau_s), par[1], par[2], out)
        return out

    def linearise(self, state: ArrayLike, tau_s: float) -> tuple[Array, Array, Array]:
        """Next state (10,), derivative Phi (10,10) and process covariance Q (10,10) of one step (21)."""
        s = np.asarray(state, dtype=float)
        out, jac, q = np.empty(10), np.empty((6, 7)), np.empty((10, 10))
        resting = transition(self.parameters, s, float(tau_s), False, out, jac)
        process_covariance(self.parameters, s, out, float(tau_s), resting, jac, q)
        phi = np.eye(10)
        phi[:6, 3:] = jac
        return out, phi, q


def _pack(model: SteeringModel, kind: int, *rest: float) -> None:
    vector = np.array([float(kind), *rest])
    vector.setflags(write=False)
    object.__setattr__(model, "parameters", vector)


def _three(name: str, value: float | tuple[float, float, float]) -> tuple[float, float, float]:
    values = np.broadcast_to(np.asarray(value, dtype=float), (3,))
    return tuple(_finite(name, float(v), True) for v in values)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class PowerLimitedSteering(SteeringModel):
    """Power-limited steering: v' = -alpha v - beta v/|v| + p v/|v|^2 + cT x v with random p and cT (14).

    Parameters
    ----------
    alpha : damping, 1/s
    beta : resistance, m/s^2
    power_density : spectral density D_A of the random power, (m^2/s^3)^2/s
    steering_density : spectral density D_T of the random angular velocity, (rad/s)^2/s; one number or one per axis
    velocity_density : isotropic density that keeps Q positive definite, (m/s)^2/s
    rest_speed : speed below which the heading is taken as undefined, m/s
    rest_density : density of the white acceleration there, (m/s)^2/s
    compensate : add the mean shift of the speed (18) to each step

    Raises
    ------
    ConfigError : a parameter is not finite or not positive
    """

    alpha: float = 0.01
    beta: float = 0.4
    power_density: float = 1e-4
    steering_density: float | tuple[float, float, float] = 5e-5
    velocity_density: float = 1e-8
    rest_speed: float = 0.05
    rest_density: float = 1e-2
    compensate: bool = False

    def __post_init__(self) -> None:
        for name in ("alpha", "beta", "power_density", "velocity_density", "rest_density"):
            _finite(name, getattr(self, name), True)
        _finite("rest_speed", self.rest_speed, False)
        densities = _three("steering_density", self.steering_density)
        _pack(
            self,
            POWER_LIMITED,
            self.alpha,
            self.beta,
            self.power_density,
            *densities,
            self.velocity_density,
            self.rest_speed,
            self.rest_density,
        )

    def step(self, state: ArrayLike, tau_s: float) -> Array:
        """State (10,) after ``tau_s``, with the compensation (19) where it is asked for."""
        s = np.asarray(state, dtype=float)
        out = super().step(s, tau_s)
        speed, after = float(np.linalg.norm(s[3:6])), float(np.linalg.norm(out[3:6]))
        if self.compensate and after > 0.0:
            shift = compensation(speed, s[6], float(tau_s), self.alpha, self.beta, self.power_density)
            out[3:6] *= max(after + shift, 0.0) / after
        return out


@dataclass(frozen=True, eq=False)
class ConstantTurn(SteeringModel):
    """Constant turn in the same ten states: the speed is held but for a white acceleration; p has no effect.

    Parameters
    ----------
    steering_density : spectral density of the angular velocity, (rad/s)^2/s
    velocity_density : spectral density of the white acceleration, (m/s)^2/s
    rest_speed, rest_density : as in `PowerLimitedSteering`
    """

    steering_density: float | tuple[float, float, float] = 5e-5
    velocity_density: float = 1e-3
    rest_speed: float = 0.05
    rest_density: float = 1e-2

    def __post_init__(self) -> None:
        _finite("velocity_density", self.velocity_density, True)
        _finite("rest_density", self.rest_density, True)
        _finite("rest_speed", self.rest_speed, False)
        densities = _three("steering_density", self.steering_density)
        _pack(
            self,
            CONSTANT_TURN,
            0.0,
            0.0,
            1e-6,
            *densities,
            self.velocity_density,
            self.rest_speed,
            self.rest_density,
        )

r"""Sharp growth of the position error while a target is unseen (the ``learned`` certificate).

| symbol | name | unit | law |
| --- | --- | --- | --- |
| phi_hat(x) = W_hat^T sigma(x) | ``PlanarField`` | m/s | learned velocity (harris2020 (3-15)) |
| mu | ``log_norm_sup`` | 1/s | sup of lambda_max((J + J^T)/2) over a disc |
| e_v | ``model_error_mps`` | m/s | sup of the model's velocity error |
| e(tau) | ``Tube.radius_m`` | m | e' <= min(mu e + e_v, v_max + norm(phi_hat)) |

The derivation is in docs/theory.md, section 8. ``e`` bounds the distance of the target from the predicted path. The
supremum is bounded rigorously: derivatives of Gaussian kernels have closed-form bounds, cells of the disc are divided
until upper and lower bound agree. The path itself is integrated by a Runge-Kutta method with step-doubling, whose
difference is added to the radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from camnet.certification.growth_kernel import disc_supremum
from camnet.certification.model_error import (
    conformal_model_error,
    extended_model_error,
    lyapunov_model_error,
)
from camnet.errors import CertificateError
from camnet.types import Array

__all__ = [
    "CUTOFF_ERROR",
    "LogNormBound",
    "PlanarField",
    "Tube",
    "conformal_model_error",
    "error_after",
    "error_tube",
    "extended_model_error",
    "largest_model_error",
    "log_norm_sup",
    "lyapunov_model_error",
]

#: value of a kernel that is taken as zero five standard deviations away
CUTOFF_ERROR = math.exp(-12.5)
#: kernels further away than this many standard deviations enter the logarithmic norm through a bound only
_FAR = 6.0


@dataclass(frozen=True, eq=False)
class PlanarField:
    """A learned planar velocity field, a weighted sum of Gaussian kernels.

    Attributes
    ----------
    centres : (p, 2) kernel centres, world frame, m
    precision : (p, 2, 2) inverse covariances, 1/m^2
    weights : (p, 2) velocity weights, m/s
    """

    centres: Array
    precision: Array
    weights: Array
    scale: Array

    @classmethod
    def create(cls, centres: ArrayLike, precision: ArrayLike, weights: ArrayLike) -> PlanarField:
        """Check shapes and copy; ``precision`` may be a scalar, (2, 2) or (p, 2, 2).

        Raises
        ------
        CertificateError
            if the shapes do not fit or a precision is not positive definite.
        """
        mu = np.array(centres, dtype=float)
        w = np.array(weights, dtype=float)
        if mu.ndim != 2 or mu.shape[1] != 2 or w.shape != mu.shape:
            raise CertificateError(
                f"centres {mu.shape}, weights {w.shape}: both must be (p, 2), position kernels only"
            )
        prec = np.array(precision, dtype=float)
        prec = np.broadcast_to(prec * np.eye(2) if prec.ndim == 0 else prec, (len(mu), 2, 2)).copy()
        values = np.linalg.eigvalsh(prec)
        if not (np.isfinite(mu).all() and np.isfinite(w).all() and (values > 0.0).all()):
            raise CertificateError("centres and weights must be finite and every precision positive definite")
        arrays = (mu, prec, w, np.sqrt(values[:, -1]))
        for array in arrays:
            array.setflags(write=False)
        return cls(*arrays)

    def velocity(self, points: ArrayLike) -> Array:
        """Velocity (..., 2) at points (..., 2), m/s."""
        delta = np.asarray(points, dtype=float)[..., None, :] - self.centres
        value = np.exp(-0.5 * np.einsum("...ki,kij,...kj->...k", delta, self.precision, delta))
        return np.asarray(value @ self.weights)

    def jacobian(self, points: ArrayLike) -> Array:
        """Jacobian (..., 2, 2), rows velocity components, 1/s."""
        delta = np.asarray(points, dtype=float)[..., None, :] - self.centres
        slope = np.einsum("kij,...kj->...ki", self.precision, delta)
        value = np.exp(-0.5 * np.einsum("...ki,...ki->...k", delta, slope))
        return np.asarray(-np.einsum("...k,ki,...kj->...ij", value, self.weights, slope))

    def slope_bound(self, points: ArrayLike, radius_m: float) -> Array:
        """Bound (...,) of the Jacobian's norm over discs about points (..., 2), 1/s.

        |J| changes by at most its derivative times the radius: second derivatives of a kernel, see ``_bend``.
        """
        delta = np.asarray(points, dtype=float)[..., None, :] - self.centres
        u = np.sqrt(np.einsum("...ki,kij,...kj->...k", delta, self.precision, delta))
        bend = self._bend(u - self.scale * radius_m)
        return np.asarray(np.linalg.norm(self.jacobian(points), 2, axis=(-2, -1)) + radius_m * bend)

    def _bend(self, away: Array) -> Array:
        """Bound (...,) of the field's second derivatives where kernel k is at least ``away`` (..., p) deviations off.

        That of a kernel is at most |P| exp(-u^2/2) max(1, u^2 - 1), with a second peak at u^2 = 3.
        """
        u2 = np.maximum(away, 0.0) ** 2
        decay = np.exp(-0.5 * u2) * np.maximum(1.0, u2 - 1.0)
        decay = np.where(u2 < 3.0, np.maximum(decay, 2.0 * math.exp(-1.5)), decay)
        return np.asarray(decay @ (self.scale**2 * np.linalg.norm(self.weights, axis=1)))

    @property
    def cutoff_error_mps(self) -> float:
        """Bound of what an evaluation that skips far kernels leaves out, m/s."""
        return float(CUTOFF_ERROR * np.linalg.norm(self.weights, axis=1).sum())

    def _path_reach(self, point: Array, step_s: float) -> float:
        """Return a distance that the path from ``point`` cannot exceed within ``step_s``, m."""
        speed = float(np.linalg.norm(self.velocity(point)))
        slope = float(np.linalg.norm(self.jacobian(point), 2))
        limit = 4.0 * step_s * speed + 1e-6  # the path is followed up to here at most
        delta = point - self.centres
        away = np.sqrt(np.einsum("ki,kij,kj->k", delta, self.precision, delta)) - self.scale * limit
        bend = float(self._bend(away))
        reach = 1.05 * step_s * speed + 1e-12
        while reach <= limit:
            if step_s * (speed + slope * reach + 0.5 * bend * reach**2) <= reach:
                return reach
            reach *= 1.25
        raise CertificateError(f"step {step_s!r} s is too long for a field this steep: take a shorter one")


@dataclass(frozen=True, slots=True)
class LogNormBound:
    """Bounds of the supremum of the logarithmic norm over a disc, 1/s, and the number of cells looked at."""

    upper: float
    lower: float
    cells: int


def log_norm_sup(
    field: PlanarField, centre: ArrayLike, radius_m: float, tolerance: float = 2e-3, max_cells: int = 4000
) -> LogNormBound:
    """Bound sup lambda_max((J + J^T)/2) over a disc; ``upper`` is valid even when ``max_cells`` stops the search."""
    c = np.asarray(centre, dtype=float)
    delta = c - field.centres
    away = np.sqrt(np.einsum("ki,kij,kj->k", delta, field.precision, delta)) - field.scale * radius_m
    near = away < _FAR
    # |S| of a kernel is at most |w| |P|^(1/2) u exp(-u^2/2), which falls beyond u = 1
    rest = (
        float(np.linalg.norm(field.weights[~near], axis=1) @ field.scale[~near])
        * _FAR
        * math.exp(-0.5 * _FAR**2)
    )
    upper, lower, cells = disc_supremum(
        c[0],
        c[1],
        radius_m,
        field.centres[near],
        field.precision[near],
        field.weights[near],
        field.scale[near],
        tolerance,
        max_cells,
    )
    return LogNormBound(float(upper) + rest, float(lower) - rest, int(cells))


def error_after(mu: float, e0_m: float, model_error_mps: float, apart_mps: float, t_s: float) -> float:
    """Return the error's bound after ``t_s`` for a constant logarithmic norm, m.

    ``apart_mps`` bounds the sum of the speeds of target and prediction; infinite where the prediction has no bound.
    """
    growth = math.expm1(min(mu * t_s, 700.0))
    driven = model_error_mps * (growth / mu if abs(mu) * t_s > 1e-12 else t_s)
    return min(e0_m * (1.0 + growth) + driven, e0_m + (apart_mps * t_s if t_s > 0.0 else 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class Tube:
    """Predicted path with the radius that the target cannot leave.

    Attributes
    ----------
    t_s : (n,) time since the target was lost, s
    centre_m : (n, 2) predicted position
    radius_m : (n,) bound of the position error
    mu_per_s : (n - 1,) bound of the logarithmic norm on each step
    """

    t_s: Array
    centre_m: Array
    radius_m: Array
    mu_per_s: Array

    def trust_horizon_s(self, allowed_m: float) -> float:
        """Time until which the radius stays within ``allowed_m``, s (the tube's end if it always does)."""
        beyond = np.flatnonzero(self.radius_m > allowed_m)
        return float(self.t_s[-1] if len(beyond) == 0 else 0.0 if beyond[0] == 0 else self.t_s[beyond[0] - 1])


def error_tube(
    field: PlanarField,
    start: ArrayLike,
    e0_m: float,
    model_error_mps: float,
    v_max_mps: float,
    horizon_s: float,
    step_s: float = 0.1,
    tolerance: float = 2e-3,
    stop_radius_m: float = math.inf,
    max_cells: int = 2000,
    least_mu: float = -math.inf,
) -> Tube:
    """Propagate the bound e' <= min(mu e + e_v, v_max + norm(phi_hat)) along the predicted path.

    Nothing limits the prediction's speed but the learned field itself, so that its own speed along the path counts.

    Parameters
    ----------
    field : learned velocity field
    start : (2,) predicted position when the target is lost, m
    e0_m : bound of its error
    model_error_mps : e_v, valid wherever the tube goes
    v_max_mps : bound of the target's speed
    horizon_s, step_s : length and step
    tolerance : of the logarithmic norm, 1/s
    stop_radius_m : the tube ends once its radius exceeds this
    max_cells : effort of each step's bound; fewer cells make a wider, still valid, tube
    least_mu : the logarithmic norm is taken as no smaller, 1/s; 0 where e_v is the growth of errors at gaps' ends

    Returns
    -------
    Tube
    """
    steps = max(1, math.ceil(horizon_s / step_s - 1e-9))
    h = horizon_s / steps
    e_v = model_error_mps + field.cutoff_error_mps
    path, radius = [np.array(start, dtype=float)], [float(e0_m)]
    mus: list[float] = []
    for _ in range(steps):
        p, e = path[-1], radius[-1]
        reach = field._path_reach(p, h)
        previous = mus[-1] if mus else 0.0
        apart = v_max_mps + reach / h
        mu = _step_norm(field, p, e, e_v, apart, h, reach, previous, tolerance, max_cells)
        mu = max(mu, least_mu)
        after, slip = _step(field, p, h)
        path.append(after)
        radius.append(error_after(mu, e, e_v, apart, h) + slip)
        mus.append(mu)
        if radius[-1] > stop_radius_m:
            break
    n = len(path)
    return Tube(h * np.arange(n, dtype=float), np.array(path), np.array(radius), np.array(mus))


def _step_norm(
    field: PlanarField,
    p: Array,
    e: float,
    e_v: float,
    apart_mps: float,
    h: float,
    reach: float,
    previous: float,
    tolerance: float,
    max_cells: int,
) -> float:
    """Bound the logarithmic norm on a disc that holds every segment from path to target during a step.

    A disc that allows the error a little growth is tried first: if the bound that follows stays within it, the error
    cannot have left it (it would have to pass through). Otherwise the disc of the speed bound is taken.
    """
    guess = 1.02 * max(e, error_after(previous + 10.0 * tolerance, e, e_v, apart_mps, h)) + 1e-6
    allowed = e + apart_mps * h
    if guess < allowed:
        mu = log_norm_sup(field, p, guess + reach, tolerance, max_cells).upper
        if error_after(mu, e, e_v, apart_mps, h) <= guess:
            return mu
    return log_norm_sup(field, p, allowed + reach, tolerance, max_cells).upper


def _step(field: PlanarField, p: Array, h: float) -> tuple[Array, float]:
    """Advance the path by two half steps; return it and its distance from one whole step."""
    whole = _runge_kutta(field, p, h)
    half = _runge_kutta(field, _runge_kutta(field, p, 0.5 * h), 0.5 * h)
    return half, float(np.linalg.norm(half - whole))


def _runge_kutta(field: PlanarField, p: Array, h: float) -> Array:
    k1 = field.velocity(p)
    k2 = field.velocity(p + 0.5 * h * k1)
    k3 = field.velocity(p + 0.5 * h * k2)
    k4 = field.velocity(p + h * k3)
    return np.asarray(p + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))


def largest_model_error(
    certified: Callable[[float], bool], upper_mps: float, tolerance_mps: float = 1e-4
) -> float | None:
    """Return the largest e_v for which ``certified`` holds (it must be monotone), or None if none does, m/s."""
    if not certified(0.0):
        return None
    if certified(upper_mps):
        return upper_mps
    low, high = 0.0, upper_mps
    while high - low > tolerance_mps:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if certified(middle) else (low, middle)
    return low

"""Gaussian radial basis functions sigma(rho(eta)) of a target's pose (parikh2018, section VII; harris2020 (3-2)).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| mu_k | ``centres`` | (p, d) | m |
| Sigma_k^-1 | ``precision`` | (p, d, d) | 1/m^2 |
| rho(eta) | ``inputs`` | (d,) | m |

``sigma_k(x) = exp(-1/2 (x - mu_k)^T Sigma_k^-1 (x - mu_k))``. The input rho is the world position in the ground plane
(d = 2), or that and the heading on a circle of radius ``heading_scale_m`` (d = 4). A kernel further than five standard
deviations away is taken as zero: that is an error of 4e-6, and it lets evaluation skip most kernels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.compiled import cached_njit
from camnet.errors import ConfigError
from camnet.types import Array

__all__ = ["CUTOFF", "RbfBasis", "evaluate", "evaluate_reference", "map_inputs"]

#: squared Mahalanobis distance beyond which a kernel is zero
CUTOFF = 25.0


@dataclass(frozen=True, eq=False, slots=True)
class RbfBasis:
    """A set of p Gaussian kernels.

    Attributes
    ----------
    centres : (p, d), d = 2 (position) or 4 (position and scaled heading), m
    precision : (p, d, d) inverse covariance of each kernel, 1/m^2
    heading_scale_m : radius of the heading circle, m; unused for d = 2
    """

    centres: Array
    precision: Array
    heading_scale_m: float

    @classmethod
    def create(cls, centres: Array, covariance: Array | float, heading_scale_m: float = 1.0) -> RbfBasis:
        """Kernels at ``centres`` (p, d) with one covariance (scalar or (d, d)) or one for each kernel (p, d, d), m^2.

        Raises
        ------
        ConfigError
            If the shapes do not fit, a value is not finite or a covariance is not positive definite.
        """
        centres = np.array(centres, dtype=float)
        if centres.ndim != 2 or centres.shape[0] == 0 or centres.shape[1] not in (2, 4):
            raise ConfigError(f"basis centres: shape {centres.shape}, expected (p, 2) or (p, 4) with p >= 1")
        p, d = centres.shape
        cov = np.asarray(covariance, dtype=float)
        cov = cov * np.eye(d) if cov.ndim == 0 else cov
        if cov.shape not in ((d, d), (p, d, d)):
            raise ConfigError(
                f"basis covariance: shape {cov.shape}, expected scalar, {(d, d)} or {(p, d, d)}"
            )
        cov = np.array(np.broadcast_to(cov, (p, d, d)))
        if not (np.isfinite(centres).all() and np.isfinite(cov).all()):
            raise ConfigError("basis: centres and covariance must be finite")
        if np.linalg.eigvalsh(cov).min() <= 0.0:
            raise ConfigError("basis covariance: every kernel's covariance must be positive definite")
        precision = np.ascontiguousarray(np.linalg.inv(cov))
        for array in (centres, precision):
            array.setflags(write=False)
        return cls(centres, precision, float(heading_scale_m))

    @property
    def size(self) -> int:
        """Number of kernels p."""
        return int(self.centres.shape[0])

    def __call__(self, p_world: Array, q_world: Array) -> Array:
        """Sigma (p,) at a pose: position (3,) and quaternion (4,), both in the world frame."""
        sigma = np.empty(self.size)
        evaluate(p_world, q_world, self.centres, self.precision, self.heading_scale_m, sigma)
        return sigma


@cached_njit
def map_inputs(p: Array, q: Array, d: int, heading_scale: float) -> Array:
    """Rho: (x, y), and for d = 4 the direction of the body x axis seen from above, scaled."""
    x = np.empty(d)
    x[0] = p[0]
    x[1] = p[1]
    if d == 4:
        cx = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
        cy = 2.0 * (q[1] * q[2] + q[0] * q[3])
        norm = math.sqrt(cx * cx + cy * cy)
        scale = heading_scale / norm if norm > 1e-12 else 0.0
        x[2] = scale * cx
        x[3] = scale * cy
    return x


@cached_njit
def evaluate(p: Array, q: Array, centres: Array, precision: Array, heading_scale: float, out: Array) -> None:
    """Write sigma (p,) at the pose (p (3,), q (4,)) to ``out``."""
    n, d = centres.shape
    x = map_inputs(p, q, d, heading_scale)
    for k in range(n):
        quad = 0.0
        if d == 2:
            e0 = x[0] - centres[k, 0]
            e1 = x[1] - centres[k, 1]
            quad = (
                e0 * e0 * precision[k, 0, 0]
                + e1 * e1 * precision[k, 1, 1]
                + e0 * e1 * (precision[k, 0, 1] + precision[k, 1, 0])
            )
        else:
            for i in range(d):
                ei = x[i] - centres[k, i]
                for j in range(d):
                    quad += ei * precision[k, i, j] * (x[j] - centres[k, j])
        out[k] = math.exp(-0.5 * quad) if quad < CUTOFF else 0.0


def evaluate_reference(basis: RbfBasis, p: Array, q: Array) -> Array:
    """Readable twin of ``evaluate``: sigma (p,) without the cut-off."""
    x = map_inputs.py_func(p, q, basis.centres.shape[1], basis.heading_scale_m)
    e = x - basis.centres
    return np.asarray(np.exp(-0.5 * np.einsum("ki,kij,kj->k", e, basis.precision, e)))

"""Checks of the observations at the border of the estimators."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from camnet.compiled import cached_njit
from camnet.errors import DataError
from camnet.types import Array

__all__ = ["check_observations", "sound"]

_NO_OBS = np.zeros((0, 3))
_NO_COV = np.zeros((0, 3, 3))


@cached_njit(error_model="numpy")
def sound(obs: Array, cov: Array) -> bool:
    """Whether all values are finite and every covariance (m,3,3) is symmetric positive definite."""
    for k in range(obs.shape[0]):
        a = cov[k]
        for i in range(3):
            if not math.isfinite(obs[k, i]):
                return False
            for j in range(3):
                if not abs(a[i, j] - a[j, i]) <= 1e-9 * abs(a[i, i]) + 1e-300 or not math.isfinite(a[i, j]):
                    return False
        minor = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
        det = (
            a[2, 2] * minor
            - a[0, 0] * a[1, 2] * a[1, 2]
            - a[1, 1] * a[0, 2] * a[0, 2]
            + 2.0 * a[0, 1] * a[0, 2] * a[1, 2]
        )
        if not (a[0, 0] > 0.0 and minor > 0.0 and det > 0.0):
            return False
    return True


def check_observations(observations: ArrayLike, covariances: ArrayLike) -> tuple[Array, Array]:
    """Observations (m,3) and covariances (m,3,3) as arrays; m = 0 in any empty form.

    Raises
    ------
    DataError : shapes do not fit, a value is not finite, or a covariance is not symmetric positive definite
    """
    obs = np.ascontiguousarray(observations, dtype=float)
    cov = np.ascontiguousarray(covariances, dtype=float)
    if obs.size == 0:
        return _NO_OBS, _NO_COV
    if obs.ndim != 2 or obs.shape[1] != 3:
        raise DataError(f"observations: shape {obs.shape} does not fit; give positions (m,3)")
    if cov.shape != (len(obs), 3, 3):
        raise DataError(f"covariances: shape {cov.shape} does not fit {len(obs)} observations; give (m,3,3)")
    if not sound(obs, cov):
        raise DataError(
            f"observations {obs.tolist()!r}, covariances {cov.tolist()!r}: give finite positions and symmetric "
            "positive definite covariances"
        )
    return obs, cov

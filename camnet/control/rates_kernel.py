"""Rotation rates of N bodies between two instants, compiled; `camnet.geometry.rotations` is the readable form."""

from __future__ import annotations

import numpy as np
from numba import njit

from camnet.geometry.rotations_compiled import conjugate, log, multiply, rotate
from camnet.types import Array

__all__ = ["mean_rates", "row_norms", "turn_between"]


@njit(cache=True)
def mean_rates(q0: Array, q1: Array, dt: float) -> Array:
    """Constant rates (N,3) in rad/s, body frame, that turn ``q0`` (N,4) into ``q1`` (N,4) in ``dt``."""
    out = np.empty((q0.shape[0], 3))
    for i in range(q0.shape[0]):
        out[i] = log(multiply(conjugate(q0[i]), q1[i])) / dt
    return out


@njit(cache=True)
def turn_between(q_to: Array, q_from: Array, v: Array) -> Array:
    """Vectors (N,3) given in the frames ``q_from`` (N,4), in the frames ``q_to`` (N,4)."""
    out = np.empty((v.shape[0], 3))
    for i in range(v.shape[0]):
        out[i] = rotate(multiply(conjugate(q_to[i]), q_from[i]), v[i])
    return out


@njit(cache=True)
def row_norms(v: Array) -> Array:
    """Norms (N,) of the rows of ``v`` (N,k)."""
    out = np.empty(v.shape[0])
    for i in range(v.shape[0]):
        out[i] = np.sqrt(np.sum(v[i] * v[i]))
    return out

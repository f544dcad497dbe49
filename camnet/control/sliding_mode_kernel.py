"""Compiled twin of `camnet.control.sliding_mode.control_numpy` (its test oracle): all cameras in one call."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.geometry.rotations_compiled import conjugate, log, multiply, rotate_inverse
from camnet.types import Array

__all__ = ["SWITCHING_CODE", "control_compiled"]

#: number of each switching function in the kernel
SWITCHING_CODE = {"sign": 0, "sat": 1, "tanh": 2}


@njit(cache=True)
def _switch(e: float, code: int, layer: float) -> float:
    if code == 0:
        return float(np.sign(e))
    if code == 1:
        return min(max(e / layer, -1.0), 1.0)
    return math.tanh(e / layer)


@njit(cache=True)
def control_compiled(
    p: Array, q: Array, p_d: Array, q_d: Array, v_d: Array, w_d: Array, gains: Array, code: int
) -> Array:
    """u_l, u_a, e_l, e_a as (4,N,3); ``gains`` is k1, d_bar (linear), d_bar (angular), boundary layer."""
    k1, d_linear, d_angular, layer = gains[0], gains[1], gains[2], gains[3]
    out = np.empty((4, p.shape[0], 3))
    for n in range(p.shape[0]):
        q_error = multiply(conjugate(q_d[n]), q[n])
        e_a = log(q_error)
        feedforward = rotate_inverse(q_error, w_d[n])
        for i in range(3):
            e_l = p[n, i] - p_d[n, i]  # (4-3)
            out[0, n, i] = v_d[n, i] - k1 * e_l - d_linear * _switch(e_l, code, layer)  # (4-6)
            out[1, n, i] = feedforward[i] - k1 * e_a[i] - d_angular * _switch(e_a[i], code, layer)  # (4-6)
            out[2, n, i], out[3, n, i] = e_l, e_a[i]
    return out

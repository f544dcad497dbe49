"""Compiled twin of `camnet.control.sliding_mode.control_numpy` (its test oracle): all cameras in one call."""

from __future__ import annotations

import math

import numpy as np

from camnet.geometry.triples import borrowing, conjugate, log, multiply, quaternion, rotate_inverse, triple
from camnet.types import Array

__all__ = ["SWITCHING_CODE", "command_all", "control_compiled"]

#: number of each switching function in the kernel
SWITCHING_CODE = {"sign": 0, "sat": 1, "tanh": 2}


@borrowing
def _switch(e: float, code: int, layer: float) -> float:
    if code == 0:
        return 1.0 if e > 0.0 else (-1.0 if e < 0.0 else e)
    if code == 1:
        return min(max(e / layer, -1.0), 1.0)
    return math.tanh(e / layer)


@borrowing
def command_all(cameras: Array, first: int, rows: Array, gains: Array, code: int, out: Array) -> None:
    """Write u_l, u_a, e_l, e_a to ``out`` (4,N,3).

    ``cameras`` hold p (3), q (4) from row ``first`` on; ``rows`` (N,20) are references as in
    `camnet.control.reference_kernel.move_all`; ``gains`` is k1, d_bar (linear), d_bar (angular), boundary layer.
    """
    k1, d_linear, d_angular, layer = gains[0], gains[1], gains[2], gains[3]
    for n in range(rows.shape[0]):
        q_error = multiply(conjugate(quaternion(rows, n, 13)), quaternion(cameras, first + n, 3))
        e_a = log(q_error)
        feedforward = rotate_inverse(q_error, triple(rows, n, 17))
        for i in range(3):
            e_l = cameras[first + n, i] - rows[n, i]  # (4-3)
            out[0, n, i] = rows[n, 3 + i] - k1 * e_l - d_linear * _switch(e_l, code, layer)  # (4-6)
            out[1, n, i] = feedforward[i] - k1 * e_a[i] - d_angular * _switch(e_a[i], code, layer)  # (4-6)
            out[2, n, i], out[3, n, i] = e_l, e_a[i]


def control_compiled(
    p: Array, q: Array, p_d: Array, q_d: Array, v_d: Array, w_d: Array, gains: Array, code: int
) -> Array:
    """u_l, u_a, e_l, e_a as (4,N,3), from poses and references one by one."""
    out = np.empty((4, p.shape[0], 3))
    rows = np.zeros((p.shape[0], 20))
    rows[:, 0:3], rows[:, 3:6], rows[:, 13:17], rows[:, 17:20] = p_d, v_d, q_d, w_d
    command_all(np.hstack([p, q]), 0, rows, gains, code, out)
    return out

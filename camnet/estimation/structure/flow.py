"""Optical flow with the camera's turning taken out, over a short window (bell2019, section 3.2).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``h`` | ``flow_s`` | | s | window, from image a to image b |
| ``R_ba`` | | (3, 3) | - | camera frame at a to camera frame at b, by the gyro |
| ``xi`` | ``xi`` | (N, 3) | 1/s | ``(u_b - R_ba u_a) / h``, in the camera frame at b |
| ``rho`` | ``rho`` | (N, 3) | m/s | ``R_bm (u_m u_m^T - I) v_m`` at the middle image m |
| ``d_m - d_b`` | ``lag_m`` | (N,) | m | ``int_m^b u^T v``: the distance at the middle, from the present one |

``xi d_m = rho`` holds to the second order of h. A derivative over one frame would carry the noise of ``xi^T xi`` (0.5
pixels at 30 Hz are as large as the flow of a point 3 m away), which pulls every estimate towards zero distance.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from camnet.estimation.structure.key_view import KeyView
from camnet.estimation.structure.rates import translational_flow
from camnet.geometry.rotations import IDENTITY, conjugate, exp, multiply, to_matrix
from camnet.types import Array

__all__ = ["Flow", "FlowWindow"]


@dataclass(frozen=True, eq=False, slots=True)
class Flow:
    """See the module's table; NaN for features that were not seen at both ends and in the middle."""

    xi: Array
    rho: Array
    lag_m: Array


@dataclass(frozen=True, eq=False, slots=True)
class _Past:
    t_s: float
    q: Array
    u: Array
    v: Array
    travelled: Array


class FlowWindow:
    """Keeps the views of the last ``flow_s`` seconds."""

    def __init__(self, flow_s: float) -> None:
        self._h = flow_s
        self._past: deque[_Past] = deque()
        self._q = IDENTITY.copy()  # camera frame to that of the first view

    def update(self, view: KeyView, travelled: Array) -> Flow | None:
        """Take one view; ``travelled`` (N,) is ``int -u^T v`` since the one before. None until a window is full."""
        past = self._past
        total = travelled + (past[-1].travelled if past else 0.0)
        self._q = multiply(self._q, exp(view.dt_s * view.w_cam))
        past.append(_Past(view.t_s, self._q, view.u_ic, view.v_cam, total))
        while len(past) > 2 and past[-1].t_s - past[1].t_s >= self._h - 1e-9:
            past.popleft()
        a, b = past[0], past[-1]
        if b.t_s - a.t_s < self._h - 1e-9:
            return None
        m = past[len(past) // 2]
        to_b = conjugate(b.q)
        r_ba, r_bm = to_matrix(multiply(to_b, a.q)), to_matrix(multiply(to_b, m.q))
        xi = (b.u - a.u @ r_ba.T) / (b.t_s - a.t_s)
        return Flow(xi, translational_flow(m.u, m.v) @ r_bm.T, m.travelled - b.travelled)

"""Sliding-mode control of a camera's six degrees of freedom: harris2020, section 4.1, eqs. (4-3)-(4-7), (4-27).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| p_c, p_cd | `p_world`, `reference.p_world` | (N,3) | m | (4-1) |
| q_c, q_cd | `q_world`, `reference.q_world` (camera to world) | (N,4) | - | (4-1) |
| e_l | `e_linear` = p_c - p_cd | (N,3) | m | (4-3) |
| phi | `e_angular` = log(q_cd^-1 q_c), rotation vector, camera frame | (N,3) | rad | replaces q in (4-3) |
| u_l, u_a | `CameraControl.v_world`, `w_cam` | (N,3) | m/s, rad/s | (4-6) |
| k1, d_bar | gains | | 1/s; m/s, rad/s | (4-6) |

Departure from (4-6) as printed. It asks for ``1/2 B(q) u_a = q_cd' - k1 (q - q_cd) - d_bar sgn(q - q_cd)``: four
equations for three unknowns. The left side is tangent to the unit sphere at q and the right side is not, so no
u_a solves it; its projection ``u_a = 2 B(q)^T (...)`` loses (4-27), since ``|B^T (q - q_cd)| = sin(theta/2)`` is less
than ``|q - q_cd| = 2 sin(theta/4)``, and q and -q would give two different commands. Here the error is the rotation
vector phi of ``q_e = q_cd^-1 q_c``, which no sign of q changes. With ``R_e = R(q_e)`` and J_r the right Jacobian,
``phi' = J_r(phi)^-1 (w_c - R_e^T w_cd)`` and ``phi^T J_r^-1 = phi^T``, hence for

    u_a = R_e^T w_cd - k1 phi - d_bar sgn(phi)

``d/dt |phi|^2/2 = -k1 |phi|^2 + phi^T d - d_bar |phi|_1 <= -k1 |phi|^2`` while ``|d| <= d_bar``: exactly the decay
of (4-27), for every error short of half a turn. The two d_bar (linear, angular) bound the Euclidean norms of d_l
and d_a apart, where Assumption 4.3 bounds their stack.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from camnet.control.settings import ControllerSettings
from camnet.control.sliding_mode_kernel import SWITCHING_CODE, control_compiled
from camnet.geometry.rotations import conjugate, log, multiply, rotate
from camnet.types import Array

__all__ = [
    "CameraControl",
    "Reference",
    "SlidingModeController",
    "pose_error",
    "switching_function",
    "switching_loss",
]

Switching = Literal["sign", "sat", "tanh"]


@dataclass(frozen=True, eq=False, slots=True)
class Reference:
    """Desired motion of N cameras, at least C1 (Assumption 4.1).

    Attributes
    ----------
    p_world, q_world : (N,3) m, (N,4) camera to world
    v_world : (N,3) velocity of ``p_world``, m/s
    w_cam : (N,3) angular velocity of ``q_world`` in the desired camera frame, rad/s
    a_world : (N,3) acceleration, m/s^2: not part of (4-6), a feedforward for the inner loop
    """

    p_world: Array
    q_world: Array
    v_world: Array
    w_cam: Array
    a_world: Array


@dataclass(frozen=True, eq=False, slots=True)
class CameraControl:
    """Command with its feedforward, the errors it answers, all (N,3): m/s, rad/s, m/s^2, m, rad; the reference."""

    v_world: Array
    w_cam: Array
    a_world: Array
    e_linear: Array
    e_angular: Array
    reference: Reference


def switching_function(kind: Switching, layer: float) -> Callable[[Array], Array]:
    """``sgn``, or its smooth stand-ins of boundary layer ``layer``: ``clip(e/layer, -1, 1)``, ``tanh(e/layer)``."""
    if kind == "sign":
        return np.sign
    if kind == "sat":
        return lambda e: np.minimum(np.maximum(e / layer, -1.0), 1.0)
    return lambda e: np.tanh(e / layer)


def switching_loss(kind: Switching, layer: float) -> float:
    """Supremum over e >= 0 of ``e - e s(e)``: what the boundary layer gives away, per component.

    ``sat``: e (1 - e/layer) peaks at layer/2. ``tanh``: x (1 - tanh x) peaks at x = 0.6392, value 0.27846.
    """
    return {"sign": 0.0, "sat": 0.25, "tanh": 0.27847}[kind] * layer


def pose_error(p_world: Array, q_world: Array, reference: Reference) -> tuple[Array, Array, Array]:
    """Linear error (N,3), angular error (N,3), and the error quaternion ``q_cd^-1 q_c`` (N,4)."""
    q_error = multiply(conjugate(reference.q_world), q_world)
    return p_world - reference.p_world, log(q_error), q_error  # (4-3)


def control_numpy(
    settings: ControllerSettings, p_world: Array, q_world: Array, reference: Reference
) -> CameraControl:
    """Evaluate the law (4-6), readable; `SlidingModeController` runs the compiled twin."""
    k1, switch = settings.k1_per_s, switching_function(settings.switching, settings.boundary_layer)
    e_l, e_a, q_error = pose_error(p_world, q_world, reference)
    feedforward = rotate(conjugate(q_error), reference.w_cam)  # w_cd in the camera frame
    u_l = reference.v_world - k1 * e_l - settings.d_bar_mps * switch(e_l)  # (4-6)
    u_a = feedforward - k1 * e_a - settings.d_bar_radps * switch(e_a)  # (4-6), see the module's text
    return CameraControl(u_l, u_a, reference.a_world, e_l, e_a, reference)


class SlidingModeController:
    """The law (4-6) for N cameras at once; ``settings`` chooses gains and the switching function."""

    def __init__(self, settings: ControllerSettings) -> None:
        s = settings
        self._gains = np.array([s.k1_per_s, s.d_bar_mps, s.d_bar_radps, s.boundary_layer])
        self._code = SWITCHING_CODE[s.switching]

    @property
    def packed(self) -> tuple[Array, int]:
        """Gains and switching function, as `camnet.control.sliding_mode_kernel` takes them."""
        return self._gains, self._code

    def control(self, p_world: Array, q_world: Array, reference: Reference) -> CameraControl:
        """Velocity commands for cameras at ``p_world`` (N,3), ``q_world`` (N,4, either sign)."""
        r = reference
        desired = (r.p_world, r.q_world, r.v_world, r.w_cam)
        u_l, u_a, e_l, e_a = control_compiled(p_world, q_world, *desired, self._gains, self._code)
        return CameraControl(u_l, u_a, r.a_world, e_l, e_a, r)

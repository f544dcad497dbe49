"""One step of the estimator with the target in view, in world or in camera-relative coordinates.

parikh2018 (7); harris2020 (3-8), (4-16): ``eta_hat' = G W^T sigma + f + k1 eta_til + k2 sgn(eta_til)``. The model's
twist is taken as constant over the step; f = 0 in the world frame and as in ``frames`` in the relative one. Results are
world poses either way, together with the error in the coordinates in which it was formed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camnet.estimation.concurrent_learning import SWITCHING, correct_pose, output_error
from camnet.estimation.frames import known_part_world_axes
from camnet.estimation.settings import EstimatorSettings
from camnet.geometry.rotations_compiled import align_sign, conjugate, multiply, normalise
from camnet.types import Array, CameraMotion

__all__ = ["FEEDBACK", "Feedback", "PoseState", "relative_feedback", "world_feedback"]


@dataclass(frozen=True, eq=False, slots=True)
class PoseState:
    """World pose p (3,), q (4,) and the output error G^T eta_til (8,) of the step that led to it."""

    p: Array
    q: Array
    error: Array
    residual_m: float


#: (p, q, twist (6,), dt, measured p, measured q, camera before, camera now, settings) -> new state
Feedback = Callable[
    [Array, Array, Array, float, Array, Array, CameraMotion, CameraMotion, EstimatorSettings], PoseState
]


def _rate_of(q: Array, w: Array) -> Array:
    """Return 1/2 B(q) w (4,)."""
    return np.asarray(0.5 * multiply(q, np.array([0.0, w[0], w[1], w[2]])))


def _correct(p: Array, q: Array, p_meas: Array, q_meas: Array, dt: float, s: EstimatorSettings) -> PoseState:
    p_new, q_new, error = correct_pose(
        p, q, p_meas, q_meas, s.k1_per_s, s.k2, SWITCHING[s.switching], s.boundary_layer, dt
    )
    at = align_sign(q_meas, q)
    residual = float(np.sqrt(error[0:3] @ error[0:3]))
    return PoseState(p_new, q_new, output_error(error, at, s.form == "stacked"), residual)


def world_feedback(
    p: Array,
    q: Array,
    twist: Array,
    dt: float,
    p_meas: Array,
    q_meas: Array,
    before: CameraMotion,
    now: CameraMotion,
    settings: EstimatorSettings,
) -> PoseState:
    """State held in the world frame: f = 0."""
    q_next = normalise(q + dt * _rate_of(q, twist[3:6]))
    return _correct(p + dt * twist[0:3], q_next, p_meas, q_meas, dt, settings)


def relative_feedback(
    p: Array,
    q: Array,
    twist: Array,
    dt: float,
    p_meas: Array,
    q_meas: Array,
    before: CameraMotion,
    now: CameraMotion,
    settings: EstimatorSettings,
) -> PoseState:
    """State held relative to the camera, position in world axes: f from the camera's measured velocity."""
    q_rel = multiply(conjugate(before.q_world), q)
    w_cam = 0.5 * (before.w_cam + now.w_cam)
    f = known_part_world_axes(q_rel, 0.5 * (before.v_world + now.v_world), w_cam)
    p_rel = p - before.p_world + dt * (twist[0:3] + f[0:3])
    q_rel = normalise(q_rel + dt * (_rate_of(q_rel, twist[3:6]) + f[3:7]))
    q_meas_rel = multiply(conjugate(now.q_world), q_meas)
    state = _correct(p_rel, q_rel, p_meas - now.p_world, q_meas_rel, dt, settings)
    return PoseState(state.p + now.p_world, multiply(now.q_world, state.q), state.error, state.residual_m)


#: by the settings' ``frame``
FEEDBACK: dict[str, Feedback] = {"world": world_feedback, "relative": relative_feedback}

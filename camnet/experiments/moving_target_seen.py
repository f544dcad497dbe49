"""Errors while the target is in view: the causal filter's, and those of the velocity that the paper computes.

The paper's velocity ``chi^+ phi d + v_c`` (section 5.2) is given the best inputs that the images allow: rotation and
``u_{m/m}`` from the pose on the learned structure, and directions and quaternions differentiated over a second
(quadratic fits). It is stated where ``1 - |u_1^T u_m|`` exceeds ``lambda_v``, as published (corrected) and as printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from camnet.estimation.structure.geometry import distance_ratios, unit, velocity_excitation
from camnet.estimation.structure.moving.relations import (
    angular_velocity,
    lever_position,
    velocity_by_directions,
)
from camnet.estimation.structure.moving.twist_filter import TwistState
from camnet.estimation.structure.rates import optical_flow
from camnet.experiments.moving_target_run import TO_SCENE, Learned, SceneTracks, heading_error, scene_truth
from camnet.experiments.moving_target_scene import MovingScene, MovingSetUp
from camnet.geometry.rotations import conjugate, multiply, rotate, to_matrix
from camnet.types import Array, BoolArray, IntArray

__all__ = ["SeenErrors", "seen_errors"]

#: the filter's first instants after a re-sighting, in which it finds the velocity, are not counted, s
SETTLE_S = 2.0
LAMBDA_V = 0.02
_HALF_S = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class SeenErrors:
    """Errors at the instants counted (K,): position m, velocity m/s, heading rad, and the target's range, m.

    ``chi``, ``chi_printed`` (J,): velocity errors, m/s, where chi's condition holds; ``chi_share`` of the instants.
    """

    position: Array
    velocity: Array
    heading: Array
    range_m: Array
    chi: Array
    chi_printed: Array
    chi_share: float


def seen_errors(
    setup: MovingSetUp,
    scene: MovingScene,
    learned: Learned,
    tracks: SceneTracks,
    parts: Sequence[tuple[list[TwistState], list[TwistState]]],
) -> SeenErrors:
    """Errors of one run, from the time at which the target has begun to move."""
    relative, turn, v_true = scene_truth(scene)
    rows: list[tuple[float, float, float, float]] = []
    counted = np.zeros(len(scene.t_s), dtype=bool)
    for filtered, _ in parts:
        for s in filtered:
            if s.t_s < max(setup.rest_s, filtered[0].t_s) + SETTLE_S:
                continue
            k = int(np.searchsorted(scene.t_s, s.t_s - 1e-9))
            counted[k] = True
            rows.append(
                (
                    float(np.linalg.norm(s.p - tracks.p_camera[k] - relative[k])),
                    float(np.linalg.norm(s.v_scene - v_true[k])),
                    float(heading_error(s.q, turn[k])),
                    float(np.linalg.norm(relative[k])),
                )
            )
    position, velocity, heading, away = np.array(rows).T
    chi, printed, share = _by_directions(setup, scene, learned, tracks, counted)
    return SeenErrors(position, velocity, heading, away, chi, printed, share)


def _by_directions(
    setup: MovingSetUp, scene: MovingScene, learned: Learned, tracks: SceneTracks, counted: BoolArray
) -> tuple[Array, Array, float]:
    """Errors of the velocity of feature m1 by chi, corrected and as printed, and the share of instants with one."""
    dt = 1.0 / setup.frame_hz
    length = 2 * round(_HALF_S * setup.frame_hz) + 1
    good = np.flatnonzero(np.isfinite(tracks.p[:, 0]))
    errors: tuple[list[Array], list[Array]] = ([], [])
    for part in np.split(good, np.flatnonzero(np.diff(good) > 1) + 1):
        if len(part) <= length:
            continue
        mine = counted[part]
        v = _velocities(scene, learned, tracks, part, length, dt)
        for out, (estimate, valid) in zip(errors, v, strict=True):
            v_true = _feature_velocity(scene, part)
            out.append(np.linalg.norm(estimate - v_true, axis=1)[mine & valid])
    corrected, printed = (np.concatenate(e) if e else np.empty(0) for e in errors)
    return corrected, printed, len(corrected) / max(int(counted.sum()), 1)


def _feature_velocity(scene: MovingScene, part: IntArray) -> Array:
    """Return the true velocity (K, 3) of feature m1 in camera axes, m/s."""
    truth = scene.path.states(scene.t_s[part])
    spin = np.column_stack([np.zeros((len(part), 2)), scene.target.yaw_rate[part]])
    arm = scene.target.r_world[part] @ scene.arms[0]
    return rotate(conjugate(truth.q_world), scene.target.v_world[part] + np.cross(spin, arm))


def _velocities(
    scene: MovingScene, learned: Learned, tracks: SceneTracks, part: IntArray, length: int, dt: float
) -> list[tuple[Array, BoolArray]]:
    """Velocities (K, 3) in camera axes, m/s, by chi, and where they count: corrected, then as printed."""

    def rate(x: Array, order: int = 1) -> Array:
        return np.asarray(savgol_filter(x, length, 2, deriv=order, delta=dt, axis=0))

    v_cam, w_cam = scene.odometry.at(scene.t_s[part])
    v_cam, w_cam = rate(v_cam, 0), rate(w_cam, 0)
    q_mc = multiply(tracks.in_camera.q[part], TO_SCENE)
    # signs that do not jump: the quaternion is differentiated
    flips = np.sign(np.sum(q_mc[1:] * q_mc[:-1], axis=1))
    q_mc = q_mc * np.cumprod(np.concatenate([[1.0], flips]))[:, None]
    p_k = learned.features[0]
    xy = scene.xy_target[part, 0]
    u_1 = unit(np.column_stack([xy, np.ones(len(part))]))[0]
    r_mc = to_matrix(q_mc)
    p_1 = tracks.in_camera.p[part] + r_mc @ (p_k - learned.features.mean(axis=0))
    u_mm, d_mm = unit(lever_position(p_1, r_mc, p_k))
    u_k, d_k = unit(p_k)
    flows = (optical_flow(rate(u_1), u_1, w_cam), optical_flow(rate(u_mm), u_mm, w_cam))
    w_m = angular_velocity(q_mc, rate(q_mc), w_cam)
    psi = distance_ratios(u_1, u_mm, r_mc, u_k)
    valid = (velocity_excitation(u_1, u_mm) > LAMBDA_V) & (d_mm > 0.3)
    return [
        (
            velocity_by_directions(
                (u_1, u_mm), flows, psi, (w_m, w_cam, r_mc), u_k, float(d_k), v_cam, as_printed=printed
            ),
            np.asarray(valid),
        )
        for printed in (False, True)
    ]

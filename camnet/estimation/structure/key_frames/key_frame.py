"""One key frame from its first image to its last: pose relative to it, distances, dwell time (bell2019, ch. 4).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``R_{k/c}``, ``u_{k/c}`` | ``r_kc``, ``u_kc`` | (T, 3, 3), (T, 3) | - | filtered if near the expected pose |
| ``Dt_on`` | ``dwell_s`` | | s | ``-ln(th_lo / (sqrt(3) d_max)) / (lambda_a lmin(K_X))``, first visit |
| ``d_{k/c}`` | ``d_kc`` | (T,) | m | mean over the features that remain |
| | ``usable`` | (T,) | - | all features that remain are past their dwell time, and they are enough |

The images of a key frame are processed together; the result for an image depends only on it and on earlier ones.
The expected pose is that by odometry since the key frame was taken. bell2019 takes it from the pose estimate, whose
resets at landmarks would move the key frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.geometry import distance_ratios, excitation, range_row, unit
from camnet.estimation.structure.key_frames.feature_observer import ObserverGains, Track, observe
from camnet.estimation.structure.key_frames.relative_pose import RelativePoses, relative_poses
from camnet.estimation.structure.key_frames.settings import KeyFrameSettings
from camnet.estimation.structure.rates import distance_rate, translational_flow
from camnet.geometry.rotations import exp, to_matrix
from camnet.types import Array, BoolArray

__all__ = ["KeyFrameMotion", "KeyFrameRecord", "measure_key_frame", "observe_key_frame", "observer_gains"]


@dataclass(frozen=True, eq=False, slots=True)
class KeyFrameMotion:
    """Odometry at the T images of a key frame.

    Attributes
    ----------
    t_s : (T,) times, s
    p_world, q_world : (T, 3) m, (T, 4) dead-reckoned poses in any one frame, camera to that frame
    v_cam : (T, 3) measured velocities, camera frame, m/s
    """

    t_s: Array
    p_world: Array
    q_world: Array
    v_cam: Array


@dataclass(frozen=True, eq=False, slots=True)
class KeyFrameRecord:
    """What became of a key frame.

    Attributes
    ----------
    r_kc, u_kc : (T, 3, 3), (T, 3) its rotation and direction in the camera frame, as used
    d_kc : (T,) m, its distance: mean over the features that remain
    usable : (T,) whether the camera's pose may be updated with it
    alive : (T, N) features that remain
    th : (T, N, 3) estimated distances ``[d_ic; d_kc; d_ik]``, m
    learned : (T, N) learned distance at the key frame, m; NaN before it is learned
    poses : corrections of the expected pose by the images alone
    """

    r_kc: Array
    u_kc: Array
    d_kc: Array
    usable: BoolArray
    alive: BoolArray
    th: Array
    learned: Array
    poses: RelativePoses


def measure_key_frame(
    settings: KeyFrameSettings, focal_px: float, motion: KeyFrameMotion, u_ic: Array, seen: BoolArray
) -> tuple[Track, RelativePoses]:
    """Relative poses and what the observer of the distances reads; independent of gates and gains.

    Parameters
    ----------
    settings : filters and bounds
    focal_px : pixels a radian
    motion : odometry at the T images; the first is the key frame
    u_ic : (T, N, 3) directions of its features
    seen : (T, N) which of them are tracked; a lost feature does not come back
    """
    r_0, p_0, u_0 = _expected(motion)
    poses = relative_poses(u_ic[0], u_ic, seen, r_0, u_0, focal_px, settings.relative_pose)
    pose = _near_expected(settings, motion.t_s, r_0, u_0, poses)
    return _track(settings, motion, u_ic, seen, (r_0, p_0), pose), poses


def observer_gains(settings: KeyFrameSettings, focal_px: float) -> ObserverGains:
    """Return the numbers that `observe` reads."""
    s = settings
    return ObserverGains(
        s.k, s.k_x, s.lambda_a, s.window_s, s.stack_size, s.stack_lambda, s.least_y, s.least_u_m, *s.distance_m,
        s.gate * s.gate_px**2, s.start_m, focal_px,
    )  # fmt: skip


def observe_key_frame(
    settings: KeyFrameSettings, dwell_s: float, focal_px: float, track: Track, poses: RelativePoses
) -> KeyFrameRecord:
    """Estimate the distances and say when the key frame may be used.

    Parameters
    ----------
    settings : gains, gates, bounds
    dwell_s : first dwell time (`camnet.certification.bell_dwell.landmark_on_min_first`)
    focal_px : pixels a radian
    track, poses : from `measure_key_frame`
    """
    th, alive, on_s, learned = observe(observer_gains(settings, focal_px), track)
    remaining = np.sum(alive, axis=1)
    past = np.all(~alive | (on_s >= dwell_s), axis=1)
    d_kc = np.sum(np.where(alive, th[..., 1], 0.0), axis=1) / np.maximum(remaining, 1)
    usable = past & (remaining >= settings.least_features)
    return KeyFrameRecord(track.r_kc, track.u_kc, d_kc, usable, alive, th, learned, poses)


def _expected(motion: KeyFrameMotion) -> tuple[Array, Array, Array]:
    """Rotation, position and direction of the key frame in the camera frame, by odometry."""
    r = to_matrix(motion.q_world)
    r_0 = np.swapaxes(r, 1, 2) @ r[0]
    p_0 = np.einsum("tji,tj->ti", r, motion.p_world[0] - motion.p_world)
    u_0 = unit(p_0)[0]
    # at the key frame itself, and while the camera stands: against the way it goes
    still = ~np.isfinite(u_0[:, 0]) | (np.linalg.norm(p_0, axis=1) < 1e-6)
    back = np.nan_to_num(-unit(motion.v_cam[still])[0], nan=0.0)
    back[np.all(back == 0.0, axis=1)] = [1.0, 0.0, 0.0]
    u_0[still] = back
    return r_0, p_0, u_0


def _near_expected(
    s: KeyFrameSettings, t_s: Array, r_0: Array, u_0: Array, poses: RelativePoses
) -> tuple[Array, Array]:
    """Return the corrected pose, filtered, where the correction is small enough; else the expected one."""
    near = np.linalg.norm(poses.turn, axis=1) < s.near_expected
    near &= np.linalg.norm(poses.shift, axis=1) < s.near_expected
    correction = np.where(near[:, None], np.column_stack([poses.turn, poses.shift]), 0.0)
    correction = _low_pass(correction, t_s, s.pose_filter_s)
    turn, shift = correction[:, :3], correction[:, 3:]
    half = to_matrix(exp(0.5 * turn))
    u_kc = unit(np.einsum("tij,tj->ti", half, u_0) + shift)[0]
    return to_matrix(exp(turn)) @ r_0, u_kc


def _track(
    s: KeyFrameSettings, motion: KeyFrameMotion, u_ic: Array, seen: BoolArray, expected: tuple[Array, Array],
    pose: tuple[Array, Array],
) -> Track:  # fmt: skip
    r_kc, u_kc = pose
    u_ik, k = u_ic[0], u_kc[:, None]
    u_ic = np.where(seen[..., None], u_ic, u_ic[0])
    move_r, move_p = _moves(motion)
    psi = distance_ratios(u_ic, k, r_kc[:, None], u_ik)
    informative = seen & (excitation(u_ic, k) > s.lambda_a)
    informative[0] = False
    v = motion.v_cam[:, None]
    rate = np.stack(np.broadcast_arrays(distance_rate(u_ic, v), distance_rate(k, v)), axis=-1)
    dt = np.diff(motion.t_s, prepend=motion.t_s[0])
    way = np.cumsum(0.5 * dt[:, None, None] * (rate + np.concatenate([rate[:1], rate[:-1]])), axis=0)
    # flow with the turning taken out, over one frame, and the translation's at its middle
    turned = np.einsum("tij,tnj->tni", move_r, np.concatenate([u_ic[:1], u_ic[:-1]]))
    with np.errstate(invalid="ignore", divide="ignore"):
        xi = (u_ic - turned) / dt[:, None, None]
    xi[0] = 0.0
    rho = translational_flow(unit(u_ic + turned)[0], v)
    lost = ~seen[..., None]
    xi, rho = np.where(lost, 0.0, xi), np.where(lost, 0.0, rho)
    xi, rho = _low_pass(xi, motion.t_s, s.flow_filter_s), _low_pass(rho, motion.t_s, s.flow_filter_s)
    return Track(
        motion.t_s, u_ik, u_ic, seen, move_r, move_p, *expected, r_kc, u_kc, psi, informative, way,
        np.sum(xi * xi, axis=-1), np.sum(xi * rho, axis=-1), range_row(u_ic, k, r_kc[:, None], u_ik),
    )  # fmt: skip


def _moves(motion: KeyFrameMotion) -> tuple[Array, Array]:
    """Return what carries a stationary point from the image before to each image; the first is the identity."""
    r = to_matrix(motion.q_world)
    before = np.concatenate([r[:1], r[:-1]])
    gone = np.diff(motion.p_world, axis=0, prepend=motion.p_world[:1])
    return np.swapaxes(r, 1, 2) @ before, -np.einsum("tji,tj->ti", r, gone)


def _low_pass(x: Array, t_s: Array, time_s: float) -> Array:
    """First-order filter along the first axis, from zero at the first entry."""
    out = np.zeros_like(x)
    keep = np.exp(-np.diff(t_s) / time_s)
    for t in range(1, len(x)):
        out[t] = x[t] + keep[t - 1] * (out[t - 1] - x[t])
    return out

"""Dead reckoning that learns its velocity source's errors while there is an external pose; compiled, one step a call.

| symbol | name | shape | unit | meaning |
| --- | --- | --- | --- | --- |
| ``x = [p, th, s, b, s_g, p_k, th_k]`` | ``x`` | (9,) | m, rad, -, rad/s, - | pose, scale, gyro bias and scale, clone |
| ``P`` | ``cov`` | (9, 9) | | covariance |
| ``u = (1 + s) R(th)^T p' + n`` | | (2,) | m/s | measured velocity, ahead and left of the heading |
| ``w = th' + b + n`` | | | rad/s | measured turn about the vertical |

The prediction, the fix (a full pose update whose cross-covariances teach scale and bias) and the visual rotation since
a clone of the pose are those of `camnet.estimation.structure.key_frames.augmented_filter` (bell2019, ch. 4, and our
calibration); gyro scale and slip are not modelled here. White noise of the velocity adds ``walk_p^2 dt`` to the
variance of each coordinate.

Without calibration the velocity is taken as measured: after every fix the errors' estimates are put back to zero and
their variances to the source's, so that the covariance still tells what they do in the next outage.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.structure.key_frames.augmented_filter import (
    FilterNoise,
    clone_pose,
    predict_state,
    take_landmark,
    take_rotation,
)
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array

__all__ = ["OwnErrors", "OwnModel", "advance_own", "draw_errors", "fix_own", "own_model", "start_own"]

#: a run's scale and bias lie within so many standard deviations
WITHIN = 2.0
_POSE, _STATE = 6, 9


class OwnErrors(NamedTuple):
    """Errors of one run of a velocity source: scale (share of the speed) and gyro bias, rad/s."""

    scale: float
    gyro_bias: float


class OwnModel(NamedTuple):
    """What the filter is told: noise, whether it calibrates, and the noise of rotations between images.

    ``walk_p`` m, ``walk_th`` rad: standard deviations after one second; ``turn_sd`` rad (NaN: there are no images).
    """

    noise: FilterNoise
    walk_p: float
    walk_th: float
    calibrate: bool
    turn_sd: float


def own_model(source: PoseSource, dt_s: float) -> OwnModel:
    """Return the filter's model of a source that is read every ``dt_s``."""
    v, fixes = source.velocity, source.fixes
    noise = FilterNoise(
        scale=v.scale,
        gyro_bias=v.gyro_bias_radps,
        gyro_scale=0.0,
        slip=0.0,
        slip_time_s=1.0,
        gyro_noise=v.heading_walk_rad / math.sqrt(dt_s),
        landmark_m=fixes.position_noise_m,
        landmark_rad=fixes.heading_noise_rad,
        adapt_count=50.0,
        adapt_most=1.0,  # the noise is as stated
    )
    turn = source.visual.turn_noise_rad if source.source == "key_frames" else math.nan
    return OwnModel(noise, v.position_walk_m, v.heading_walk_rad, source.calibrate, turn)


def draw_errors(source: PoseSource, rng: np.random.Generator) -> OwnErrors:
    """Draw the errors of one run: normal, within two standard deviations."""
    drawn = rng.standard_normal(2)
    while np.abs(drawn).max() > WITHIN:
        drawn = rng.standard_normal(2)
    return OwnErrors(
        source.velocity.scale * float(drawn[0]), source.velocity.gyro_bias_radps * float(drawn[1])
    )


@cached_njit
def start_own(x: Array, cov: Array, model: OwnModel, pose: Array, draws: Array) -> None:
    """Start from a fix: the true ``pose`` (3,) (x, y, heading) with noise from ``draws`` (3,)."""
    noise = model.noise
    sd = (noise.landmark_m, noise.landmark_m, noise.landmark_rad, noise.scale, noise.gyro_bias, 0.0)
    x[:] = 0.0
    cov[:, :] = 0.0
    for i in range(_POSE):
        cov[i, i] = sd[i] ** 2
        if i < 3:
            x[i] = pose[i] + sd[i] * draws[i]
    clone_pose(x, cov, _POSE)


@cached_njit
def advance_own(
    x: Array, cov: Array, model: OwnModel, errors: OwnErrors, before: Array, after: Array, dt: float,
    draws: Array, rotation: float,
) -> None:  # fmt: skip
    """Measure a step of the true pose, ``before`` (3,) to ``after`` (3,) in ``dt`` s, and dead-reckon it.

    ``draws`` (3,) are standard normal; ``rotation``: turn since the last image, rad, if one is taken now (else NaN).
    """
    turn = after[2] - before[2]
    turn -= 2.0 * math.pi * round(turn / (2.0 * math.pi))
    c, s = math.cos(before[2] + 0.5 * turn), math.sin(before[2] + 0.5 * turn)
    dx, dy = after[0] - before[0], after[1] - before[1]
    white = model.walk_p / math.sqrt(dt)
    u = np.array(
        [
            (1.0 + errors.scale) * (c * dx + s * dy) / dt + white * draws[0],
            (1.0 + errors.scale) * (c * dy - s * dx) / dt + white * draws[1],
        ]
    )
    w = turn / dt + errors.gyro_bias + model.walk_th / math.sqrt(dt) * draws[2]
    predict_state(x, cov, _STATE, dt, u, u, w, w, model.noise, 1.0, 1.0, np.zeros((2, 2)))
    for i in range(2):
        cov[i, i] += model.walk_p**2 * dt
    if not math.isnan(rotation):
        take_rotation(x, cov, _STATE, _POSE, rotation, model.turn_sd, 0.0, 1.0, np.zeros(4), model.noise)
        clone_pose(x, cov, _POSE)


@cached_njit
def fix_own(x: Array, cov: Array, model: OwnModel, pose: Array, draws: Array) -> None:
    """Take a fix: the true ``pose`` (3,) with noise from ``draws`` (3,)."""
    noise = model.noise
    seen = np.array(
        [
            pose[0] + noise.landmark_m * draws[0],
            pose[1] + noise.landmark_m * draws[1],
            pose[2] + noise.landmark_rad * draws[2],
        ]
    )
    take_landmark(x, cov, _STATE, seen, noise, np.zeros((2, 2)))
    if model.calibrate:
        return
    for i in range(3, _POSE):
        for j in range(_STATE):
            cov[i, j] = cov[j, i] = 0.0
        x[i] = 0.0
    cov[3, 3], cov[4, 4] = noise.scale**2, noise.gyro_bias**2

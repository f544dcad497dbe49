"""Measured velocities of a camera and their errors: wheels (or flow) and a gyro.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| ``s`` | ``scale`` | - | ``v_meas = (1 + s + g(t)) v_c + n_v`` |
| ``g(t)`` | ``slip`` | - | share of the speed, first-order Gauss-Markov with SD ``slip`` and time ``slip_time_s`` |
| ``b``, ``s_g`` | ``gyro_bias_radps``, ``gyro_scale`` | rad/s, - | ``w_meas = (1 + s_g) w_c + b + n_w`` |
| ``n_v``, ``n_w`` | ``speed_noise_mps``, ``gyro_noise_radps`` | m/s, rad/s | white, standard deviation of one sample |

Scale, bias and gyro scale are constant in a run. `OdometrySpread` holds their standard deviations over runs; ``draw``
gives the errors of one run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.camera_path import CameraPath
from camnet.geometry.rotations import exp, multiply, normalise, rotate
from camnet.settings import NonNegative, Positive, Settings
from camnet.types import Array

__all__ = ["Odometry", "OdometryErrors", "OdometrySpread", "dead_reckon", "measure_odometry"]


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """Errors of one run; the symbols are in the module's table."""

    scale: float = 0.0
    slip: float = 0.0
    slip_time_s: float = 1.0
    gyro_bias_radps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_scale: float = 0.0
    speed_noise_mps: float = 0.0
    gyro_noise_radps: float = 0.0


class OdometrySpread(Settings):
    """Standard deviations of the errors over runs, and of what varies within one."""

    scale_sd: NonNegative = 0.015
    slip_sd: NonNegative = 0.02
    slip_time_s: Positive = 1.0
    gyro_bias_sd_radps: NonNegative = 0.0
    gyro_scale_sd: NonNegative = 0.0
    speed_noise_mps: NonNegative = 0.0
    gyro_noise_radps: NonNegative = 0.004

    def draw(self, rng: np.random.Generator) -> OdometryErrors:
        """Errors of one run."""
        scale, gyro_scale, *bias = rng.standard_normal(5).tolist()
        return OdometryErrors(
            scale=self.scale_sd * scale,
            slip=self.slip_sd,
            slip_time_s=self.slip_time_s,
            gyro_bias_radps=(
                self.gyro_bias_sd_radps * bias[0],
                self.gyro_bias_sd_radps * bias[1],
                self.gyro_bias_sd_radps * bias[2],
            ),
            gyro_scale=self.gyro_scale_sd * gyro_scale,
            speed_noise_mps=self.speed_noise_mps,
            gyro_noise_radps=self.gyro_noise_radps,
        )


@dataclass(frozen=True, eq=False, slots=True)
class Odometry:
    """Measured velocities of the camera, camera frame.

    Attributes
    ----------
    t_s : (K,) increasing times, s
    v_cam, w_cam : (K, 3) m/s, (K, 3) rad/s
    """

    t_s: Array
    v_cam: Array
    w_cam: Array

    def at(self, t_s: Array | float) -> tuple[Array, Array]:
        """Velocities (..., 3), (..., 3) at times (...,), linear between samples, held beyond the ends."""
        t = np.asarray(t_s, dtype=np.float64)
        return (
            np.stack([np.interp(t, self.t_s, self.v_cam[:, k]) for k in range(3)], axis=-1),
            np.stack([np.interp(t, self.t_s, self.w_cam[:, k]) for k in range(3)], axis=-1),
        )


def measure_odometry(
    path: CameraPath, t_s: Array, errors: OdometryErrors, rng: np.random.Generator
) -> Odometry:
    """Odometry of a camera on ``path`` at times (K,), s."""
    truth = path.states(t_s)
    slip = np.zeros(len(truth.t_s))
    steps = np.diff(truth.t_s)
    draws = rng.standard_normal(len(slip))
    slip[0] = draws[0]
    for k, dt in enumerate(steps.tolist()):
        keep = math.exp(-dt / errors.slip_time_s)
        slip[k + 1] = keep * slip[k] + math.sqrt(1.0 - keep * keep) * draws[k + 1]
    white_v, white_w = rng.standard_normal((2, len(slip), 3))
    share = 1.0 + errors.scale + errors.slip * slip
    return Odometry(
        truth.t_s,
        truth.v_cam * share[:, None] + errors.speed_noise_mps * white_v,
        truth.w_cam * (1.0 + errors.gyro_scale)
        + np.array(errors.gyro_bias_radps)
        + errors.gyro_noise_radps * white_w,
    )


def dead_reckon(odometry: Odometry, t_s: Array, p_world: Array, q_world: Array) -> tuple[Array, Array]:
    """Poses (K, 3), (K, 4) at times (K,), s, from the pose at the first of them: ``p' = R(q) v_c, q' = 1/2 B(q) w_c``.

    Between successive times the velocities at the middle hold; the turn over half the step is exact.
    """
    t = np.asarray(t_s, dtype=np.float64)
    steps = np.diff(t)
    v, w = odometry.at(t[:-1] + 0.5 * steps)
    p, q = np.empty((len(t), 3)), np.empty((len(t), 4))
    p[0], q[0] = p_world, q_world
    for k, dt in enumerate(steps.tolist()):
        middle = multiply(q[k], exp(0.5 * dt * w[k]))
        p[k + 1] = p[k] + dt * rotate(middle, v[k])
        q[k + 1] = normalise(multiply(middle, exp(0.5 * dt * w[k])))
    return p, q

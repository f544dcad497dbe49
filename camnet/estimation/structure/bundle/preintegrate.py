"""What odometry says of the camera's motion between two times, as a function of the gyro's bias.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``dR`` | ``turn`` | (4,) | - | ``int``: ``dR' = dR w^x`` |
| ``dp`` | ``shift`` | (3,) | m | ``int dR v``, in the camera frame at the start |
| ``J_R`` | ``turn_by_bias`` | (3, 3) | s | ``dR(b) = dR Exp(J_R b)``: ``J_R <- Exp(-w dt) J_R - dt I`` |
| ``J_p`` | ``shift_by_bias`` | (3, 3) | m s | ``J_p <- J_p - dR v^x J_R dt`` |
| ``S_p`` | ``shift_covariance`` | (3, 3) | m^2 | ``sum dt (2 tau sigma^2 (dR v)(dR v)^T + n_v^2 delta I)`` + floor |
| ``s_R`` | ``turn_sd`` | | rad | ``sqrt(n_w^2 delta T)`` + floor |

delta is the odometry's period. Slip correlated over tau acts, over times longer than that, like white noise of density
``2 tau sigma^2 |v|^2``; over shorter ones this is too cautious for one step and right for their sum. The floors
(0.2 mm and 0.2 % of the way, 10 urad) stand for interpolation and for what no model holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.compiled import cached_njit
from camnet.errors import ConfigError
from camnet.estimation.structure.odometry import Odometry, OdometryErrors
from camnet.geometry.rotations_compiled import exp, multiply, normalise, to_matrix
from camnet.types import Array

__all__ = ["Step", "preintegrate"]

_FLOOR_M, _FLOOR_SHARE, _FLOOR_RAD = 2e-4, 2e-3, 1e-5


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """See the module's table."""

    shift: Array
    turn: Array
    shift_by_bias: Array
    turn_by_bias: Array
    shift_covariance: Array
    turn_sd: float


@cached_njit
def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@cached_njit
def _integrate(
    times: Array, v: Array, w: Array, shift: Array, turn: Array, j_p: Array, j_r: Array, spread: Array
) -> None:
    """Integrate velocities (K - 1, 3) that hold between times (K,); results are written to the last five."""
    for k in range(len(times) - 1):
        dt = times[k + 1] - times[k]
        half = exp(0.5 * dt * w[k])
        middle = multiply(turn, half)
        r = to_matrix(middle)
        back = to_matrix(half).T
        own = 0.5 * dt * np.eye(3) - 0.125 * dt * dt * _skew(
            w[k]
        )  # the bias within half a step, second order
        j_mid = back @ j_r - own
        way = r @ v[k]
        shift += dt * way
        j_p -= dt * (r @ _skew(v[k]) @ j_mid)
        for a in range(3):
            for b in range(3):
                spread[a, b] += dt * way[a] * way[b]
        j_r[:] = back @ j_mid - own
        turn[:] = normalise(multiply(middle, half))


def preintegrate(odometry: Odometry, start_s: float, end_s: float, noise: OdometryErrors) -> Step:
    """Odometry's step from one time to a later one.

    Parameters
    ----------
    odometry : measured velocities
    start_s, end_s : times, s
    noise : slip and white noises, as standard deviations; its scale and bias are not used

    Raises
    ------
    ConfigError
        If the times are not in order.
    """
    if not end_s > start_s:
        raise ConfigError(f"end_s {end_s!r} is not after start_s {start_s!r}")
    inside = odometry.t_s[(odometry.t_s > start_s + 1e-9) & (odometry.t_s < end_s - 1e-9)]
    times = np.concatenate([[start_s], inside, [end_s]])
    v, w = odometry.at(0.5 * (times[1:] + times[:-1]))
    shift, turn = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    j_p, j_r, spread = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    _integrate(times, v, w, shift, turn, j_p, j_r, spread)
    period = float(np.median(np.diff(odometry.t_s))) if len(odometry.t_s) > 1 else end_s - start_s
    span = end_s - start_s
    floor = _FLOOR_M + _FLOOR_SHARE * float(np.sqrt(np.trace(spread) * span))
    covariance = 2.0 * noise.slip_time_s * noise.slip**2 * spread + np.eye(3) * (
        noise.speed_noise_mps**2 * period * span + floor**2
    )
    turn_sd = float(np.sqrt(noise.gyro_noise_radps**2 * period * span)) + _FLOOR_RAD
    return Step(shift, turn, j_p, j_r, covariance, turn_sd)

r"""Dwell times of bell2019: landmarks seen now and then (chapter 4) and a moving target (chapter 5).

| symbol | name | unit | where |
| --- | --- | --- | --- |
| lambda_a, lambda_min(K_X) | ``lambda_a``, ``kx_min`` | -, 1/s | ch. 4, rate lambda = lambda_a lambda_min(K_X) |
| theta_lo, theta_hi | ``error_lo_m``, ``error_hi_m`` | m | ch. 4 thresholds of the distance error |
| d_max, v_c | ``d_max_m``, ``camera_speed_mps`` | m, m/s | Assumption 2.5, predictor |
| c1 .. c5 | ``MovingTargetConstants`` | | ch. 5, Theorems 5.1 and 5.2 |
| e = R - D | ``margin_m`` | m | Figure 5-1: R = d sin(psi) less the target's extent |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.certification.dwell import DwellTime
from camnet.errors import CertificateError

__all__ = [
    "MovingTargetConstants",
    "landmark_off_max",
    "landmark_on_min_first",
    "landmark_on_min_later",
    "moving_target_initial_max",
    "moving_target_off_max",
]


def landmark_on_min_first(lambda_a: float, kx_min: float, d_max_m: float, error_lo_m: float) -> DwellTime:
    """Return how long a feature must first be seen once its distance is learned (ch. 4, first visit)."""
    rate = lambda_a * kx_min
    seconds = -math.log(error_lo_m / (math.sqrt(3.0) * d_max_m)) / rate
    return DwellTime(max(0.0, seconds), "bell2019 ch. 4, first visit")


def landmark_on_min_later(lambda_a: float, kx_min: float, error_lo_m: float, error_hi_m: float) -> DwellTime:
    """Return how long a feature must be seen on later visits (ch. 4)."""
    seconds = -math.log(error_lo_m / error_hi_m) / (lambda_a * kx_min)
    return DwellTime(max(0.0, seconds), "bell2019 ch. 4, later visits")


def landmark_off_max(error_lo_m: float, error_hi_m: float, camera_speed_mps: float) -> DwellTime:
    """Return how long a feature may stay out of view (ch. 4).

    The predicted unit vectors err by at most 2, so the two distances drift by at most 2 v_c each and the error's norm
    by 2 sqrt(2) v_c; the published factor 4 is kept, it is valid and slightly cautious.
    """
    equation = "bell2019 ch. 4, out of view"
    if error_hi_m <= error_lo_m:
        return DwellTime(
            None, equation, f"theta_hi = {error_hi_m:.4g} is not above theta_lo = {error_lo_m:.4g}"
        )
    return DwellTime((error_hi_m - error_lo_m) / (4.0 * camera_speed_mps), equation)


@dataclass(frozen=True, slots=True)
class MovingTargetConstants:
    """Constants of bell2019, chapter 5: V' <= c1 V + c2 before learning, -c3 V + c3 (c4/c3) seen, c5 V + c2 unseen."""

    c1: float
    c2: float
    c3: float
    c4: float
    c5: float

    @classmethod
    def from_bounds(
        cls,
        *,
        camera_rate_radps: float,
        weight_bound: float,
        sigma_bar: float,
        sigma_eta: float,
        sigma_nu: float,
        nu_bar: float,
        phi_q: float,
        eps_bar: float,
        gamma_inv_min: float,
        gamma_inv_max: float,
        k_eta_min: float,
        k_nu_min: float,
        k_w_min: float,
        k_w_max: float,
        stack_lambda: float,
        stack_norm: float,
        stack_size: int,
        window_s: float,
    ) -> MovingTargetConstants:
        """Evaluate c1 to c5.

        Parameters
        ----------
        camera_rate_radps : bound of |w_c|
        weight_bound, sigma_bar : bounds of the ideal weights and of the basis
        sigma_eta, sigma_nu : bounds of the basis' derivatives in pose and velocity
        nu_bar, phi_q : bounds of the target's twist and of d Phi / d q
        eps_bar : bound of the acceleration model's residual
        gamma_inv_min, gamma_inv_max : extreme eigenvalues of Gamma^-1
        k_eta_min, k_nu_min, k_w_min, k_w_max : extreme eigenvalues of the gains
        stack_lambda, stack_norm, stack_size, window_s : threshold, largest eigenvalue, entries and window of the stack
        """
        half_s = 0.5 * sigma_bar
        w_eta = 0.5 * weight_bound * sigma_eta
        twist = 1.0 + half_s + w_eta + weight_bound * sigma_nu
        low = 0.5 * min(1.0, gamma_inv_min)
        high = 0.5 * max(1.0, gamma_inv_max)
        pose = nu_bar * phi_q + 0.5 + camera_rate_radps + camera_rate_radps * phi_q + w_eta
        stack = k_w_max * math.sqrt(stack_norm) * stack_size * eps_bar * window_s
        return cls(
            c1=max(0.5 + camera_rate_radps + w_eta, twist, half_s) / low,
            c2=0.5 * eps_bar**2,
            c3=min(k_eta_min, 0.5 * k_nu_min, 0.5 * k_w_min * stack_lambda) / high,
            c4=eps_bar**2 / (2.0 * k_nu_min) + stack**2 / (2.0 * k_w_min * stack_lambda),
            c5=max(pose, twist, half_s) / low,
        )


def moving_target_initial_max(constants: MovingTargetConstants, v0: float, margin_m: float) -> DwellTime:
    """Return the time within which learning must end, before the error outgrows the view (Theorem 5.1)."""
    equation = "bell2019 ch. 5, before learning"
    level = 0.5 * margin_m**2
    if margin_m <= 0.0 or v0 >= level:
        return DwellTime(None, equation, f"the initial level {v0:.4g} is not below e^2/2 = {level:.4g}")
    c = constants
    return DwellTime(min(_rise_time(rate, c.c2, v0, level) for rate in (c.c1, c.c5)), equation)


def moving_target_off_max(constants: MovingTargetConstants, on_s: float, margin_m: float) -> DwellTime:
    """Return how long the target may stay unseen after ``on_s`` seconds in view (Theorem 5.2)."""
    equation = "bell2019 ch. 5, out of view"
    c = constants
    level = 0.5 * margin_m**2
    floor = c.c4 / c.c3
    v_exit = (level - floor) * math.exp(-c.c3 * on_s) + floor
    if margin_m <= 0.0 or v_exit >= level:
        return DwellTime(
            None,
            equation,
            f"the level when the target leaves, {v_exit:.4g}, is not below e^2/2 = {level:.4g}",
        )
    return DwellTime(_rise_time(c.c5, c.c2, v_exit, level), equation)


def _rise_time(rate: float, source: float, start: float, level: float) -> float:
    """Return the time that V' = rate V + source takes from ``start`` to ``level``."""
    if not rate > 0.0:
        raise CertificateError(f"growth rate {rate!r}: a rate > 0 is needed")
    return math.log((level + source / rate) / (start + source / rate)) / rate

r"""Dwell times of bell2019: landmarks seen now and then (chapter 4) and a moving target (chapter 5).

| symbol | name | unit | where |
| --- | --- | --- | --- |
| lambda_a, lambda_min(K_X) | ``lambda_a``, ``kx_min`` | -, 1/s | ch. 4, rate lambda = lambda_a lambda_min(K_X) |
| theta_lo, theta_hi | ``error_lo_m``, ``error_hi_m`` | m | ch. 4 thresholds of the distance error |
| d_max, v_c | ``d_max_m``, ``camera_speed_mps`` | m, m/s | Assumption 2.5, predictor |
| c1 .. c5 | ``MovingTargetConstants`` | | ch. 5, Theorems 5.1 and 5.2 |
| e = R - D | ``margin_m`` | m | Figure 5-1: R = d sin(psi) less the target's extent |

Out of view, chapter 4 has three forms: ``landmark_off_max`` as published, ``landmark_off_max_sound`` for velocities
with bounded errors, ``landmark_off_max_learned`` from measured growth. The published one bounds the drift by the
camera's speed, as if the predicted directions were arbitrary; but the predictor moves every point rigidly, so that with
exact velocities the error does not grow at all, and with others the published time says nothing of their errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from camnet.certification.dwell import DwellTime
from camnet.errors import CertificateError
from camnet.estimation.structure.moving.unseen_growth import drive, stack_residual

__all__ = [
    "MovingTargetConstants",
    "landmark_off_max",
    "landmark_off_max_learned",
    "landmark_off_max_sound",
    "landmark_on_min_first",
    "landmark_on_min_later",
    "moving_target_initial_max",
    "moving_target_off_max",
]


def _check(least: float = 0.0, **values: float) -> None:
    """Refuse what is not finite, or not above ``least``."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > least):
            raise CertificateError(f"{name} = {value!r}: a finite number > {least:g} is needed")


def _finite(**values: float) -> None:
    """Refuse what is not finite; a margin may be negative, and no time is possible then."""
    for name, value in values.items():
        if not math.isfinite(value):
            raise CertificateError(f"{name} = {value!r}: a finite number is needed")


def _check_bounds(**values: float) -> None:
    """Refuse what is not finite, or negative."""
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise CertificateError(f"{name} = {value!r}: a finite number >= 0 is needed")


def _landmark_rate(lambda_a: float, kx_min: float) -> float:
    """``lambda = lambda_a lmin(K_X)``, 1/s."""
    _check(lambda_a=lambda_a, kx_min=kx_min)
    if lambda_a > 1.0:
        raise CertificateError(
            f"lambda_a = {lambda_a!r}: a number in (0, 1] is needed; 1 - |u^T u| is never larger"
        )
    return lambda_a * kx_min


def landmark_on_min_first(lambda_a: float, kx_min: float, d_max_m: float, error_lo_m: float) -> DwellTime:
    """Return how long a feature must first be seen once its distance is learned (ch. 4, first visit).

    Raises
    ------
    CertificateError
        If a number is not finite and above zero, or ``lambda_a`` above 1.
    """
    rate = _landmark_rate(lambda_a, kx_min)
    _check(d_max_m=d_max_m, error_lo_m=error_lo_m)
    seconds = -math.log(error_lo_m / (math.sqrt(3.0) * d_max_m)) / rate
    return DwellTime(max(0.0, seconds), "bell2019 ch. 4, first visit")


def landmark_on_min_later(lambda_a: float, kx_min: float, error_lo_m: float, error_hi_m: float) -> DwellTime:
    """Return how long a feature must be seen on later visits (ch. 4).

    Raises
    ------
    CertificateError
        If a number is not finite and above zero, or ``lambda_a`` above 1.
    """
    equation = "bell2019 ch. 4, later visits"
    rate = _landmark_rate(lambda_a, kx_min)
    impossible = _levels(equation, error_lo_m, error_hi_m)
    return impossible or DwellTime(math.log(error_hi_m / error_lo_m) / rate, equation)


def _levels(equation: str, error_lo_m: float, error_hi_m: float) -> DwellTime | None:
    """Return why no time is possible, if so."""
    _check(error_lo_m=error_lo_m, error_hi_m=error_hi_m)
    if error_hi_m > error_lo_m:
        return None
    return DwellTime(None, equation, f"theta_hi = {error_hi_m:.4g} is not above theta_lo = {error_lo_m:.4g}")


def landmark_off_max(error_lo_m: float, error_hi_m: float, camera_speed_mps: float) -> DwellTime:
    """Return how long a feature may stay out of view (ch. 4), as published.

    The predicted unit vectors err by at most 2, so the two distances drift by at most 2 v_c each and the error's norm
    by 2 sqrt(2) v_c; the published factor 4 is valid for exact velocities and cautious, and says nothing for others.

    Raises
    ------
    CertificateError
        If a number is not finite and above zero.
    """
    equation = "bell2019 ch. 4, out of view"
    _check(camera_speed_mps=camera_speed_mps)
    impossible = _levels(equation, error_lo_m, error_hi_m)
    return impossible or DwellTime((error_hi_m - error_lo_m) / (4.0 * camera_speed_mps), equation)


def landmark_off_max_sound(
    error_lo_m: float, error_hi_m: float, speed_error_mps: float, rate_error_radps: float, d_max_m: float
) -> DwellTime:
    """Return how long a feature may stay out of view, for measured velocities with bounded errors; sound.

    The predictor moves a point by ``p_hat' = -v - w^x p_hat``. With velocities wrong by at most dv and dw,
    ``|p_til|' <= dv + dw |p_hat|`` for the feature and for the key frame, and a distance errs by no more than its
    point: ``Dt <= (th_hi - th_lo) / (sqrt(2) (dv + dw d_max))``. Exact velocities let the error stand still.

    Parameters
    ----------
    error_lo_m, error_hi_m : thresholds of the distances' error, m
    speed_error_mps, rate_error_radps : bounds dv, dw of the errors of the measured velocities
    d_max_m : bound of the predicted distances while out of view, m; the predictor does not project them

    Raises
    ------
    CertificateError
        If a number is not finite, an error negative, or both errors zero: then there is no bound to give.
    """
    equation = "bell2019 ch. 4, out of view, with measured velocities"
    _check_bounds(speed_error_mps=speed_error_mps, rate_error_radps=rate_error_radps)
    _check(d_max_m=d_max_m)
    growth = speed_error_mps + rate_error_radps * d_max_m
    if growth <= 0.0:
        raise CertificateError(
            f"speed_error_mps = {speed_error_mps!r}, rate_error_radps = {rate_error_radps!r}: one must be > 0"
        )
    impossible = _levels(equation, error_lo_m, error_hi_m)
    return impossible or DwellTime((error_hi_m - error_lo_m) / (math.sqrt(2.0) * growth), equation)


def landmark_off_max_learned(
    error_lo_m: float,
    error_hi_m: float,
    growths_mps: Sequence[float],
    share: float = 0.95,
    confidence: float = 0.95,
) -> DwellTime:
    """Return how long a feature may stay out of view, by measured growth of the error; holds for a share of cases.

    The largest of n growths bounds a ``share`` of all cases with confidence ``1 - share^n`` (Wilks 1941).

    Parameters
    ----------
    error_lo_m, error_hi_m : thresholds of the distances' error, m
    growths_mps : growth of the error's norm over the time out of view, of independent stretches, m/s
    share, confidence : in (0, 1)

    Raises
    ------
    CertificateError
        If a number is out of its range.
    """
    equation = "measured growth out of view"
    for name, value in (("share", share), ("confidence", confidence)):
        if not 0.0 < value < 1.0:
            raise CertificateError(f"{name} = {value!r}: a number in (0, 1) is needed")
    for value in growths_mps:
        if not math.isfinite(value):
            raise CertificateError(f"growths_mps holds {value!r}: finite numbers are needed")
    impossible = _levels(equation, error_lo_m, error_hi_m)
    if impossible:
        return impossible
    needed = math.ceil(math.log(1.0 - confidence) / math.log(share))
    if len(growths_mps) < needed:
        return DwellTime(None, equation, f"{len(growths_mps)} stretches are too few; {needed} are needed")
    growth = max(growths_mps)
    if growth <= 0.0:
        return DwellTime(None, equation, "the error did not grow in any stretch: there is no bound to give")
    return DwellTime((error_hi_m - error_lo_m) / growth, equation)


@dataclass(frozen=True, slots=True)
class MovingTargetConstants:
    """Constants of bell2019, chapter 5: V' <= c1 V + c2 before learning, -c3 V + c3 (c4/c3) seen, c5 V + c2 unseen.

    ``c2_seen`` is c2 before learning, where it is not the same as unseen.
    """

    c1: float
    c2: float
    c3: float
    c4: float
    c5: float
    c2_seen: float | None = None

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
        repaired: bool = False,
        velocity_noise: float = 0.0,
    ) -> MovingTargetConstants:
        """Evaluate c1 to c5, as printed or repaired.

        Repaired: the camera's turning drops out of c1 and c5, since ``1/2 w (x) q`` is skew in q and ``p^T w^x p``
        vanishes; unseen, c2 has the share of the stack's residual E that the weights follow, and before all that is
        learned is used the weights are frozen, so that c2 is eps^2 / 2 there; c4 has E with the noise of the windows'
        ends.

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
        repaired : see above
        velocity_noise : bound of the error of a velocity at a window's end; counts if repaired

        Raises
        ------
        CertificateError
            If a bound is not finite or negative, or a gain, eigenvalue or the stack's size not above zero.
        """
        _check_bounds(
            camera_rate_radps=camera_rate_radps, weight_bound=weight_bound, sigma_bar=sigma_bar, sigma_eta=sigma_eta,
            sigma_nu=sigma_nu, nu_bar=nu_bar, phi_q=phi_q, eps_bar=eps_bar, stack_norm=stack_norm, window_s=window_s,
            velocity_noise=velocity_noise,
        )  # fmt: skip
        _check(
            gamma_inv_min=gamma_inv_min, gamma_inv_max=gamma_inv_max, k_eta_min=k_eta_min, k_nu_min=k_nu_min,
            k_w_min=k_w_min, k_w_max=k_w_max, stack_lambda=stack_lambda, stack_size=stack_size,
        )  # fmt: skip
        half_s = 0.5 * sigma_bar
        w_eta = 0.5 * weight_bound * sigma_eta
        twist = 1.0 + half_s + w_eta + weight_bound * sigma_nu
        low = 0.5 * min(1.0, gamma_inv_min)
        high = 0.5 * max(1.0, gamma_inv_max)
        w = 0.0 if repaired else camera_rate_radps
        turning = 0.0 if repaired else nu_bar * phi_q + w * phi_q
        pose = turning + 0.5 + w + w_eta
        printed = math.sqrt(stack_norm) * stack_size * eps_bar * window_s
        residual = stack_residual(stack_size, stack_norm, eps_bar, window_s, velocity_noise)
        stack = k_w_max * (residual if repaired else printed)
        c2 = 0.5 * eps_bar**2
        return cls(
            c1=max(0.5 + w + w_eta, twist, half_s) / low,
            c2=drive(eps_bar, k_w_max, stack_lambda, residual) if repaired else c2,
            c3=min(k_eta_min, 0.5 * k_nu_min, 0.5 * k_w_min * stack_lambda) / high,
            c4=eps_bar**2 / (2.0 * k_nu_min) + stack**2 / (2.0 * k_w_min * stack_lambda),
            c5=max(pose, twist, half_s) / low,
            c2_seen=c2 if repaired else None,
        )


def moving_target_initial_max(constants: MovingTargetConstants, v0: float, margin_m: float) -> DwellTime:
    """Return the time within which learning must end, before the error outgrows the view (Theorem 5.1)."""
    equation = "bell2019 ch. 5, before learning"
    _check_bounds(v0=v0)
    _finite(margin_m=margin_m)
    level = 0.5 * margin_m**2
    if margin_m <= 0.0 or v0 >= level:
        return DwellTime(None, equation, f"the initial level {v0:.4g} is not below e^2/2 = {level:.4g}")
    c = constants
    source = c.c2 if c.c2_seen is None else c.c2_seen
    return DwellTime(min(_rise_time(rate, source, v0, level) for rate in (c.c1, c.c5)), equation)


def moving_target_off_max(constants: MovingTargetConstants, on_s: float, margin_m: float) -> DwellTime:
    """Return how long the target may stay unseen after ``on_s`` seconds in view (Theorem 5.2)."""
    equation = "bell2019 ch. 5, out of view"
    _check_bounds(on_s=on_s)
    _finite(margin_m=margin_m)
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

"""How fast the error of the moving-target predictor may grow (bell2019, Lemma 5.3), as printed and repaired.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| ``V`` | | - | ``1/2 |eta~|^2 + 1/2 |nu~|^2 + 1/2 tr(W~^T Gamma^-1 W~)`` |
| ``c5`` | ``rate`` | 1/s | Lemma 5.3 |
| ``c2`` | ``printed_drive`` | 1/s | Lemma 5.3, ``eps^2 / 2`` |
| ``c2'`` | ``drive`` | 1/s | ``eps^2 / 2 + k_W |E|^2 / (4 lambda)`` |
| ``lambda`` | ``stack_min`` | | smallest eigenvalue of the stack Y_S |
| ``|E|`` | ``stack_residual`` | | ``<= sqrt(N lmax(Y_S)) (eps s_w + 2 n_nu)`` |
| | ``growth_bound`` | - | ``(V_0 + c2/c5) exp(c5 t) - c2/c5`` |

Departure from print: Lemma 5.3 is false. While the target is unseen the weights follow the stack,
``W~' = -Gamma k_W (Y_S W~ + E)``, and E, the residual of the windows with the noise of their ends, does not vanish with
W~. Its share of V' is ``-k_W (lambda |W~|^2 - |W~| |E|) <= k_W |E|^2 / (4 lambda)``, which the printed c2 leaves out.
"""

from __future__ import annotations

import math

from camnet.errors import ConfigError

__all__ = ["drive", "growth_bound", "printed_drive", "stack_residual"]


def _checked(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise ConfigError(f"{name} {value!r}: give a finite number that is not negative")


def printed_drive(residual: float) -> float:
    """``c2 = eps^2 / 2`` of the printed lemma, for a residual ``eps`` of the acceleration model."""
    _checked(residual=residual)
    return 0.5 * residual**2


def stack_residual(
    count: int, stack_max: float, residual: float, window_s: float, velocity_noise: float = 0.0
) -> float:
    """Bound of ``|E|`` for ``count`` windows of ``window_s`` whose ends err by at most ``velocity_noise``."""
    _checked(
        count=count, stack_max=stack_max, residual=residual, window_s=window_s, velocity_noise=velocity_noise
    )
    return math.sqrt(count * stack_max) * (residual * window_s + 2.0 * velocity_noise)


def drive(residual: float, gain: float, stack_min: float, stack_error: float) -> float:
    """``c2' = eps^2 / 2 + k_W |E|^2 / (4 lambda)``.

    Parameters
    ----------
    residual : eps, bound of the model's residual
    gain : k_W, the learning gain (a multiple of the identity)
    stack_min : lambda, smallest eigenvalue of the stack
    stack_error : |E|, see ``stack_residual``

    Raises
    ------
    ConfigError
        If an argument is negative or not finite, or the stack has no full rank.
    """
    _checked(residual=residual, gain=gain, stack_min=stack_min, stack_error=stack_error)
    if stack_min == 0.0:
        raise ConfigError("stack_min 0.0: the stack must have full rank; give its smallest eigenvalue")
    return printed_drive(residual) + 0.25 * gain * stack_error**2 / stack_min


def growth_bound(start: float, rate: float, drive: float, t_s: float) -> float:
    """``V(t) <= (V_0 + c2/c5) exp(c5 t) - c2/c5`` (Lemma 5.3), for a rate c5 > 0.

    Raises
    ------
    ConfigError
        If an argument is negative or not finite, or the rate is zero.
    """
    _checked(start=start, rate=rate, drive=drive, t_s=t_s)
    if rate == 0.0:
        raise ConfigError("rate 0.0: give a growth rate above zero")
    return (start + drive / rate) * math.exp(rate * t_s) - drive / rate

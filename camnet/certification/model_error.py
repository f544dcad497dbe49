"""Where e_v comes from: Lyapunov bound, stated Lipschitz bounds, or residuals (docs/theory.md, section 8)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from camnet.certification.constants import Constants
from camnet.errors import CertificateError

__all__ = [
    "Conformal",
    "ModelError",
    "conformal_model_error",
    "extended_model_error",
    "gap_model_error",
    "lyapunov_model_error",
]


@dataclass(frozen=True, slots=True)
class Conformal:
    """Ask for e_v from gaps that the model was not calibrated on, at a confidence in (0, 1)."""

    confidence: float

    def __post_init__(self) -> None:
        if not 0.0 < self.confidence < 1.0:
            raise CertificateError(f"confidence = {self.confidence!r}: a number in (0, 1) is needed")


#: e_v as asked for: stated, m/s, from gaps, or None: from the world's own motion
ModelError = float | Conformal | None


def lyapunov_model_error(
    constants: Constants, gamma_inv_min: float, sigma_bar: float, eps_bar: float
) -> float:
    """Return e_v from the Lyapunov bound after excitation, V <= c_UB in the limit, m/s (deterministic)."""
    weight_error = math.sqrt(2.0 * constants.c_ub / gamma_inv_min)
    return sigma_bar * weight_error + eps_bar


def extended_model_error(
    at_border_mps: float, lipschitz_target: float, lipschitz_model: float, distance_m: float
) -> float:
    """Return e_v at a distance from where data were taken, from stated Lipschitz bounds of both fields, m/s."""
    return at_border_mps + (lipschitz_target + lipschitz_model) * distance_m


def conformal_model_error(residuals_mps: ArrayLike, confidence: float) -> float:
    """Return e_v from held-out residuals by split conformal prediction, m/s (statistical).

    It bounds the next exchangeable residual with probability at least ``confidence``; infinite when there are too few.

    Raises
    ------
    CertificateError
        if ``confidence`` is not in (0, 1).
    """
    if not 0.0 < confidence < 1.0:
        raise CertificateError(f"confidence = {confidence!r}: a number in (0, 1) is needed")
    ordered = np.sort(np.asarray(residuals_mps, dtype=float))
    rank = math.ceil((len(ordered) + 1) * confidence - 1e-12)
    return math.inf if rank > len(ordered) else float(ordered[max(rank, 1) - 1])


def gap_model_error(errors_m: ArrayLike, durations_s: ArrayLike, e0_m: float, confidence: float) -> float:
    """Return e_v from whole gaps by split conformal prediction, m/s (statistical).

    The score of a gap is the growth of its prediction's error, (error at the re-sighting - e(0)) / duration. The next
    exchangeable gap ends within e(0) + e_v tau with probability at least ``confidence``; that is one gap, not all.

    Parameters
    ----------
    errors_m, durations_s : (n,) of gaps that nothing was tuned on
    e0_m : position error allowed when the target is lost
    confidence : in (0, 1)

    Raises
    ------
    CertificateError
        if there are too few gaps for the confidence, or one has no duration.
    """
    error, duration = np.asarray(errors_m, dtype=float), np.asarray(durations_s, dtype=float)
    if len(duration) and not (duration > 0.0).all():
        raise CertificateError(f"durations_s: {float(duration.min()):g} s, every gap needs a duration > 0")
    found = conformal_model_error(np.maximum(error - e0_m, 0.0) / duration, confidence)
    if math.isinf(found):
        needed = math.ceil(confidence / (1.0 - confidence) - 1e-9)
        raise CertificateError(
            f"confidence = {confidence:g} needs at least {needed} gaps to calibrate on, there are {len(error)}: learn "
            "for longer (--duration) or ask for less (--confidence)"
        )
    return found

"""Where e_v comes from: Lyapunov bound, stated Lipschitz bounds, or residuals (docs/theory.md, section 8)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from camnet.certification.constants import Constants
from camnet.errors import CertificateError

__all__ = ["conformal_model_error", "extended_model_error", "lyapunov_model_error"]


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

r"""Average dwell time of parikh2018: time in view against time out of view over k cycles, (19)-(24).

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| T_on, T_off | sums over the k cycles of a block | s | before (18) |
| c4 / beta1 | ``lambda_g`` | 1/s | (21) |
| lambda, lambda_T | ``lambda_d``, ``lambda_dt`` | 1/s | (19), (20) |
| c6 or c8 | ``contraction`` | - | below (23), (24) |
| c7 or c9 | ``offset`` | m^2 | below (23), (24) |

Printed and repaired differ as follows. (22) uses lambda_T in Theorem 1 too, where excitation does not hold yet and the
decay is lambda; here each theorem uses its own rate. (21) drops c5 while unseen; ``sound`` keeps it. The ultimate
bound on the error is printed as beta1 c7/(1-c6) exp(.), but V >= beta1 |xi|^2 gives sqrt(V/beta1).
T(nk, (n+1)k) is read as the sum over the k cycles of a block.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from camnet.certification.constants import Constants
from camnet.errors import CertificateError

__all__ = ["AverageDwell", "average_dwell"]

#: beyond it exp overflows: the bound is then reported as infinite
_LARGEST_EXPONENT = 700.0


@dataclass(frozen=True, slots=True)
class AverageDwell:
    """Result of the condition over one block of cycles that is taken to repeat.

    Attributes
    ----------
    satisfied : whether (22) holds
    slack : lambda T_on - lambda_G T_off, > 0 when satisfied
    contraction : factor by which one block multiplies V at its start
    offset : what one block adds
    v_start : limit of V at the start of a block; inf when not satisfied
    v_peak : largest V within a block in the limit; inf when not satisfied
    error_bound : sqrt(2 v_peak / gamma1), bound of |xi| in the limit
    """

    satisfied: bool
    slack: float
    contraction: float
    offset: float
    v_start: float
    v_peak: float
    error_bound: float


def average_dwell(
    constants: Constants, on_s: Sequence[float], off_s: Sequence[float], *, excited: bool
) -> AverageDwell:
    """Apply parikh2018's condition to one block of cycles.

    Parameters
    ----------
    constants : of the wanted certificate (``published`` drops the growth's constant, as (21) does)
    on_s, off_s : lengths of the k intervals in view and out of view, s
    excited : Theorem 2 (finite excitation holds) or Theorem 1

    Raises
    ------
    CertificateError
        if the two sequences differ in length, are empty or hold a negative time.
    """
    if len(on_s) != len(off_s) or not on_s:
        raise CertificateError(
            f"on_s has {len(on_s)} and off_s {len(off_s)} intervals: equal numbers >= 1 needed"
        )
    if min(*on_s, *off_s) < 0.0:
        raise CertificateError("on_s and off_s must not hold negative times")
    c = constants
    rate, floor = (c.lambda_dt, c.c_ub) if excited else (c.lambda_d, c.beta1)
    slack = rate * math.fsum(on_s) - c.lambda_g * math.fsum(off_s)  # (22)
    contraction, offset, peaks = 1.0, 0.0, [(1.0, 0.0)]
    if c.lambda_g * max(off_s) > _LARGEST_EXPONENT:
        return AverageDwell(
            slack > 0.0, slack, math.exp(-slack) if slack > 0.0 else math.inf, *(math.inf,) * 4
        )
    for on, off in zip(on_s, off_s, strict=True):
        decay = math.exp(-rate * on)
        growth = math.exp(c.lambda_g * off)
        contraction, offset = contraction * decay, offset * decay + floor  # (19), (20)
        contraction, offset = contraction * growth, offset * growth + c.growth_offset * (growth - 1.0)  # (21)
        peaks.append((contraction, offset))
    if not slack > 0.0:
        return AverageDwell(False, slack, contraction, offset, math.inf, math.inf, math.inf)
    v_start = offset / (1.0 - contraction)  # fixed point of s -> c6 s + c7
    # while seen V may first stand at the level it came with plus the floor of (19)
    v_peak = max(a * v_start + b for a, b in peaks) + floor
    return AverageDwell(True, slack, contraction, offset, v_start, v_peak, math.sqrt(2.0 * v_peak / c.gamma1))

"""Smooth projection of parameter and pose rates onto bounded sets (Krstic et al. 1995, appendix E; parikh2018 (8)).

| symbol | name | unit |
| --- | --- | --- |
| W | ``weights`` | any shape |
| D | ``rate``: proposed rate | weights / s |
| W_bar | ``bound``: radius of the ball | as weights |
| eps | ``layer``: width of the boundary layer | as weights |

Inside the ball, or where the rate points inwards (<W, D> <= 0), the rate passes. In the layer it loses the fraction
``c = min(1, (|W|^2 - W_bar^2) / (eps^2 + 2 eps W_bar))`` of its outward part, so that W never leaves the ball of
radius ``W_bar + eps`` and the projected rate is Lipschitz in W.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["axis_factor", "project_rate", "project_step"]


def project_rate(weights: Array, rate: Array, bound: float, layer: float) -> Array:
    """Projected rate, of the shape of ``rate``."""
    outward = float(np.sum(weights * rate))
    norm2 = float(np.sum(weights * weights))
    if norm2 <= bound * bound or outward <= 0.0:
        return rate
    c = min(1.0, (norm2 - bound * bound) / (layer * layer + 2.0 * layer * bound))
    return np.asarray(rate - c * weights * outward / norm2)


@cached_njit
def project_step(before: Array, after: Array, columns: int, bound: float, layer: float) -> None:
    """Project the step from ``before`` to ``after`` (p, m) in place, over the first ``columns`` columns.

    A finite step can overshoot the layer, which no rate could do; what is left over is scaled back to its rim.
    """
    p = before.shape[0]
    norm2 = 0.0
    outward = 0.0
    for k in range(p):
        for o in range(columns):
            norm2 += before[k, o] * before[k, o]
            outward += before[k, o] * (after[k, o] - before[k, o])
    if norm2 > bound * bound and outward > 0.0:
        c = min(1.0, (norm2 - bound * bound) / (layer * layer + 2.0 * layer * bound))
        for k in range(p):
            for o in range(columns):
                after[k, o] -= c * before[k, o] * outward / norm2
    norm2 = 0.0
    for k in range(p):
        for o in range(columns):
            norm2 += after[k, o] * after[k, o]
    rim = bound + layer
    if norm2 > rim * rim:
        scale = rim / np.sqrt(norm2)
        for k in range(p):
            for o in range(columns):
                after[k, o] *= scale


@cached_njit
def axis_factor(x: float, rate: float, low: float, high: float, layer: float) -> float:
    """Factor in [0, 1] on one coordinate's rate that keeps it in [low - layer, high + layer]."""
    if rate > 0.0 and x > high:
        return 1.0 - min(1.0, (x - high) / layer)
    if rate < 0.0 and x < low:
        return 1.0 - min(1.0, (low - x) / layer)
    return 1.0

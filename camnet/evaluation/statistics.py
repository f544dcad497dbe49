"""Confidence intervals by the bootstrap, and comparisons of two agents on the same seeds.

Intervals are percentile bootstrap intervals of the mean over episodes (SciPy). A comparison takes the differences of
two agents on common seeds, which removes the luck of the draw that both share; its p-value is that of the sign-flip
permutation test, exact up to the number of resamples: under the hypothesis of no difference each seed's difference
is as likely with the other sign. Episodes in which a figure does not exist are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import bootstrap, permutation_test

from camnet.types import Array

__all__ = ["compare", "interval"]

_RESAMPLES = 9_999


def interval(values: Array, rng: np.random.Generator) -> dict[str, Any] | None:
    """Mean of (n,) figures with its 95 % interval, and n; None without any figure.

    The interval of a single episode, or of equal figures, is the figure itself.
    """
    there = np.asarray(values, dtype=float)
    there = there[np.isfinite(there)]
    if there.size == 0:
        return None
    mean = float(there.mean())
    if there.size == 1 or float(np.ptp(there)) == 0.0:
        return {"mean": mean, "ci95": [mean, mean], "n": int(there.size)}
    found = bootstrap((there,), np.mean, n_resamples=_RESAMPLES, method="percentile", rng=rng, batch=500)
    low, high = found.confidence_interval
    return {"mean": mean, "ci95": [float(low), float(high)], "n": int(there.size)}


def compare(ours: Array, theirs: Array, rng: np.random.Generator) -> dict[str, Any] | None:
    """Mean of ``ours - theirs`` over common seeds, its interval, and the two-sided p-value.

    Parameters
    ----------
    ours, theirs : (n,) figures of two agents, seed by seed
    """
    difference = np.asarray(ours, dtype=float) - np.asarray(theirs, dtype=float)
    difference = difference[np.isfinite(difference)]
    found = interval(difference, rng)
    if found is None:
        return None
    if difference.size == 1 or not difference.any():  # either sign of one difference is as extreme: p is 1
        return {**found, "p": 1.0}
    test = permutation_test(
        (difference,), np.mean, permutation_type="samples", n_resamples=_RESAMPLES, rng=rng, batch=500
    )
    return {**found, "p": float(test.pvalue)}

"""Which of several candidates: the conditional logit, taught by other people's choices.

``p(i | j) = exp(x_ij . b) / sum_k exp(x_kj . b)`` over the candidates of entry j (McFadden 1974, eq. 12), b at the
maximum of the likelihood with a small ridge. A density that is too sure of itself gets a coefficient below 1, so that
what comes out is calibrated.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from camnet.types import Array, BoolArray, IntArray

__all__ = ["cross_fitted", "fit_choice", "group_log_softmax"]

_RIDGE = 1e-3


def group_log_softmax(score: Array, group: IntArray, groups: int) -> Array:
    """Logarithm (m,) of each candidate's probability within its group (m,); -inf stays -inf."""
    top = np.full(groups, -np.inf)
    np.maximum.at(top, group, score)
    top = np.where(np.isfinite(top), top, 0.0)
    shifted = score - top[group]
    total = np.bincount(group, np.exp(shifted), groups)
    return np.asarray(shifted - np.log(np.maximum(total, 1e-300))[group])


def fit_choice(features: Array, right: BoolArray, group: IntArray, weight: Array) -> Array:
    """Coefficients (d,) from candidates' features (m, d), which are right (m,), groups (m,) and their weights (k,)."""
    first = np.zeros(features.shape[1])
    first[0] = 1.0
    total = float(weight[group][right].sum())
    if total <= 0.0:
        return first

    def loss(b: Array) -> tuple[float, Array]:
        log_p = group_log_softmax(features @ b, group, len(weight))
        w = weight[group]
        value = -float((w * log_p)[right].sum()) / total + _RIDGE * float(b @ b)
        slope = -((right - np.exp(log_p)) * w) @ features / total + 2.0 * _RIDGE * b
        return value, slope

    return np.asarray(minimize(loss, first, jac=True, method="L-BFGS-B").x)


def cross_fitted(
    features: Array, candidate: BoolArray, right: BoolArray, group: IntArray, fold: IntArray
) -> Array:
    """Scores (m,) of pairs, each with coefficients that the groups of other folds taught.

    Parameters
    ----------
    features : (m, d)
    candidate : (m,) pairs that are candidates; others are scored, and teach nothing
    right : (m,) the true pair of each group
    group, fold : (m,) group of each pair, (k,) fold of each group
    """
    out = np.zeros(len(features))
    for k in np.unique(fold):
        taught = (fold != k).astype(np.float64)
        b = fit_choice(features[candidate], right[candidate], group[candidate], taught)
        mine = fold[group] == k
        out[mine] = features[mine] @ b
    return out

"""Simulated appearance, stated by the share of right answers that it alone would give.

| symbol | name | shape |
| --- | --- | --- |
| z_k | identity vector of target k, standard normal | (d,) |
| a_m | descriptor of tracklet m, ``z + s n`` with n standard normal | (d,) |
| s | ``noise`` | - |

Two descriptors of one target are correlated by ``r = 1 / (1 + s^2)`` in each of their components, those of two
targets not at all. The logarithm of the likelihood ratio of both cases is that of two Gaussians, ``N(r a, (1 - r^2)
(1 + s^2))`` over ``N(0, 1 + s^2)``. ``s`` is found by bisection so that the best candidate by appearance alone is
the right one as often as stated.
"""

from __future__ import annotations

import numpy as np

from camnet.types import Array, BoolArray, IntArray

__all__ = ["appearance_ratio", "simulated_appearance"]

_SIZE = 16
_HALVINGS = 30


def appearance_ratio(a: Array, b: Array, noise: float) -> Array:
    """Logarithm (m,) of p(same target) / p(two targets) of descriptors (m, d) and (m, d)."""
    v = 1.0 + noise**2
    r = 1.0 / v
    left = v * (1.0 - r**2)
    gap, alone = np.sum((b - r * a) ** 2, axis=1), np.sum(b**2, axis=1)
    return np.asarray(-0.5 * (gap / left - alone / v) - 0.5 * a.shape[1] * np.log(left / v))


def simulated_appearance(
    rank1: float,
    pairs: tuple[IntArray, IntArray],
    target: IntArray,
    candidate: BoolArray,
    right: BoolArray,
    rng: np.random.Generator,
) -> tuple[Array, float]:
    """Log-likelihood ratios (m,) of pairs of tracklets, and the noise found.

    Parameters
    ----------
    rank1 : share of entries whose best candidate by appearance alone is right
    pairs : tracklets (m,) that were left and (m,) that were entered
    target : (n,) whose each tracklet is
    candidate, right : (m,) which pairs are candidates, which are the true ones
    """
    identity = rng.normal(size=(int(target.max()) + 1, _SIZE))[target]
    shake = rng.normal(size=identity.shape)

    def ratios(noise: float) -> Array:
        a = identity + noise * shake
        return appearance_ratio(a[pairs[0]], a[pairs[1]], noise)

    low, high = 0.01, 100.0
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        share = _alone(ratios(middle), pairs[1], candidate, right)
        low, high = (middle, high) if share > rank1 else (low, middle)
    return ratios(middle), middle


def _alone(score: Array, group: IntArray, candidate: BoolArray, right: BoolArray) -> float:
    best = np.full(int(group.max()) + 1, -np.inf)
    np.maximum.at(best, group[candidate], score[candidate])
    true = candidate & right
    return float(np.mean(score[true] >= best[group[true]]))

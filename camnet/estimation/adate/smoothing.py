"""Covariances of the smoothed trajectory, and observers whose errors do not average out.

| symbol | name | shape |
| --- | --- | --- |
| F_i, P_{i+1} | covariances of the forward pass: after the observations of step i, before those of i + 1 | (10,10) |
| Phi_i | derivative of the flow over step i | (10,10) |
| S_i | covariance of the smoothed state | (10,10) |

S_n = F_n, and backwards S_i = F_i + G (S_{i+1} - P_{i+1}) G^T with G = F_i Phi_i^T P_{i+1}^-1 (Rauch, Tung and
Striebel, AIAA Journal 3(8), 1965). Frozen states keep what the forward pass said when they were frozen.

**Drift.** The paper inflates R of observations far from the trajectory (39); it names no observer. Here an observer is
said to drift where the median of its last residuals, whitened and less the observers' median, is not that of noise:
T = N / (pi / 2) |median|^2 is chi-square with 3 degrees of freedom for large N without drift, and a lone outlier moves
no median. With fewer than three observers there is no majority, and nobody is named.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from camnet.estimation.adate.chain import full_phi
from camnet.types import Array, BoolArray

if TYPE_CHECKING:
    from camnet.estimation.adate.track import Track

__all__ = ["drifting", "keep_frozen", "outlying", "smoothed_covariances"]

#: residuals that are looked at, the fewest, and T above which an observer drifts (chance 1e-8 for clean noise)
_LAST, _FEWEST, _DRIFTS = 24, 12, 40.0
#: of `camnet.estimation.adate.weights`: number of residuals that the covariance as given is worth
_LEAST_OBSERVERS = 3


def keep_frozen(track: Track, count: int) -> None:
    """Keep what the forward pass said of the window's first ``count`` states, which are about to be frozen."""
    w = track.win
    track.frozen += [
        (w.filt_p[i].copy(), full_phi(w.jac[i]), w.pred_p[i + 1].copy()) for i in range(min(count, w.n - 1))
    ]


def smoothed_covariances(track: Track) -> Array:
    """Return the covariances S (k,10,10) of all states so far."""
    w, n = track.win, track.steps
    passed = [*track.frozen, *((w.filt_p[i], full_phi(w.jac[i]), w.pred_p[i + 1]) for i in range(w.n - 1))]
    out = np.empty((n, 10, 10))
    out[-1] = track.causal_cov if not w.seen[-1] else w.filt_p[-1]
    for i in range(n - 2, -1, -1):
        filtered, phi, predicted = passed[i]
        gain = cho_solve(cho_factor(predicted), phi @ filtered).T
        out[i] = filtered + gain @ (out[i + 1] - predicted) @ gain.T
        out[i] = 0.5 * (out[i] + out[i].T)
    return out


def outlying(track: Track) -> dict[int, bool]:
    """Return, by observer, whether its observation of the last step is far from what the others and it said before."""
    w = track.win
    return {name: not bool(w.sound[-1, slot]) for name, slot in track.ids.items() if w.has[-1, slot]}


def drifting(track: Track) -> dict[int, bool]:
    """Return, by observer, whether its last residuals do not average out; see the module."""
    w = track.win
    has = w.has.astype(bool)
    seen = [slot for slot in track.ids.values() if has[:, slot].any()]
    found = dict.fromkeys(track.ids, False)
    if len(seen) < _LEAST_OBSERVERS:
        return found
    residual = w.obs - w.s[:, None, :3]
    for name, slot in track.ids.items():
        rows = np.flatnonzero(has[:, slot])[-_LAST:]
        if len(rows) >= _FEWEST:
            found[name] = _statistic(track, residual[rows], has[rows], slot, rows) > _DRIFTS
    return found


def _statistic(track: Track, residual: Array, has: BoolArray, slot: int, rows: np.ndarray) -> float:
    """T of one observer over the steps ``rows``."""
    common = np.array(
        [np.median(r[h], axis=0) if h.sum() >= 3 else np.zeros(3) for r, h in zip(residual, has, strict=True)]
    )
    own = residual[:, slot] - common
    weight, prior = track.weight[slot], track.rule_par[5]
    mixed = (prior * np.eye(3) + weight * track.scale[slot]) / (prior + weight)
    whitened = np.empty_like(own)
    for k, row in enumerate(rows):
        low = np.linalg.cholesky(track.win.given[row, slot])
        whitened[k] = np.linalg.solve(np.linalg.cholesky(low @ mixed @ low.T), own[k])
    middle = np.median(whitened, axis=0)
    return float(len(rows) / (0.5 * np.pi) * (middle @ middle))

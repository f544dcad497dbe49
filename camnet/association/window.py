"""Who came back, decided again when more was seen: one-to-one assignment over a sliding window.

The decision about entry j at time t_j waits until ``tau = t_j + window``. Candidates are the gaps that were open at
t_j; what happened in between stands beside it: the entries until tau (whose they are nobody says) and the exits
until tau. Every entry belongs to one exit, and an exit has at most one entry. An exit that has none until tau
weighs S_i(tau), one with entry k weighs f_i(t_k - t_i, y_k), so that ``W_ik = f_i(t_k - t_i, y_k) / S_i(tau -
t_i)`` in `camnet.association.marginals`.

That a gap was open at t_j is known as in a decision at once. Which gaps close after t_j is not used: a true closing
time would give the answer away, because the gap of an entry is the one that closes with it.
"""

from __future__ import annotations

import numpy as np

from camnet.association.marginals import assignment_marginals
from camnet.association.tracklets import Tracklets
from camnet.types import Array, IntArray

__all__ = ["SURVIVAL_GRID_S", "window_probabilities"]

#: times away at which the survival of every exit is known, s
SURVIVAL_GRID_S = np.exp(np.linspace(np.log(0.5), np.log(7200.0), 32))


def window_probabilities(
    tracklets: Tracklets, pairs: tuple[IntArray, IntArray], log_f: Array, log_s: Array, window_s: float
) -> Array:
    """Probability (m,) of each pair of an exit and an entry, decided a window later; 0 for gaps that were not open.

    Parameters
    ----------
    tracklets : n stays in view
    pairs : exits (m,) and entries (m,), entries ascending; all pairs that can stand in one window
    log_f : (m,) logarithm of f; a column of it may have any factor
    log_s : (n, grid) logarithm of the survival of every exit at ``SURVIVAL_GRID_S``
    window_s : how long a decision waits, s
    """
    which, to = pairs
    n = len(tracklets.exits.t_s)
    begin = np.searchsorted(to, np.arange(n + 1))
    entries = tracklets.resighted
    times = tracklets.entries.t_s[entries]
    out = np.zeros(len(which))
    row = np.full(n, -1)
    for q, j in enumerate(entries):
        tau = times[q] + window_s
        there = np.flatnonzero((tracklets.exits.t_s < tau) & (tracklets.open_until_s >= times[q]))
        columns = np.r_[j, entries[q + 1 : np.searchsorted(times, tau, side="right")]]
        row[there] = np.arange(len(there))
        away = np.minimum(tau, tracklets.recorded_until_s[there]) - tracklets.exits.t_s[there]
        unlinked = _survival(log_s[there], away)
        weights = np.zeros((len(there), len(columns)))
        for c, k in enumerate(columns):
            mine = slice(begin[k], begin[k + 1])
            at = row[which[mine]]
            ok = at >= 0
            if not ok.any():
                continue
            log_w = log_f[mine][ok] - unlinked[at[ok]]
            weights[at[ok], c] = np.exp(log_w - log_w.max())
        weights = weights[:, weights.max(axis=0) > 0.0]
        mine = slice(begin[j], begin[j + 1])
        at = row[which[mine]]
        good = (at >= 0) & (tracklets.exits.t_s[which[mine]] < times[q])
        chance = assignment_marginals(weights)[:, 0]
        out[mine] = np.where(good, chance[np.maximum(at, 0)], 0.0)
        row[there] = -1
    return out


def _survival(log_s: Array, away_s: Array) -> Array:
    """Logarithm (n,) of the survival after ``away_s`` (n,), between the values of the grid (n, g)."""
    low, high = np.log(SURVIVAL_GRID_S[0]), np.log(SURVIVAL_GRID_S[-1])
    steps = len(SURVIVAL_GRID_S) - 1
    x = np.clip((np.log(np.maximum(away_s, 1e-3)) - low) / (high - low) * steps, 0.0, steps - 1e-9)
    a = x.astype(np.int64)
    rows = np.arange(len(away_s))
    return np.asarray(log_s[rows, a] * (a + 1 - x) + log_s[rows, a + 1] * (x - a))

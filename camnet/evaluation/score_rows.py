"""What `camnet.evaluation.scores.EpisodeRecorder` takes down, for many episodes at once: arrays with the episode first.

The distances between sets are found by trying every assignment while targets are few, and by SciPy's solver beyond
that. Identities are counted one by one only where a match may change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from camnet.evaluation.scores import Score, score_of
from camnet.evaluation.set_metrics import IdentityCounter
from camnet.types import Array, BoolArray

__all__ = ["RecorderRows", "set_distances"]

#: up to so many targets every assignment is tried (4! = 24)
_FEW = 4
_ORDER = 2.0


def set_distances(distance: Array, known: BoolArray, cutoff_m: float) -> tuple[Array, Array]:
    """OSPA and GOSPA (E,), m, order 2, of sets of M targets each.

    Parameters
    ----------
    distance : (E, M, M) from each target to each estimate, m; anything where there is no estimate
    known : (E, M) which estimates there are
    """
    most, m = cutoff_m**_ORDER, distance.shape[1]
    cost = np.where(known[:, None, :], np.minimum(distance, cutoff_m) ** _ORDER, most)
    if m <= _FEW:
        choices = np.array(list(permutations(range(m))))
        total = cost[:, np.arange(m), choices].sum(axis=2).min(axis=1)
    else:
        total = np.array([c[linear_sum_assignment(c)].sum() for c in cost])
    # a target without an estimate has cost c^p in OSPA (3), and c^p / 2 in GOSPA (1)
    missed = m - known.sum(axis=1)
    gospa = np.maximum(total - 0.5 * most * missed, 0.0) ** (1.0 / _ORDER)
    return (total / m) ** (1.0 / _ORDER), gospa


class RecorderRows:
    """Takes E episodes with M targets down.

    Parameters
    ----------
    episodes, targets : E, M
    cutoff_m : cutoff of OSPA, GOSPA and matches
    """

    def __init__(self, episodes: int, targets: int, cutoff_m: float) -> None:
        self.cutoff_m = cutoff_m
        self._identity = [IdentityCounter(cutoff_m) for _ in range(episodes)]
        self._partner = np.full((episodes, targets), -1)
        self._return = np.zeros(episodes)
        self._squares = np.zeros((episodes, 2, 2))  # unseen, seen; sum and count
        self._sets = np.zeros((episodes, 3))  # sums of OSPA and GOSPA, count

    def add(
        self,
        live: NDArray[np.intp],
        rewards: Array,
        truth: Array,
        estimates: Array,
        known: BoolArray,
        seen: BoolArray,
    ) -> None:
        """Take down one decision of the ``live`` (K,) episodes.

        Parameters
        ----------
        rewards : (K,)
        truth, estimates : (K, M, 3) positions in the world, m
        known, seen : (K, M) whether a target was ever seen, and is seen now
        """
        self._return[live] += rewards
        square = np.where(known, ((estimates - truth) ** 2).sum(axis=2), 0.0)
        for k, which in enumerate((known & ~seen, known & seen)):
            self._squares[live, k, 0] += np.where(which, square, 0.0).sum(axis=1)
            self._squares[live, k, 1] += which.sum(axis=1)
        away = np.linalg.norm(truth[:, :, None] - estimates[:, None], axis=3)
        away = np.where(known[:, None, :], away, np.inf)
        ospa, gospa = set_distances(away, known, self.cutoff_m)
        self._sets[live] += np.stack([ospa, gospa, np.ones(len(live))], axis=1)
        self._identify(live, away, truth, estimates, known)

    def _identify(
        self, live: NDArray[np.intp], away: Array, truth: Array, estimates: Array, known: BoolArray
    ) -> None:
        """Count identity switches; nothing happens where all matches hold and no free pair is near."""
        partner, labels = self._partner[live], np.arange(known.shape[1])
        near = away <= self.cutoff_m  # (K, targets, estimates)
        holds = (partner[:, :, None] == labels) & near
        free = near & ~holds.any(axis=2)[:, :, None] & ~holds.any(axis=1)[:, None, :]
        changes = free.any(axis=(1, 2)) | (holds.sum(axis=1) > 1).any(axis=1)
        for k in np.flatnonzero(changes).tolist():
            counter, there = self._identity[live[k]], known[k]
            counter.add(truth[k], estimates[k, there], np.flatnonzero(there).tolist())
            self._partner[live[k]] = [counter.partner_of(row) for row in labels.tolist()]

    def score(self, e: int, episode: Mapping[str, Any]) -> Score:
        """Put the figures of episode ``e`` together; ``episode`` is what the environment reports at its end."""
        unseen, seen = self._squares[e]
        count = self._sets[e, 2]
        return score_of(
            episode,
            {
                "return": float(self._return[e]),
                "position_rmse_seen_m": _root(*seen),
                "position_rmse_unseen_m": _root(*unseen),
                "ospa_m": float(self._sets[e, 0] / count) if count else math.nan,
                "gospa_m": float(self._sets[e, 1] / count) if count else math.nan,
                "id_switches": float(self._identity[e].switches),
            },
        )


def _root(total: float, count: float) -> float:
    return math.sqrt(total / count) if count else math.nan

r"""Hitting sets of least cost whose rows come one after another: min w^T x, sum_{c in row} x_c >= need, x binary.

``relaxed`` (linear programme) and ``exact`` (integer programme, HiGHS) return lower bounds of the cost of any set that
hits all rows, so of any set that hits further rows as well. ``greedy`` adds the candidate that hits most open rows for
its cost, and then drops what is not needed. ``at_most`` bounds how many of some candidates are chosen: a camera that
stands can be turned one way or another, not both; the greedy choice may then find no set where one exists.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

from camnet.types import Array, IntArray

__all__ = ["HittingSet"]


class HittingSet:
    """A hitting-set problem over ``len(cost)`` candidates that grows by rows.

    Attributes
    ----------
    rows : sets of candidates, in the order in which they came, and how many of each must be chosen
    """

    def __init__(self, cost: Array, at_most: Sequence[tuple[IntArray, int]] = ()) -> None:
        self._cost = np.asarray(cost, dtype=float)
        self.rows: dict[tuple[int, ...], int] = {}
        self._most = np.array([bound for _, bound in at_most], dtype=float)
        ptr = np.cumsum([0, *(len(members) for members, _ in at_most)])
        columns = np.concatenate([np.zeros(0, dtype=np.int64), *(members for members, _ in at_most)])
        self._groups = csr_matrix(
            (np.ones(len(columns)), columns, ptr), shape=(len(at_most), len(self._cost))
        )

    def add(self, rows: Iterable[Iterable[int]], need: int = 1) -> int:
        """Add rows of which ``need`` candidates must be chosen; returns how many were new."""
        before = len(self.rows)
        for row in rows:
            key = tuple(sorted(set(row)))
            self.rows[key] = max(need, self.rows.get(key, 0))
        return len(self.rows) - before

    def _needs(self) -> Array:
        return np.array(list(self.rows.values()), dtype=float)

    def _matrix(self) -> csr_matrix:
        rows = list(self.rows)
        ptr = np.cumsum([0, *(len(row) for row in rows)])
        columns = np.fromiter((c for row in rows for c in row), dtype=np.int64, count=int(ptr[-1]))
        return csr_matrix((np.ones(len(columns)), columns, ptr), shape=(len(rows), len(self._cost)))

    def greedy(self, chosen: Iterable[int] = ()) -> IntArray:
        """Complete a set until it hits every row; returns sorted numbers.

        Raises
        ------
        ValueError
            It gets stuck: no candidate that may still be chosen hits an open row.
        """
        matrix = self._matrix().tocsc()
        have = list(dict.fromkeys(chosen))
        need = self._needs()
        hits = np.asarray(matrix[:, have].sum(axis=1), dtype=float).ravel()
        while (open_rows := hits < need - 0.5).any():
            worth = (matrix.T @ open_rows.astype(float)) / self._cost
            worth[have] = -1.0
            if len(self._most):
                full = np.asarray(self._groups[:, have].sum(axis=1)).ravel() >= self._most - 0.5
                worth[(self._groups.T @ full.astype(float)) > 0.0] = -1.0
            best = int(np.argmax(worth))
            if worth[best] <= 0.0:
                raise ValueError("no candidate that may still be chosen hits an open row")
            have.append(best)
            hits[matrix.indices[matrix.indptr[best] : matrix.indptr[best + 1]]] += 1.0
        for c in sorted(have, key=lambda k: (-self._cost[k], k)):
            rows = matrix.indices[matrix.indptr[c] : matrix.indptr[c + 1]]
            if len(rows) == 0 or (hits[rows] - need[rows]).min() > 0.5:
                hits[rows] -= 1.0
                have.remove(c)
        return np.array(sorted(have), dtype=np.int64)

    def relaxed(self) -> tuple[Array, float]:
        """Return the shares of the linear programme's solution and its value."""
        rows = [LinearConstraint(self._matrix(), lb=self._needs()), *self._bounds(np.arange(len(self._cost)))]
        result = milp(self._cost, bounds=Bounds(0, 1), constraints=rows)
        return np.asarray(result.x), float(result.fun)

    def _bounds(self, columns: IntArray, kept: IntArray | None = None) -> list[LinearConstraint]:
        """Return how many of the ``columns`` may be chosen beside those ``kept``."""
        if not len(self._most):
            return []
        used = 0.0 if kept is None else np.asarray(self._groups[:, kept].sum(axis=1)).ravel()
        return [LinearConstraint(self._groups[:, columns], ub=self._most - used)]

    def exact(
        self, time_limit_s: float, gap: float, free: IntArray | None = None, kept: IntArray | None = None
    ) -> tuple[IntArray, float] | None:
        """Return a set of candidates that hits all rows, within a relative ``gap`` of the best, and a lower bound.

        Parameters
        ----------
        time_limit_s, gap : when to stop
        free : (n,) candidates to choose from; None: all
        kept : candidates that are chosen besides; the rows need fewer others by those that they hold, and their cost
            is left out

        Returns
        -------
        tuple or None
            None: no such set was found in time.
        """
        of, need = self._matrix(), self._needs()
        if kept is not None:
            need = need - np.asarray(of[:, kept].sum(axis=1)).ravel()
            of, need = of[need > 0.5], need[need > 0.5]
        columns = np.arange(len(self._cost)) if free is None else free
        if of.shape[0] == 0:
            return np.array([], dtype=np.int64), 0.0
        result = milp(
            self._cost[columns],
            integrality=np.ones(len(columns), dtype=np.int64),
            bounds=Bounds(0, 1),
            constraints=[LinearConstraint(of[:, columns], lb=need), *self._bounds(columns, kept)],
            options={"time_limit": time_limit_s, "mip_rel_gap": gap},
        )
        if result.x is None:
            return None
        bound = result.mip_dual_bound
        return columns[result.x > 0.5], float(bound) if bound is not None else 0.0

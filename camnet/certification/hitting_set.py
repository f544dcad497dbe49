r"""Hitting sets of least cost whose rows come one after another: min w^T x, sum_{c in row} x_c >= need, x binary.

``relaxed`` (linear programme) and ``exact`` (integer programme, HiGHS) return lower bounds of the cost of any set that
hits all rows, so of any set that hits further rows as well. ``greedy`` adds the candidate that hits most open rows for
its cost, and then drops what is not needed. ``at_most`` bounds how many of some candidates are chosen: a camera that
stands can be turned one way or another, not both; the greedy choice may then find no set where one exists. ``within``
looks for a set that costs a budget at most, without such bounds (``hitting_search``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix, vstack

from camnet.certification.hitting_search import search_hitting_set
from camnet.types import Array, BoolArray, IntArray

__all__ = ["HittingSet", "Inequality"]

#: columns, their numbers, least sum
Inequality = tuple[IntArray, Array, float]
#: looser than this, an inequality is forgotten: it can be found again
_LOOSE = 0.3
#: random numbers for one search
_DRAWS = 4096


class HittingSet:
    """A hitting-set problem over ``len(cost)`` candidates that grows by rows.

    Attributes
    ----------
    rows : sets of candidates, in the order in which they came, and how many of each must be chosen
    inequalities : further ones that every answer keeps; they only make bounds sharper
    """

    def __init__(self, cost: Array, at_most: Sequence[tuple[IntArray, int]] = ()) -> None:
        self._cost = np.asarray(cost, dtype=float)
        self._most = np.array([bound for _, bound in at_most], dtype=float)
        ptr = np.cumsum([0, *(len(members) for members, _ in at_most)])
        columns = np.concatenate([np.zeros(0, dtype=np.int64), *(members for members, _ in at_most)])
        self._groups = csr_matrix(
            (np.ones(len(columns)), columns, ptr), shape=(len(at_most), len(self._cost))
        )
        self.rows: dict[tuple[int, ...], int] = {}
        self.inequalities: list[Inequality] = []
        n = len(self._cost)
        self._weight: dict[tuple[int, ...], float] = {}
        self._stamp = np.zeros(n, dtype=np.int64)
        self._free = np.ones(n, dtype=np.bool_)
        self._kept: tuple[int, csr_matrix] | None = None

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
        if self._kept is None or self._kept[0] != len(self.rows):
            rows = list(self.rows)
            ptr = np.cumsum([0, *(len(row) for row in rows)])
            columns = np.fromiter((c for row in rows for c in row), dtype=np.int64, count=int(ptr[-1]))
            ones = np.ones(len(columns))
            self._kept = len(rows), csr_matrix((ones, columns, ptr), shape=(len(rows), len(self._cost)))
        return self._kept[1]

    def _all(self) -> tuple[csr_matrix, Array]:
        """Return rows and inequalities as one matrix, and the least sum of each."""
        matrix, need = self._matrix(), self._needs()
        if not self.inequalities:
            return matrix, need
        columns, numbers, least = zip(*self.inequalities, strict=True)
        ptr = np.cumsum([0, *map(len, columns)])
        more = csr_matrix(
            (np.concatenate(numbers), np.concatenate(columns), ptr), shape=(len(least), len(self._cost))
        )
        return vstack([matrix, more], format="csr"), np.concatenate([need, least])

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

    def within(
        self, budget: float, chosen: BoolArray, visits: int, rng: np.random.Generator
    ) -> tuple[bool, int]:
        """Change ``chosen`` (a flag for each candidate) until it hits all rows for at most ``budget``.

        Returns whether it does, and how many entries were looked at; ``visits`` ends the search.
        """
        rows = self._matrix()
        columns = rows.tocsc()
        weight = np.array([self._weight.get(row, 1.0) for row in self.rows])
        found, done = search_hitting_set(
            rows.indptr.astype(np.int64),
            rows.indices.astype(np.int64),
            columns.indptr.astype(np.int64),
            columns.indices.astype(np.int64),
            self._needs().astype(np.int64),
            self._cost,
            chosen,
            weight,
            self._stamp,
            self._free,
            float(budget),
            visits,
            rng.random(_DRAWS),
        )
        self._weight = dict(zip(self.rows, weight.tolist(), strict=True))
        return bool(found), int(done)

    def relaxed(self) -> tuple[Array, float]:
        """Return the shares of the linear programme's solution and its value."""
        matrix, least = self._all()
        rows = [LinearConstraint(matrix, lb=least), *self._bounds()]
        result = milp(self._cost, bounds=Bounds(0, 1), constraints=rows)
        return np.asarray(result.x), float(result.fun)

    def _bounds(self) -> list[LinearConstraint]:
        """Return how many of some candidates may be chosen."""
        return [LinearConstraint(self._groups, ub=self._most)] if len(self._most) else []

    def forget_loose(self, x: Array) -> None:
        """Forget inequalities that a solution ``x`` of the linear programme does not need."""
        self.inequalities = [q for q in self.inequalities if float(q[1] @ x[q[0]]) < q[2] + _LOOSE]

    def exact(self, nodes: int, time_limit_s: float) -> tuple[IntArray | None, float, int]:
        """Look for the cheapest set that hits all rows and keeps the inequalities.

        Returns
        -------
        tuple
            The set (None: none was found), a lower bound of the cost of any, and the nodes of the search tree that it
            took; ``nodes`` and ``time_limit_s`` end it.
        """
        matrix, least = self._all()
        result = milp(
            self._cost,
            integrality=np.ones(len(self._cost), dtype=np.int64),
            bounds=Bounds(0, 1),
            constraints=[LinearConstraint(matrix, lb=least), *self._bounds()],
            options={"node_limit": nodes, "time_limit": time_limit_s, "mip_rel_gap": 0.0},
        )
        if result.x is None:
            return None, 0.0, nodes
        bound = result.mip_dual_bound
        taken = max(1, int(result.mip_node_count or 1))
        return np.flatnonzero(result.x > 0.5), float(bound) if bound is not None else 0.0, taken

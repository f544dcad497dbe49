"""Since when finite excitation holds, for rows of estimators: what `MotionModel` books in ``integral`` and ``visited``.

Rows keep no Gram matrix (their law needs its inverse alone). Here it is followed from the windows that they hold;
nothing of it is in a loop over environments.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.batch.estimator_columns import ACTIVE, CAPACITY, FORGOTTEN, WINDOWS
from camnet.batch.estimator_layout import EstimatorState
from camnet.batch.estimator_parts import counts_of, row_of
from camnet.batch.estimator_setup import EstimatorSetup
from camnet.estimation.excitation import VisitedExcitation
from camnet.estimation.settings import StackSettings
from camnet.estimation.stack import is_excited
from camnet.types import Array

__all__ = ["RowExcitation"]


class RowExcitation:
    """Excitation of one model of one row.

    Parameters
    ----------
    setup, state : of the row
    row, model : their numbers
    stack : threshold and share
    """

    def __init__(
        self, setup: EstimatorSetup, state: EstimatorState, row: int, model: int, stack: StackSettings
    ) -> None:
        self._rules, self._flags, self._data, self._model = (
            setup.rules,
            state.flags[row],
            state.data[row],
            model,
        )
        self._threshold = stack.excitation_threshold
        self._visited = VisitedExcitation(stack.excitation_threshold, stack.excitation_share)
        self._counts = counts_of.py_func(setup.rules, self._flags, model)
        p = setup.rules.size
        # before the window that was offered last
        self._gram, self._touched = np.zeros((p, p)), np.zeros(p, dtype=bool)
        self._held = self._forgotten = 0
        #: since when the stack is of full rank (3-19), s
        self.full_s = math.inf

    @property
    def visited_s(self) -> float:
        """Since when the places visited are excited, s."""
        self._forget()
        return self._visited.since_s

    def offered(self, t_s: float, row: Array) -> None:
        """Take note that a measured window with regressor ``row`` (p,) over the active kernels was offered."""
        self._forget()
        self._observe(t_s, row)
        held, whole = int(self._counts[WINDOWS]), int(self._counts[ACTIVE]) == len(self._gram)
        if whole or held == self._flags[CAPACITY]:
            self._follow(held)
        if not (whole and is_excited(self._gram, self._threshold)):
            self.full_s = math.inf
        elif math.isinf(self.full_s):
            self.full_s = t_s

    def _observe(self, t_s: float, row: Array) -> None:
        """Ask whether the window was news to those before it."""
        if self._counts[WINDOWS] < self._flags[CAPACITY]:  # every window enters, this one was the last
            self._follow(int(self._counts[WINDOWS]) - 1)
        n = int(self._counts[ACTIVE])
        psi, known, total = self._gram[:n, :n], row[:n], float(row @ row)
        if not self._touched[:n].all():
            pick = np.flatnonzero(self._touched)
            psi, known = self._gram[np.ix_(pick, pick)], row[pick]
        if len(known):
            self._visited.observe(t_s, psi, known, total - float(known @ known))

    def _forget(self) -> None:
        """Start again if data was forgotten."""
        forgotten = int(self._counts[FORGOTTEN])
        if forgotten != self._forgotten:
            self._forgotten, self._held, self.full_s = forgotten, 0, math.inf
            self._visited.clear()

    def _rows(self, first: int) -> Array:
        """Regressors of the windows held from number ``first`` on, over the active kernels."""
        n, held, padded = int(self._counts[ACTIVE]), int(self._counts[WINDOWS]), self._rules.at.padded
        flat = row_of.py_func(self._rules, self._flags, self._data, self._model, first)
        rows: Array = flat[: (held - first) * padded].reshape(held - first, padded)[:, :n]
        return rows

    def _follow(self, held: int) -> None:
        """Bring the Gram matrix up to the first ``held`` windows; in a full stack any of them may be new."""
        if self._held == 0 or held < self._held or held == self._flags[CAPACITY]:
            self._gram[...] = 0.0
            self._held = 0
        new = self._rows(self._held)[: held - self._held]
        n = new.shape[1]
        self._gram[:n, :n] += new.T @ new
        self._touched[:n] |= (new != 0.0).any(axis=0)
        self._held = held

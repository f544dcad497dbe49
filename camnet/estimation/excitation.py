"""Finite excitation where the target has been (harris2020 (3-19), for a target that keeps to roads).

| symbol | name | unit |
| --- | --- | --- |
| Psi | ``psi``: composite history stack | s^2 |
| lambda_lo | ``threshold`` | s^2 |
| P | projector onto the eigenvectors of Psi with eigenvalues of at least lambda_lo | - |
| Y | ``row``: a new window's regressor, not yet in Psi | s |
| rho^2 | ``unexcited_share``: bound of norm((I - P) Y)^2 / norm(Y)^2 | - |

(3-19) asks for lambda_min(Psi) >= lambda_lo over all p kernels. Kernels that the target never comes near make that
impossible, and so do kernels beside its road: along a line, a row of kernels across it is one function many times over,
whatever subset is kept by its activation. What predictions at the places visited need is less: that regressors there
lie in P. This is a diagnosis, and opens no case of a certificate: P changes with the stack (docs/theory.md, section 3).

Whether regressors lie in P must be asked of windows that are not in the stack yet. An eigenvector with an eigenvalue
below delta > 0 has delta / (lambda + delta) > 1/2, hence

    |(I - P) Y|^2 <= 2 delta Y (Psi + delta I)^-1 Y^T,      delta = lambda_lo.

Excitation holds while the last ``RUN`` measured windows in a row were in P to within the share rho before they were
learned: on a first pass each window is news, on the second it is not. A window that is news ends it.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.types import Array

__all__ = ["RUN", "VisitedExcitation", "unexcited_share"]

#: windows in a row that must be no news
RUN = 10


def unexcited_share(psi: Array, row: Array, threshold: float, rest: float = 0.0) -> float:
    """Bound of the share of a regressor, squared norms, outside the excited eigenvectors of ``psi`` (n, n).

    ``row`` (n,) is the regressor over the kernels of ``psi``, ``rest`` the squared norm of what it holds beyond them.
    """
    total = float(row @ row) + rest
    if total <= 0.0:
        return 1.0
    raised = psi.copy()
    raised.flat[:: len(row) + 1] += threshold
    solved = np.linalg.solve(raised, row)
    return min(1.0, (rest + 2.0 * threshold * float(row @ solved)) / total)


class VisitedExcitation:
    """Watches new windows; ``since_s`` is since when excitation holds (inf while it does not)."""

    def __init__(self, threshold: float, share: float) -> None:
        self._threshold = threshold
        self._square = share * share
        self._run = 0
        self.since_s = math.inf

    def clear(self) -> None:
        """Start again: data was forgotten."""
        self._run, self.since_s = 0, math.inf

    def observe(self, t_s: float, psi: Array, row: Array, rest: float = 0.0) -> None:
        """Take note of a measured window that ``psi`` (n, n) does not hold yet; see ``unexcited_share``."""
        known = unexcited_share(psi, row, self._threshold, rest) <= self._square
        self._run = self._run + 1 if known else 0
        if not known:
            self.since_s = math.inf
        elif self._run >= RUN and math.isinf(self.since_s):
            self.since_s = t_s

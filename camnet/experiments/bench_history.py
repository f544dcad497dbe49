"""Speed of the exact smallest-eigenvalue selection, beside brute force and one eigendecomposition."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from camnet.estimation.basis import RbfBasis
from camnet.estimation.placement import grid_centres
from camnet.estimation.selection import SmallestEigenvalueRule
from camnet.estimation.selection_secular import SecularEigenvalueRule
from camnet.types import Array

__all__ = ["CASES", "run"]

#: stack size, kernels along each side of the grid; candidates compared with brute force
CASES = ((600, 9, 3), (2000, 13, 1))
SPACING_M = 0.3
VARIANCE_M2 = 0.3
WINDOW_S = 0.4
SPEED_MPS = 0.4


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Time each case, in CPU time; each time is the least of many.

    The rows are windows over the kernels of parikh2018, section VII, with a hundredth of white noise: without it the
    smallest eigenvalue is below rounding there, and no rule could be compared.
    """
    cases = []
    for number, (n, side, candidates) in enumerate(CASES):
        rng = np.random.default_rng([seed, number])
        rows = window_rows(rng, n + 8, side)
        cases.append(_case(rows[:n], rows[n:], candidates))
        if progress is not None:
            progress((number + 1) / len(CASES))
    return {"cases": cases}


def window_rows(rng: np.random.Generator, count: int, side: int) -> Array:
    """Return regressors (count, side^2) of straight windows anywhere on a grid of kernels, and a little white noise."""
    extent = SPACING_M * (side - 1)
    centres = grid_centres(np.zeros(2), np.full(2, extent - 1e-9), SPACING_M)
    basis = RbfBasis.create(centres, VARIANCE_M2)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    rows = np.empty((count, basis.size))
    for k in range(count):
        start = rng.uniform(0.0, extent, 2)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        way = SPEED_MPS * WINDOW_S * np.array([np.cos(angle), np.sin(angle)])
        ends = [np.append(start + share * way, 0.0) for share in (0.0, 0.5, 1.0)]
        sigma = [basis(p, q) for p in ends]
        rows[k] = WINDOW_S / 6.0 * (sigma[0] + 4.0 * sigma[1] + sigma[2])
    return np.asarray(rows + 0.01 * WINDOW_S * rng.standard_normal(rows.shape))


def _case(rows: Array, offered: Array, candidates: int) -> dict[str, Any]:
    n, p = rows.shape
    gram = rows.T @ rows
    fast, naive = SecularEigenvalueRule(n, p, 1e-3), SmallestEigenvalueRule()
    # the first call finds lambda_min of the stack, which later calls know already
    fast.choose(offered[0], rows, gram)
    naive_ms, identical = np.inf, True
    for row in offered[:candidates]:
        start = time.process_time()
        expected = naive.choose(row, rows, gram)
        naive_ms = min(naive_ms, 1e3 * (time.process_time() - start))
        identical &= fast.choose(row, rows, gram) == expected and fast.name == "lambda_min"
    fast_ms = max(_least_ms(lambda row=row: fast.choose(row, rows, gram)) for row in offered)  # type: ignore[misc]
    eigh_ms = _least_ms(lambda: np.linalg.eigh(gram))
    return {
        "n": n,
        "p": p,
        "naive_ms": naive_ms,
        "fast_ms": fast_ms,
        "eigh_ms": eigh_ms,
        "fast_over_eigh": fast_ms / eigh_ms,
        "identical": bool(identical),
    }


def _least_ms(work: Callable[[], object], repeats: int = 15) -> float:
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        work()
        best = min(best, 1e3 * (time.process_time() - start))
    return float(best)

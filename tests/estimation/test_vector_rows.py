"""Products in vector registers against their plain twins."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from camnet.estimation.vector_rows import (
    panel_product,
    picked_rows,
    plain_panel_product,
    plain_picked_rows,
    running_rows,
)
from camnet.types import Array, IntArray


@njit(nogil=True)
def _all_three(
    matrix: Array,
    stride: int,
    n: int,
    right: Array,
    index: IntArray,
    out: Array,
    picked: Array,
    running: Array,
) -> None:
    panel_product(matrix, stride, n, right, out)
    picked_rows(matrix, index, n, right, picked)
    running_rows(matrix, 1, n - 1, right, 1, 0.5, running)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 13, 40])
def test_products_are_those_of_plain_loops(n: int) -> None:
    rng = np.random.default_rng(n)
    stride = 4 * ((n + 3) // 4) + 4
    matrix = np.zeros((n, stride))
    half = rng.standard_normal((n, n))
    matrix[:, :n] = half + half.T
    flat, right, index = matrix.ravel(), rng.standard_normal((n, 8)), rng.permutation(n)
    out, picked, running = np.full((stride, 8), np.nan), np.full(8, np.nan), np.ones(8)
    _all_three(flat, stride, n, right, index, out, picked, running)
    wanted = np.empty((n, 8))
    plain_panel_product(flat, stride, n, right, wanted)
    np.testing.assert_allclose(out[:n], wanted, rtol=1e-13, atol=1e-13)
    row = np.empty(8)
    plain_picked_rows(flat, index, n, right, row)
    np.testing.assert_allclose(picked, row, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(running, 1.0 + 0.5 * flat[1:n] @ right[1:], rtol=1e-13, atol=1e-13)

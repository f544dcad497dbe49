"""Motion models in rows of arrays: the weight law and what keeps its inverse.

Compiled twin of `camnet.estimation.concurrent_learning.MotionModel`, its oracle. Arguments as everywhere in these
files: ``c`` the setup, ``k`` and ``d`` a row of flags and of data, ``j`` a model.

What is done otherwise, without changing what comes out but for rounding:

- A kernel gets its row of the inverse when it is first reached, not when a window with it enters the stack. Until then
  that row is diagonal, which is what the class has for kernels that no window touches.
- Psi is not kept: it is summed from the stack on the rare occasions that ask for it (return to a region, forgetting).
- The projection is looked into only where the weights' norm comes near the bound.
- When finite excitation began changes no state (without ``gap.pace``) and is not kept.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_columns import (
    ACTIVE,
    CAPACITY,
    CHANGES,
    GROWTH,
    MODEL,
    NORM2,
    SELECTING,
    STALE,
    STRIDE,
    WINDOWS,
)
from camnet.batch.estimator_parts import (
    books_of,
    counts_of,
    inverse_of,
    model_of,
    moment_of,
    order_of,
    place_of,
    row_of,
    sigma_of,
    weights_of,
)
from camnet.batch.estimator_setup import Rules
from camnet.estimation.projection import project_step
from camnet.estimation.propagate import COLUMNS, TWIST_OUTPUTS
from camnet.estimation.vector_rows import panel_product
from camnet.types import Array, IntArray

__all__ = ["activate", "rank_one", "refresh", "settle", "square_norm", "stack_inverse", "step"]

_SETTLE_STEPS = 6


@inner
def _widen(matrix: Array, n: int, old: int, new: int) -> None:
    """Move the rows of a square matrix (n, n) from ``old`` to ``new`` > ``old`` apart; new room is zero."""
    for i in range(n - 1, -1, -1):
        for b in range(n - 1, -1, -1):
            matrix[i * new + b] = matrix[i * old + b]
        for b in range(n, new):
            matrix[i * new + b] = 0.0


@inner
def _new_diagonal(matrix: Array, n: int, stride: int, value: float) -> None:
    for i in range(n):
        matrix[i * stride + n] = 0.0
    for i in range(stride):
        matrix[n * stride + i] = 0.0
    matrix[n * stride + n] = value


@inner
def activate(c: Rules, k: IntArray, d: Array, j: int, kernel: int) -> int:
    """Make a kernel active in model ``j``; return its place."""
    counts = counts_of(c, k, j)
    n, stride = counts[ACTIVE], counts[STRIDE]
    inverse = inverse_of(c, k, d, j)
    if n == stride:
        _widen(inverse, n, stride, stride + GROWTH)
        if counts[SELECTING]:
            _widen(books_of(c, k, d, j)[k[CAPACITY] :], n, stride, stride + GROWTH)
        stride += GROWTH
        counts[STRIDE] = stride
    order_of(c, k, j)[n] = kernel
    place_of(c, k, j)[kernel] = n
    weights, moment = weights_of(c, k, d, j), moment_of(c, k, d, j)
    for o in range(COLUMNS):
        weights[COLUMNS * n + o] = 0.0
        moment[COLUMNS * n + o] = 0.0
    for i in range(counts[WINDOWS]):
        row_of(c, k, d, j, i)[n] = 0.0
    if j == k[MODEL]:
        for i in range(c.intervals + c.average):
            sigma_of(c, d, i)[n] = 0.0
    # 1 / (1 + dt kCL gamma delta): the inverse for a kernel that no window touches
    _new_diagonal(inverse, n, stride, 1.0 / (1.0 + c.dt_s * c.kcl * c.gamma * c.leakage))
    if counts[SELECTING]:
        _new_diagonal(books_of(c, k, d, j)[k[CAPACITY] :], n, stride, 1.0 / c.regularisation)
    counts[ACTIVE] = n + 1
    return int(n)


# --- the weight law --------------------------------------------------------------------------------------------------


@inner
def square_norm(weights: Array, n: int) -> float:
    """Sum of squares of ``n`` rows of eight, eight sums side by side."""
    s0, s1, s2, s3, s4, s5, s6, s7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(n):
        s0 += weights[8 * a] * weights[8 * a]
        s1 += weights[8 * a + 1] * weights[8 * a + 1]
        s2 += weights[8 * a + 2] * weights[8 * a + 2]
        s3 += weights[8 * a + 3] * weights[8 * a + 3]
        s4 += weights[8 * a + 4] * weights[8 * a + 4]
        s5 += weights[8 * a + 5] * weights[8 * a + 5]
        s6 += weights[8 * a + 6] * weights[8 * a + 6]
        s7 += weights[8 * a + 7] * weights[8 * a + 7]
    return s0 + s1 + s2 + s3 + s4 + s5 + s6 + s7


@inner
def step(
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    inverse: Array,
    rate: float,
    count: int,
) -> None:
    """One step of the weights: ``inverse`` and ``rate`` = dt gamma belong to the same dt.

    The feedback is sigma at ``count`` active kernels (``c.work.sigma``, ``c.work.places``) and ``c.work.error`` =
    G^T eta_til; with none of them the weights move on the stack alone.
    """
    index, sigma, error = c.work.places, c.work.sigma, c.work.error
    counts, model = counts_of(c, k, j), model_of(c, k, d, j)
    weights, moment = weights_of(c, k, d, j), moment_of(c, k, d, j)
    n, bound2 = counts[ACTIVE], c.weight_bound * c.weight_bound
    if n == 0:
        return
    right, share = c.work.right, rate * c.kcl
    for i in range(COLUMNS * n):
        right[i] = weights[i] + share * moment[i]
    for m in range(count):
        first, feedback = COLUMNS * index[m], rate * sigma[m]
        for o in range(COLUMNS):
            right[first + o] += feedback * error[o]
    near = model[NORM2] > bound2
    # a step that begins below the bound is only held back at the rim: then it matters not where it began
    before = c.work.before
    if near:
        for i in range(COLUMNS * n):
            before[i] = weights[i]
    panel_product(inverse, counts[STRIDE], n, right, weights)
    norm2 = square_norm(weights, n)
    # this norm is over all columns, the unit output's included, and no smaller than the projection's own
    if near or norm2 > bound2:
        if not near:
            for i in range(COLUMNS * n):
                before[i] = 0.0
        after = weights[: COLUMNS * n].reshape((n, COLUMNS))
        began = before[: COLUMNS * n].reshape((n, COLUMNS))
        project_step(began, after, TWIST_OUTPUTS, c.weight_bound, c.weight_layer)
        norm2 = square_norm(weights, n)
    model[NORM2] = norm2


@inner
def settle(c: Rules, k: IntArray, d: Array, j: int, duration_s: float) -> None:
    """Advance the weights by ``duration_s`` on the stack alone, in a few long implicit steps."""
    counts = counts_of(c, k, j)
    if counts[WINDOWS] == 0 or duration_s <= 0.0:
        return
    rate, inverse = duration_s / _SETTLE_STEPS * c.gamma, c.work.inverse
    stack_inverse(c, k, d, j, rate * c.kcl, 1.0 + rate * c.kcl * c.leakage, inverse)
    for _ in range(_SETTLE_STEPS):
        step(c, k, d, j, inverse, rate, 0)


# --- the inverse -----------------------------------------------------------------------------------------------------


@inner
def stack_inverse(c: Rules, k: IntArray, d: Array, j: int, scale: float, shift: float, out: Array) -> None:
    """Write (``scale`` sum Y^T Y + ``shift`` I)^-1 over the active kernels to ``out``, flat, rows STRIDE apart.

    Gauss-Jordan in place without pivots, which definiteness allows: each step takes one row and column to their places
    in the inverse.
    """
    counts = counts_of(c, k, j)
    n, stride = counts[ACTIVE], counts[STRIDE]
    for i in range(stride * stride):
        out[i] = 0.0
    for a in range(n):
        out[a * stride + a] = shift
    for i in range(counts[WINDOWS]):
        row = row_of(c, k, d, j, i)
        for a in range(n):
            if row[a] != 0.0:
                share = scale * row[a]
                for b in range(n):
                    out[a * stride + b] += share * row[b]
    pivot_row = c.work.u
    for i in range(n):
        pivot = 1.0 / out[i * stride + i]
        for b in range(n):
            pivot_row[b] = out[i * stride + b]
        for a in range(n):
            if a != i:
                factor = out[a * stride + i] * pivot
                for b in range(n):
                    out[a * stride + b] -= factor * pivot_row[b]
                out[a * stride + i] = -factor
        for b in range(n):
            out[i * stride + b] = pivot_row[b] * pivot
        out[i * stride + i] = pivot
    for a in range(n):
        for b in range(a):
            mean = 0.5 * (out[a * stride + b] + out[b * stride + a])
            out[a * stride + b] = mean
            out[b * stride + a] = mean


@inner
def refresh(c: Rules, k: IntArray, d: Array, j: int) -> None:
    """Compute the inverse of the implicit step afresh, if it waits for that."""
    counts, rate = counts_of(c, k, j), c.dt_s * c.kcl * c.gamma
    if counts[STALE]:
        stack_inverse(c, k, d, j, rate, 1.0 + rate * c.leakage, inverse_of(c, k, d, j))
        counts[CHANGES], counts[STALE] = 0, 0


@inner
def rank_one(matrix: Array, n: int, stride: int, y: Array, scale: float, sign: float, u: Array) -> None:
    """Sherman-Morrison in place for ``scale`` y, as `camnet.estimation.selection.rank_one`; its u goes to ``u``."""
    for i in range(n):
        u[i] = 0.0
    for i in range(n):
        if y[i] != 0.0:
            share = scale * y[i]
            for b in range(n):
                u[b] += matrix[i * stride + b] * share
    h = 0.0
    for i in range(n):
        h += scale * y[i] * u[i]
    shrink = 1.0 / math.sqrt(max(1.0 + sign * h, 1e-12))
    for i in range(n):
        u[i] *= shrink
    for i in range(n):
        f = sign * u[i]
        for b in range(n):
            matrix[i * stride + b] -= f * u[b]

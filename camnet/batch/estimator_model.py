"""Motion models in rows of arrays: the weight law, the stack and its selection, forgetting.

Compiled twin of `camnet.estimation.concurrent_learning.MotionModel`, `camnet.estimation.stack.HistoryStack` and
`camnet.estimation.selection.DOptimalRule`, which are its oracles and hold the derivations. ``s`` is the state, ``r`` a
row of it, ``j`` a model; see `camnet.batch.estimator_layout`.

What is done otherwise, without changing what comes out but for rounding:

- A kernel gets its row of the inverse when it is first reached, not when a window with it enters the stack. Until then
  that row is diagonal, which is what the class has for kernels that no window touches.
- Psi is not kept: it is summed from the stack on the rare occasions that ask for it (return to a region, forgetting).
- The books of the D-optimal rule start when a stack is full: before, every window enters.
- The projection is looked into only where the weights' norm comes near the bound.
- When finite excitation began changes no state (without ``gap.pace``) and is not kept.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.batch.estimator_layout import (
    ACTIVE,
    CHANGES,
    FORGOTTEN,
    GROWTH,
    MODEL,
    NORM2,
    OVERFLOWED,
    REFUSED,
    SELECTED,
    SELECTING,
    STRIDE,
    WINDOWS,
    EstimatorSetup,
    EstimatorState,
)
from camnet.estimation.concurrent_learning import ALIKE, REFRESH_EVERY, TINY
from camnet.estimation.projection import project_step
from camnet.estimation.propagate import COLUMNS, TWIST_OUTPUTS
from camnet.estimation.selection import REFRESH_EVERY as SELECTION_REFRESH
from camnet.estimation.vector_rows import panel_product
from camnet.types import Array, IntArray

__all__ = ["activate", "forget", "learn_window", "settle", "step", "step_with_feedback"]

_SETTLE_STEPS = 6


@njit(cache=True, nogil=True)
def _fade(c: EstimatorSetup, dt_s: float) -> float:
    """Diagonal of the inverse for a kernel that no window touches."""
    return 1.0 / (1.0 + dt_s * c.kcl * c.gamma * c.leakage)


@njit(cache=True, nogil=True)
def _widen(matrix: Array, n: int, old: int, new: int) -> None:
    """Move the rows of a square matrix (n, n) in ``matrix`` from ``old`` to ``new`` > ``old`` apart; new room is zero."""
    for i in range(n - 1, -1, -1):
        for k in range(n - 1, -1, -1):
            matrix[i * new + k] = matrix[i * old + k]
        for k in range(n, new):
            matrix[i * new + k] = 0.0


@njit(cache=True, nogil=True)
def activate(c: EstimatorSetup, s: EstimatorState, r: int, j: int, kernel: int) -> int:
    """Make a kernel active in model ``j``; return its place."""
    counts = s.counts[r, j]
    n, stride = counts[ACTIVE], counts[STRIDE]
    inverse, selection = s.inverse[r, j], s.selection[r, j]
    if n == stride:
        _widen(inverse, n, stride, stride + GROWTH)
        if counts[SELECTING]:
            _widen(selection, n, stride, stride + GROWTH)
        stride += GROWTH
        counts[STRIDE] = stride
    s.order[r, j, n], s.place[r, j, kernel] = kernel, n
    for o in range(COLUMNS):
        s.weights[r, j, n, o] = 0.0
        s.moment[r, j, n, o] = 0.0
    for i in range(counts[WINDOWS]):
        s.rows[r, j, i, n] = 0.0
    if j == s.flags[r, MODEL]:
        for i in range(s.sigma.shape[1]):
            s.sigma[r, i, n] = 0.0
    _new_diagonal(inverse, n, stride, _fade(c, c.dt_s))
    if counts[SELECTING]:
        _new_diagonal(selection, n, stride, 1.0 / c.regularisation)
    counts[ACTIVE] = n + 1
    return n


@njit(cache=True, nogil=True)
def _new_diagonal(matrix: Array, n: int, stride: int, value: float) -> None:
    for i in range(n):
        matrix[i * stride + n] = 0.0
    for i in range(stride):
        matrix[n * stride + i] = 0.0
    matrix[n * stride + n] = value


# --- the weight law --------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def _square_norm(weights: Array, n: int) -> float:
    """Sum of squares of (n, 8), eight sums side by side."""
    a, b, c, d, e, f, g, h = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        a += weights[k, 0] * weights[k, 0]
        b += weights[k, 1] * weights[k, 1]
        c += weights[k, 2] * weights[k, 2]
        d += weights[k, 3] * weights[k, 3]
        e += weights[k, 4] * weights[k, 4]
        f += weights[k, 5] * weights[k, 5]
        g += weights[k, 6] * weights[k, 6]
        h += weights[k, 7] * weights[k, 7]
    return a + b + c + d + e + f + g + h


@njit(cache=True, nogil=True)
def _advance(
    c: EstimatorSetup, s: EstimatorState, r: int, j: int, right: Array, inverse: Array, stride: int
) -> None:
    """Weights M R, projected: ``right`` (n, 8) is what the product takes."""
    n = s.counts[r, j, ACTIVE]
    weights = s.weights[r, j]
    near = s.model[r, j, NORM2] > c.weight_bound * c.weight_bound
    if not near:
        panel_product(inverse, stride, n, right, weights)
        norm2 = _square_norm(weights, n)
        # the norm over all columns, the unit output's included, is no smaller than that of the projection
        if norm2 <= c.weight_bound * c.weight_bound:
            s.model[r, j, NORM2] = norm2
            return
        # the projection's first part is idle for a step that began below the bound
        before = np.zeros((n, COLUMNS))
        project_step(before, weights[:n], TWIST_OUTPUTS, c.weight_bound, c.weight_layer)
    else:
        before = weights[:n].copy()
        panel_product(inverse, stride, n, right, weights)
        project_step(before, weights[:n], TWIST_OUTPUTS, c.weight_bound, c.weight_layer)
    s.model[r, j, NORM2] = _square_norm(weights, n)


@njit(cache=True, nogil=True)
def _right(c: EstimatorSetup, s: EstimatorState, r: int, j: int, dt_s: float) -> Array:
    """W + dt gamma kCL Q over the active kernels (n, 8)."""
    n = s.counts[r, j, ACTIVE]
    right = np.empty((n, COLUMNS))
    share = dt_s * c.gamma * c.kcl
    weights, moment = s.weights[r, j], s.moment[r, j]
    for k in range(n):
        for o in range(COLUMNS):
            right[k, o] = weights[k, o] + share * moment[k, o]
    return right


@njit(cache=True, nogil=True)
def step(c: EstimatorSetup, s: EstimatorState, r: int, j: int) -> None:
    """One nominal step of the weights on the stack alone."""
    if s.counts[r, j, ACTIVE] > 0:
        _advance(c, s, r, j, _right(c, s, r, j, c.dt_s), s.inverse[r, j], s.counts[r, j, STRIDE])


@njit(cache=True, nogil=True)
def step_with_feedback(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    j: int,
    index: IntArray,
    sigma: Array,
    count: int,
    error: Array,
) -> None:
    """One nominal step with sigma (at the active kernels in ``index``) and ``error`` (8,) = G^T eta_til."""
    if s.counts[r, j, ACTIVE] == 0:
        return
    right = _right(c, s, r, j, c.dt_s)
    for m in range(count):
        k, share = index[m], c.dt_s * c.gamma * sigma[m]
        for o in range(COLUMNS):
            right[k, o] += share * error[o]
    _advance(c, s, r, j, right, s.inverse[r, j], s.counts[r, j, STRIDE])


@njit(cache=True, nogil=True)
def settle(c: EstimatorSetup, s: EstimatorState, r: int, j: int, duration_s: float) -> None:
    """Advance the weights by ``duration_s`` on the stack alone, in a few long implicit steps."""
    counts = s.counts[r, j]
    if counts[WINDOWS] == 0 or duration_s <= 0.0:
        return
    dt_s = duration_s / _SETTLE_STEPS
    inverse = _exact_inverse(c, s, r, j, dt_s)
    for _ in range(_SETTLE_STEPS):
        _advance(c, s, r, j, _right(c, s, r, j, dt_s), inverse, counts[STRIDE])


# --- sums over the stack and the inverse -----------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def _gram(s: EstimatorState, r: int, j: int, scale: float, shift: float) -> Array:
    """``scale`` sum Y^T Y + ``shift`` I over the active kernels, flat, rows STRIDE apart."""
    counts = s.counts[r, j]
    n, stride = counts[ACTIVE], counts[STRIDE]
    rows = s.rows[r, j]
    out = np.zeros(stride * stride)
    for i in range(counts[WINDOWS]):
        for a in range(n):
            if rows[i, a] != 0.0:
                share = scale * rows[i, a]
                for b in range(a + 1):
                    out[a * stride + b] += share * rows[i, b]
    for a in range(n):
        out[a * stride + a] += shift
        for b in range(a):
            out[b * stride + a] = out[a * stride + b]
    return out


@njit(cache=True, nogil=True)
def _invert(matrix: Array, n: int, stride: int) -> None:
    """Inverse in place of a symmetric positive definite (n, n) matrix, rows ``stride`` apart.

    Gauss-Jordan without pivots: each step takes one row and column to their place in the inverse. On positive definite
    matrices as well conditioned as these it is as exact as a factorisation, and it runs along rows.
    """
    row = np.empty(n)
    for k in range(n):
        pivot = 1.0 / matrix[k * stride + k]
        for b in range(n):
            row[b] = matrix[k * stride + b]
        for a in range(n):
            if a != k:
                factor = matrix[a * stride + k] * pivot
                if factor != 0.0:
                    for b in range(n):
                        matrix[a * stride + b] -= factor * row[b]
                matrix[a * stride + k] = -factor
        for b in range(n):
            matrix[k * stride + b] = row[b] * pivot
        matrix[k * stride + k] = pivot
    for a in range(n):
        for b in range(a):
            mean = 0.5 * (matrix[a * stride + b] + matrix[b * stride + a])
            matrix[a * stride + b] = mean
            matrix[b * stride + a] = mean


@njit(cache=True, nogil=True)
def _exact_inverse(c: EstimatorSetup, s: EstimatorState, r: int, j: int, dt_s: float) -> Array:
    """(I + dt kCL gamma (Psi + delta I))^-1."""
    rate = dt_s * c.kcl * c.gamma
    counts = s.counts[r, j]
    matrix = _gram(s, r, j, rate, 1.0 + rate * c.leakage)
    _invert(matrix, counts[ACTIVE], counts[STRIDE])
    return matrix


@njit(cache=True, nogil=True)
def _refresh(c: EstimatorSetup, s: EstimatorState, r: int, j: int) -> None:
    exact = _exact_inverse(c, s, r, j, c.dt_s)
    s.inverse[r, j, : len(exact)] = exact
    s.counts[r, j, CHANGES] = 0


@njit(cache=True, nogil=True)
def _rank_one(matrix: Array, n: int, stride: int, y: Array, scale: float, sign: float) -> Array:
    """Sherman-Morrison in place for ``scale`` y, (A + sign scale^2 y y^T)^-1; return u as `selection.rank_one`."""
    u = np.zeros(n)
    for k in range(n):
        if y[k] != 0.0:
            share = scale * y[k]
            for i in range(n):
                u[i] += matrix[k * stride + i] * share
    h = 0.0
    for i in range(n):
        h += scale * y[i] * u[i]
    shrink = 1.0 / math.sqrt(max(1.0 + sign * h, 1e-12))
    for i in range(n):
        u[i] *= shrink
    for i in range(n):
        if u[i] != 0.0:
            f = sign * u[i]
            for k in range(n):
                matrix[i * stride + k] -= f * u[k]
    return u


# --- the stack -------------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def learn_window(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    j: int,
    t_s: float,
    row: Array,
    increment: Array,
    weight: float,
) -> None:
    """Offer a window (row over the active kernels, increment (8,)) to the stack, weighted in (0, 1]."""
    counts = s.counts[r, j]
    n, capacity, index = counts[ACTIVE], s.rows.shape[2], counts[WINDOWS]
    if n == 0:
        return
    root = math.sqrt(weight)
    y = root * row[:n]
    old = y
    full = index == capacity
    if full:
        if s.leverage.shape[2] < capacity:
            counts[OVERFLOWED] += 1
            return
        index = _choose(c, s, r, j, y)
        if index < 0:
            counts[REFUSED] += 1
            return
        old = s.rows[r, j, index, :n].copy()
        _add_to_moment(s, r, j, index, -1.0)
    else:
        counts[WINDOWS] = index + 1
    s.rows[r, j, index, :n] = y
    s.increments[r, j, index] = root * increment
    s.entered[r, j, index] = t_s
    _add_to_moment(s, r, j, index, 1.0)
    rate, stride = math.sqrt(c.dt_s * c.kcl * c.gamma), counts[STRIDE]
    _rank_one(s.inverse[r, j], n, stride, y, rate, 1.0)
    counts[CHANGES] += 1
    if full:
        _rank_one(s.inverse[r, j], n, stride, old, rate, -1.0)
        counts[CHANGES] += 1
        _book(c, s, r, j, index, old, y)
    if counts[CHANGES] >= REFRESH_EVERY:
        _refresh(c, s, r, j)


@njit(cache=True, nogil=True)
def _add_to_moment(s: EstimatorState, r: int, j: int, index: int, sign: float) -> None:
    moment, row, increment = s.moment[r, j], s.rows[r, j, index], s.increments[r, j, index]
    for a in range(s.counts[r, j, ACTIVE]):
        if row[a] != 0.0:
            share = sign * row[a]
            for o in range(COLUMNS):
                moment[a, o] += share * increment[o]


@njit(cache=True, nogil=True)
def _choose(c: EstimatorSetup, s: EstimatorState, r: int, j: int, y: Array) -> int:
    """Entry that should give way to ``y``, or -1: the D-optimal rule."""
    counts = s.counts[r, j]
    if not counts[SELECTING]:
        _open_books(c, s, r, j)
    n, stride = counts[ACTIVE], counts[STRIDE]
    inverse, leverage, rows = s.selection[r, j], s.leverage[r, j], s.rows[r, j]
    u = np.zeros(n)
    for k in range(n):
        if y[k] != 0.0:
            for i in range(n):
                u[i] += inverse[k * stride + i] * y[k]
    h = 0.0
    for i in range(n):
        h += y[i] * u[i]
    best, most = -1, 1.0
    for i in range(counts[WINDOWS]):
        gain = (1.0 + h) * (1.0 - leverage[i]) + _dot(rows[i], u) ** 2
        if gain > most:
            best, most = i, gain
    return best


@njit(cache=True, nogil=True)
def _dot(row: Array, u: Array) -> float:
    """Product over the length of ``u``, four sums side by side."""
    n = len(u)
    whole = n - n % 4
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for i in range(0, whole, 4):
        a += row[i] * u[i]
        b += row[i + 1] * u[i + 1]
        c += row[i + 2] * u[i + 2]
        d += row[i + 3] * u[i + 3]
    for i in range(whole, n):
        a += row[i] * u[i]
    return (a + b) + (c + d)


@njit(cache=True, nogil=True)
def _open_books(c: EstimatorSetup, s: EstimatorState, r: int, j: int) -> None:
    """(Psi + regularisation I)^-1 and the leverages of all entries, afresh."""
    counts = s.counts[r, j]
    n, stride = counts[ACTIVE], counts[STRIDE]
    inverse = _gram(s, r, j, 1.0, c.regularisation)
    _invert(inverse, n, stride)
    s.selection[r, j, : len(inverse)] = inverse
    for i in range(counts[WINDOWS]):
        s.leverage[r, j, i] = _leverage(s, r, j, i)
    counts[SELECTING] = 1
    counts[SELECTED] = 0


@njit(cache=True, nogil=True)
def _leverage(s: EstimatorState, r: int, j: int, index: int) -> float:
    n, stride = s.counts[r, j, ACTIVE], s.counts[r, j, STRIDE]
    row, inverse = s.rows[r, j, index], s.selection[r, j]
    total = 0.0
    for k in range(n):
        if row[k] != 0.0:
            total += row[k] * _dot(inverse[k * stride : k * stride + n], row[:n])
    return total


@njit(cache=True, nogil=True)
def _book(c: EstimatorSetup, s: EstimatorState, r: int, j: int, index: int, old: Array, y: Array) -> None:
    """Entry ``index`` was replaced: follow with the inverse and the leverages."""
    counts = s.counts[r, j]
    n, stride = counts[ACTIVE], counts[STRIDE]
    for change, sign in ((y, 1.0), (old, -1.0)):
        u = _rank_one(s.selection[r, j], n, stride, change, 1.0, sign)
        for i in range(counts[WINDOWS]):
            s.leverage[r, j, i] -= sign * _dot(s.rows[r, j, i], u) ** 2
    s.leverage[r, j, index] = _leverage(s, r, j, index)
    counts[SELECTED] += 1
    if counts[SELECTED] >= SELECTION_REFRESH:
        _open_books(c, s, r, j)


@njit(cache=True, nogil=True)
def forget(c: EstimatorSetup, s: EstimatorState, r: int, j: int, row: Array, before_s: float) -> None:
    """Drop the windows of places like ``row`` that entered before ``before_s``; weights fade with the data they lose."""
    counts = s.counts[r, j]
    n, held = counts[ACTIVE], counts[WINDOWS]
    rows = s.rows[r, j]
    length = math.sqrt(_dot(row, row[:n]))
    keep = 0
    present, left = np.zeros(n), np.zeros(n)
    for i in range(held):
        y = rows[i, :n]
        alike = _dot(rows[i], row[:n]) > ALIKE * math.sqrt(_dot(rows[i], y)) * length
        dropped = alike and s.entered[r, j, i] < before_s
        for a in range(n):
            present[a] += y[a] * y[a]
            if not dropped:
                left[a] += y[a] * y[a]
        if not dropped:
            if keep < i:
                rows[keep, :n] = y
                s.increments[r, j, keep] = s.increments[r, j, i]
                s.entered[r, j, keep] = s.entered[r, j, i]
            keep += 1
    if keep == held:
        return
    counts[WINDOWS], counts[SELECTING] = keep, 0
    counts[FORGOTTEN] += held - keep
    s.moment[r, j, :n] = 0.0
    for i in range(keep):
        _add_to_moment(s, r, j, i, 1.0)
    _refresh(c, s, r, j)
    for a in range(n):
        if present[a] > TINY:
            for o in range(COLUMNS):
                s.weights[r, j, a, o] *= min(left[a] / present[a], 1.0)
    s.model[r, j, NORM2] = _square_norm(s.weights[r, j], n)

"""History stacks in rows of arrays: windows enter, give way by the D-optimal rule, and are forgotten.

Compiled twin of `camnet.estimation.stack.HistoryStack` and `camnet.estimation.selection.DOptimalRule`, its oracles. The
books of the rule (inverse and leverages) start when a stack is full: before, every window enters. What has to be
computed afresh is only marked here (STALE, SELECTING); ``refresh`` and ``open_books`` do it.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_columns import (
    ACTIVE,
    CAPACITY,
    CHANGES,
    FILLS,
    FORGOTTEN,
    NORM2,
    OVERFLOWED,
    REFUSED,
    SELECTED,
    SELECTING,
    STALE,
    STRIDE,
    WINDOWS,
)
from camnet.batch.estimator_model import rank_one, square_norm, stack_inverse
from camnet.batch.estimator_parts import (
    books_of,
    counts_of,
    increment_of,
    inverse_of,
    model_of,
    moment_of,
    row_of,
    weights_of,
)
from camnet.batch.estimator_setup import Rules
from camnet.estimation.concurrent_learning import ALIKE, REFRESH_EVERY, TINY
from camnet.estimation.propagate import COLUMNS
from camnet.estimation.selection import REFRESH_EVERY as SELECTION_REFRESH
from camnet.types import Array, IntArray

__all__ = ["forget", "learn_window", "open_books"]


@inner
def learn_window(
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    t_s: float,
    row: Array,
    increment: Array,
    weight: float,
) -> None:
    """Offer a window (row over the active kernels, increment (8,)) to the stack, weighted in (0, 1]."""
    counts = counts_of(c, k, j)
    n, index = counts[ACTIVE], counts[WINDOWS]
    if n == 0:
        return
    root = math.sqrt(weight)
    y, old = c.work.y, c.work.old
    for a in range(n):
        y[a] = root * row[a]
    full = index == k[CAPACITY]
    if full:
        index = _choose(c, k, d, j, y) if k[FILLS] else -1
        if index < 0:
            counts[REFUSED if k[FILLS] else OVERFLOWED] += 1
            return
        held = row_of(c, k, d, j, index)
        for a in range(n):
            old[a] = held[a]
        _add_to_moment(c, k, d, j, index, -1.0)
    else:
        counts[WINDOWS] = index + 1
    _write(c, k, d, j, index, y, root, increment, t_s)
    if full:
        _book(c, k, d, j, index, old, y)
    inverse, rate, stride = inverse_of(c, k, d, j), math.sqrt(c.dt_s * c.kcl * c.gamma), counts[STRIDE]
    if not counts[STALE]:
        rank_one(inverse, n, stride, y, rate, 1.0, c.work.u)
        if full:
            rank_one(inverse, n, stride, old, rate, -1.0, c.work.u)
    counts[CHANGES] += 2 if full else 1
    if counts[CHANGES] >= REFRESH_EVERY:
        counts[STALE] = 1


@inner
def _write(
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    index: int,
    y: Array,
    root: float,
    increment: Array,
    t_s: float,
) -> None:
    row, held = row_of(c, k, d, j, index), increment_of(c, k, d, j, index)
    for a in range(counts_of(c, k, j)[ACTIVE]):
        row[a] = y[a]
    for o in range(COLUMNS):
        held[o] = root * increment[o]
    held[COLUMNS] = t_s
    _add_to_moment(c, k, d, j, index, 1.0)


@inner
def _add_to_moment(c: Rules, k: IntArray, d: Array, j: int, index: int, sign: float) -> None:
    row, increment = row_of(c, k, d, j, index), increment_of(c, k, d, j, index)
    moment = moment_of(c, k, d, j)
    for a in range(counts_of(c, k, j)[ACTIVE]):
        if row[a] != 0.0:
            share = sign * row[a]
            for o in range(COLUMNS):
                moment[COLUMNS * a + o] += share * increment[o]


@inner
def _dot(a: Array, b: Array, n: int) -> float:
    """Product over ``n`` numbers, four sums side by side."""
    whole = n - n % 4
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for i in range(0, whole, 4):
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
    for i in range(whole, n):
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)


# --- the D-optimal rule ----------------------------------------------------------------------------------------------


@inner
def _choose(c: Rules, k: IntArray, d: Array, j: int, y: Array) -> int:
    """Entry that should give way to ``y``, or -1."""
    counts = counts_of(c, k, j)
    n, stride = counts[ACTIVE], counts[STRIDE]
    books = books_of(c, k, d, j)
    inverse = books[k[CAPACITY] :]
    u = c.work.u
    for i in range(n):
        u[i] = 0.0
    for i in range(n):
        if y[i] != 0.0:
            for b in range(n):
                u[b] += inverse[i * stride + b] * y[i]
    h = _dot(y, u, n)
    best, most = -1, 1.0
    for i in range(counts[WINDOWS]):
        gain = (1.0 + h) * (1.0 - books[i]) + _dot(row_of(c, k, d, j, i), u, n) ** 2
        if gain > most:
            best, most = i, gain
    return best


@inner
def open_books(c: Rules, k: IntArray, d: Array, j: int) -> None:
    """Compute (Psi + regularisation I)^-1 and the leverages of all entries, if the stack is full and has none."""
    counts, books = counts_of(c, k, j), books_of(c, k, d, j)
    if counts[SELECTING] or counts[WINDOWS] < k[CAPACITY] or not k[FILLS]:
        return
    stack_inverse(c, k, d, j, 1.0, c.regularisation, books[k[CAPACITY] :])
    for i in range(counts[WINDOWS]):
        books[i] = _leverage(c, k, d, j, i)
    counts[SELECTING], counts[SELECTED] = 1, 0


@inner
def _leverage(c: Rules, k: IntArray, d: Array, j: int, index: int) -> float:
    counts = counts_of(c, k, j)
    n, stride = counts[ACTIVE], counts[STRIDE]
    row, inverse = row_of(c, k, d, j, index), books_of(c, k, d, j)[k[CAPACITY] :]
    total = 0.0
    for a in range(n):
        if row[a] != 0.0:
            total += row[a] * _dot(inverse[a * stride :], row, n)
    return total


@inner
def _follow(c: Rules, k: IntArray, d: Array, j: int, y: Array, sign: float) -> None:
    """Change the inverse and all leverages for a row that entered (+1) or left (-1)."""
    counts, books = counts_of(c, k, j), books_of(c, k, d, j)
    n, u = counts[ACTIVE], c.work.u
    rank_one(books[k[CAPACITY] :], n, counts[STRIDE], y, 1.0, sign, u)
    for i in range(counts[WINDOWS]):
        books[i] -= sign * _dot(row_of(c, k, d, j, i), u, n) ** 2


@inner
def _book(c: Rules, k: IntArray, d: Array, j: int, index: int, old: Array, y: Array) -> None:
    """Entry ``index`` was replaced."""
    counts = counts_of(c, k, j)
    _follow(c, k, d, j, y, 1.0)
    _follow(c, k, d, j, old, -1.0)
    books_of(c, k, d, j)[index] = _leverage(c, k, d, j, index)
    counts[SELECTED] += 1
    if counts[SELECTED] >= SELECTION_REFRESH:
        counts[SELECTING] = 0


# --- forgetting ------------------------------------------------------------------------------------------------------


@inner
def forget(c: Rules, k: IntArray, d: Array, j: int, row: Array, before_s: float) -> None:
    """Drop the windows of places like ``row`` that entered before ``before_s``; weights fade with what they lose."""
    counts = counts_of(c, k, j)
    n, held, keep = counts[ACTIVE], counts[WINDOWS], 0
    length = math.sqrt(_dot(row, row, n))
    present, left = c.work.present, c.work.left
    for a in range(n):
        present[a] = 0.0
        left[a] = 0.0
    for i in range(held):
        y, increment = row_of(c, k, d, j, i), increment_of(c, k, d, j, i)
        alike = _dot(y, row, n) > ALIKE * (math.sqrt(_dot(y, y, n)) * length)
        dropped = alike and increment[COLUMNS] < before_s
        for a in range(n):
            present[a] += y[a] * y[a]
            if not dropped:
                left[a] += y[a] * y[a]
        if not dropped:
            if keep < i:
                _move(c, k, d, j, i, keep)
            keep += 1
    if keep == held:
        return
    counts[WINDOWS], counts[SELECTING] = keep, 0
    counts[FORGOTTEN] += held - keep
    _after_loss(c, k, d, j, present, left)


@inner
def _move(c: Rules, k: IntArray, d: Array, j: int, source: int, place: int) -> None:
    """Move a stack entry."""
    row, increment = row_of(c, k, d, j, source), increment_of(c, k, d, j, source)
    row_to, increment_to = row_of(c, k, d, j, place), increment_of(c, k, d, j, place)
    for a in range(counts_of(c, k, j)[ACTIVE]):
        row_to[a] = row[a]
    for o in range(COLUMNS + 1):
        increment_to[o] = increment[o]


@inner
def _after_loss(c: Rules, k: IntArray, d: Array, j: int, present: Array, left: Array) -> None:
    """Take sums and inverse from what is left, and weights in proportion to the diagonal of Psi."""
    counts = counts_of(c, k, j)
    n = counts[ACTIVE]
    weights, moment = weights_of(c, k, d, j), moment_of(c, k, d, j)
    for i in range(COLUMNS * n):
        moment[i] = 0.0
    for i in range(counts[WINDOWS]):
        _add_to_moment(c, k, d, j, i, 1.0)
    counts[STALE] = 1
    for a in range(n):
        if present[a] > TINY:
            for o in range(COLUMNS):
                weights[COLUMNS * a + o] *= min(left[a] / present[a], 1.0)
    model_of(c, k, d, j)[NORM2] = square_norm(weights, n)

"""Parts of a learning estimator's row: ``k`` is a row of ``flags``, ``d`` one of ``data``, ``j`` a model.

What they are, and their shapes, is in the table of `camnet.batch.estimator_layout`; where they begin, in
`camnet.batch.estimator_setup.Places`.
"""

from __future__ import annotations

from typing import Any

from camnet.batch.estimator_columns import BLOCK, CAPACITY, COUNT_COLUMNS, FLAG_COLUMNS, GROWTH
from camnet.batch.estimator_setup import Rules
from camnet.compiled import cached_njit
from camnet.estimation.propagate import COLUMNS
from camnet.types import Array, IntArray

__all__ = [
    "books_of",
    "counts_of",
    "increment_of",
    "inverse_of",
    "model_of",
    "moment_of",
    "order_of",
    "place_of",
    "row_of",
    "sigma_of",
    "weights_of",
]

#: written out where it is called: without counting references a function cannot return an array
_INLINE: dict[str, Any] = {"inline": "always", "_nrt": False}
_part = cached_njit(**_INLINE)


@_part
def counts_of(c: Rules, k: IntArray, j: int) -> IntArray:
    """Return the counts (COUNT_COLUMNS,) of a model."""
    return k[FLAG_COLUMNS + j * (COUNT_COLUMNS + 2 * c.size) :]


@_part
def order_of(c: Rules, k: IntArray, j: int) -> IntArray:
    """Numbers of the active kernels."""
    return k[FLAG_COLUMNS + j * (COUNT_COLUMNS + 2 * c.size) + COUNT_COLUMNS :]


@_part
def place_of(c: Rules, k: IntArray, j: int) -> IntArray:
    """Places (p,) of the kernels among the active ones."""
    p = c.size
    first = FLAG_COLUMNS + j * (COUNT_COLUMNS + 2 * p) + COUNT_COLUMNS + p
    return k[first : first + p]


@_part
def model_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Block of a model, its numbers (MODEL_COLUMNS,) first."""
    return d[c.at.models + j * k[BLOCK] :]


@_part
def weights_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Weights, flat: 8 numbers an active kernel."""
    return d[c.at.models + j * k[BLOCK] + c.at.weights :]


@_part
def moment_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Moment Q, flat: 8 numbers an active kernel."""
    return d[c.at.models + j * k[BLOCK] + c.at.moment :]


@_part
def inverse_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Inverse of the implicit step, flat."""
    return d[c.at.models + j * k[BLOCK] + c.at.inverse :]


@_part
def row_of(c: Rules, k: IntArray, d: Array, j: int, index: int) -> Array:
    """Regressor of stack entry ``index`` over the active kernels."""
    return d[c.at.models + j * k[BLOCK] + c.at.rows + index * c.at.padded :]


@_part
def increment_of(c: Rules, k: IntArray, d: Array, j: int, index: int) -> Array:
    """Increment (8,) of stack entry ``index``, and in the ninth place when it entered, s."""
    first = c.at.models + j * k[BLOCK] + c.at.rows + k[CAPACITY] * c.at.padded
    return d[first + index * (COLUMNS + 1) :]


@_part
def books_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Leverages (C,) and after them the inverse of the D-optimal rule."""
    first = c.at.models + j * k[BLOCK] + c.at.rows
    return d[first + -(-k[CAPACITY] * (c.at.padded + COLUMNS + 1) // GROWTH) * GROWTH :]


@_part
def sigma_of(c: Rules, d: Array, sample: int) -> Array:
    """Sigma over the active kernels of a sample of the window."""
    return d[c.at.sigma + sample * c.at.padded :]

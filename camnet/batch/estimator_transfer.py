"""What rows of estimators have learned, out of them and into them: for files, and for predictors that learn no further.

A row holds weights and stacks over its active kernels; outside they are over all kernels of the basis, as in
`camnet.estimation.persistence`, whose files and models these are. Plain NumPy: none of it is in a loop.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camnet.batch.estimator_columns import ACTIVE, CAPACITY, GROWTH, NORM2, STRIDE, WINDOWS
from camnet.batch.estimator_layout import EstimatorState
from camnet.batch.estimator_parts import (
    counts_of,
    increment_of,
    inverse_of,
    model_of,
    moment_of,
    order_of,
    place_of,
    row_of,
    weights_of,
)
from camnet.batch.estimator_setup import EstimatorSetup
from camnet.errors import ConfigError, DataError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.persistence import LearnedModel, check_same
from camnet.estimation.propagate import COLUMNS
from camnet.types import Array

__all__ = ["extract_models", "install_models", "learned_weights"]

_FORM = "twist"


def learned_weights(setup: EstimatorSetup, state: EstimatorState, row: int) -> Array:
    """Weights (J, p, 8) of the models of ``row`` over all kernels: with them the flow is ``W^T sigma``."""
    k, d = state.flags[row], state.data[row]
    out = np.zeros((setup.rules.models, setup.rules.size, COLUMNS))
    for j in range(setup.rules.models):
        n = counts_of.py_func(setup.rules, k, j)[ACTIVE]
        flat = weights_of.py_func(setup.rules, k, d, j)[: COLUMNS * n]
        out[j, order_of.py_func(setup.rules, k, j)[:n]] = flat.reshape(n, COLUMNS)
    return out


def extract_models(
    setup: EstimatorSetup, state: EstimatorState, row: int, basis: RbfBasis
) -> list[LearnedModel]:
    """Copy what the models of ``row`` have learned, one a region or one for all; ``basis`` is the setup's."""
    p, weights = basis.size, learned_weights(setup, state, row)
    k, d = state.flags[row], state.data[row]
    models = []
    for j in range(setup.rules.models):
        counts, order = counts_of.py_func(setup.rules, k, j), order_of.py_func(setup.rules, k, j)
        n, held = counts[ACTIVE], counts[WINDOWS]
        rows, increments = np.zeros((held, p)), np.zeros((held, COLUMNS + 1))
        for i in range(held):
            rows[i, order[:n]] = row_of.py_func(setup.rules, k, d, j, i)[:n]
            increments[i] = increment_of.py_func(setup.rules, k, d, j, i)[: COLUMNS + 1]
        stack = (rows, increments[:, :COLUMNS].copy(), increments[:, COLUMNS].copy())
        none = (np.zeros((0, p)), np.zeros((0, COLUMNS)), np.zeros(0))
        models.append(LearnedModel(_FORM, basis, weights[j], (stack, none)))
    return models


def install_models(
    setup: EstimatorSetup,
    state: EstimatorState,
    row: int,
    basis: RbfBasis,
    learned: Sequence[LearnedModel],
) -> None:
    """Put saved models into a fresh row, one for each of its own: their windows and their weights as they were.

    Raises
    ------
    ConfigError
        If there are more windows than the row has room for.
    DataError
        If their number, form or kernels differ, or the row has learned something already.
    """
    if len(learned) != setup.rules.models:
        raise DataError(f"learned models: {len(learned)}, but the estimator has {setup.rules.models}")
    for j, model in enumerate(learned):
        check_same(_FORM, basis, model)
        if counts_of.py_func(setup.rules, state.flags[row], j)[ACTIVE]:
            raise DataError(f"learned model {j}: row {row} has learned something already; reset it first")
        _install(setup, state, row, j, model)


def _install(setup: EstimatorSetup, state: EstimatorState, row: int, j: int, learned: LearnedModel) -> None:
    k, d = state.flags[row], state.data[row]
    rows, increments, times = learned.stacks[0]
    if len(rows) > k[CAPACITY]:
        raise ConfigError(
            f"learned model {j}: {len(rows)} windows, but the stack has room for {k[CAPACITY]}; "
            "allocate with a longer duration_s"
        )
    order = np.flatnonzero((rows != 0.0).any(axis=0) | (learned.weights != 0.0).any(axis=1))
    n = len(order)
    stride = -(-n // GROWTH) * GROWTH
    counts = counts_of.py_func(setup.rules, k, j)
    counts[ACTIVE], counts[STRIDE], counts[WINDOWS] = n, stride, len(rows)
    order_of.py_func(setup.rules, k, j)[:n] = order
    place_of.py_func(setup.rules, k, j)[order] = np.arange(n)
    c = setup.rules
    y, rate = rows[:, order], c.dt_s * c.kcl * c.gamma
    inverse = np.zeros((n, stride))
    inverse[:, :n] = np.linalg.inv((1.0 + rate * c.leakage) * np.eye(n) + rate * (y.T @ y))
    inverse_of.py_func(setup.rules, k, d, j)[: n * stride] = inverse.ravel()
    weights_of.py_func(setup.rules, k, d, j)[: COLUMNS * n] = learned.weights[order].ravel()
    moment_of.py_func(setup.rules, k, d, j)[: COLUMNS * n] = (y.T @ increments).ravel()
    model_of.py_func(setup.rules, k, d, j)[NORM2] = float((learned.weights**2).sum())
    for i in range(len(rows)):
        row_of.py_func(setup.rules, k, d, j, i)[:n] = y[i]
        increment_of.py_func(setup.rules, k, d, j, i)[: COLUMNS + 1] = *increments[i], times[i]

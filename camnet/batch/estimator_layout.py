"""State of many learning estimators as rows of arrays.

One row is the estimator of one target in one environment: what `camnet.estimation.learning_estimator` keeps in objects.
`EstimatorSetup` (`camnet.batch.estimator_setup`) is constant and shared by all rows. `EstimatorState` is three arrays
with the row as first axis (few, because every array that a compiled function takes is paid for at each call and when it
is compiled); columns' names are those of `camnet.batch.estimator_columns`:

| array | shape | what |
| --- | --- | --- |
| ``pose`` | (rows, POSE_COLUMNS) | instants, pose, prior, twist, exit and gap: columns T ... OFFSET |
| ``flags`` | (rows, ..) int64 | columns REGION ..., then of each model: counts, order, place |
| ``data`` | (rows, ..) | ``history``, ``samples``, ``sigma``, then the blocks of each model |

Parts of ``flags`` and ``data``, found with the functions of `camnet.batch.estimator_parts` that bear their names (J
models, one a region, or one for all with ``share``; p kernels; P is p rounded up to whole panels; C windows in a
stack):

| part | shape | what |
| --- | --- | --- |
| history | (H, 8) | latest poses of the sighting: t, p, q |
| samples | (S, 8) | poses of the window that is being collected: t, p, q |
| sigma | (S, P) | their sigma over the active kernels |
| counts | (J, COUNT_COLUMNS) | columns ACTIVE ... STALE |
| order, place | (J, p) | active kernels, see below |
| model | (J, MODEL_COLUMNS) | error radius, outlier gate: columns MEAN_SQUARE ... NORM2 |
| weights, moment | (J, P, 8) | W_hat and Q over the active kernels |
| inverse | (J, P P) | (I + dt kCL gamma (Psi + delta I))^-1, rows ``counts[STRIDE]`` apart |
| rows, increments | (J, C, P), (J, C, 9) | the stack; behind each increment when it entered |
| books | (J, C + P P) | leverages and inverse of the D-optimal rule, used once a stack is full |

Weights and stack live over the *active* kernels of a model alone, in the order in which they were first reached by a
measured pose or a path across a gap: ``order[:n]`` are their numbers, ``place[kernel]`` is the way back (-1: not
active). Every other weight is exactly zero, and there the inverse of the implicit step is a multiple of the identity.
Memory that is not reached stays untouched, so most of what the arrays ask for is never taken from the machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.batch.compiled import inner, outer
from camnet.batch.estimator_columns import (
    BLOCK,
    CAPACITY,
    CHANGED,
    COUNT_COLUMNS,
    FILLS,
    FLAG_COLUMNS,
    GAP_MODEL,
    GATE,
    LAST_SEEN,
    MEAN_SQUARE,
    MODEL_COLUMNS,
    POSE_COLUMNS,
    REGION,
    RUN_BEGAN,
    P,
    Q,
    T,
)
from camnet.batch.estimator_parts import counts_of, model_of, place_of
from camnet.batch.estimator_setup import EstimatorSetup, Rules, whole
from camnet.errors import ConfigError
from camnet.estimation.propagate import COLUMNS
from camnet.estimation.settings import EstimatorSettings
from camnet.geometry.borrow import lend
from camnet.types import Array, IntArray

__all__ = ["EstimatorState", "allocate", "reset", "reset_lent"]


class EstimatorState(NamedTuple):
    """State of all rows; see the module's head."""

    pose: Array
    flags: IntArray
    data: Array


def _stack_capacity(c: Rules, size: int, duration_s: float) -> int:
    """Windows that a stack of ``size`` can come to hold within ``duration_s``.

    A measured window takes as long as its intervals, one of a path across a gap at least half of ``window_s``.
    """
    if not duration_s > 0.0:
        raise ConfigError(f"duration_s {duration_s}: must be positive")
    shortest = min(c.intervals * c.dt_s, 0.5 * c.window_s)
    possible = duration_s / shortest + 2.0
    return size if possible >= size else math.ceil(possible)


def allocate(
    setup: EstimatorSetup, settings: EstimatorSettings, rows: int, duration_s: float = math.inf
) -> EstimatorState:
    """State of ``rows`` estimators, each as new.

    Parameters
    ----------
    setup : from `build_setup`
    settings : the same settings
    rows : number of estimators
    duration_s : longest time between two resets, s; stacks that cannot fill up in it take less memory

    Raises
    ------
    ConfigError
        If ``rows`` or ``duration_s`` is not positive.
    """
    if rows < 1:
        raise ConfigError(f"rows {rows}: must be positive")
    c = setup.rules
    capacity = _stack_capacity(c, settings.stack.size, duration_s)
    fills, padded = capacity == settings.stack.size, c.at.padded
    block = c.at.rows + whole(capacity * (padded + COLUMNS + 1))
    if fills:
        block += whole(padded * padded + capacity)
    state = EstimatorState(
        pose=np.zeros((rows, POSE_COLUMNS)),
        flags=np.zeros((rows, FLAG_COLUMNS + c.models * (COUNT_COLUMNS + 2 * c.size)), dtype=np.int64),
        data=np.zeros((rows, c.at.models + c.models * block)),
    )
    state.flags[:, CAPACITY], state.flags[:, FILLS], state.flags[:, BLOCK] = capacity, fills, block
    for row in range(rows):
        reset(setup, state, row)
    return state


@inner
def reset_lent(setup: EstimatorSetup, state: EstimatorState, row: int) -> None:
    """Make row ``row`` as new: nothing seen, nothing learned."""
    pose, flags = state.pose[row], state.flags[row]
    for i in range(POSE_COLUMNS):
        pose[i] = 0.0
    for i in range(CAPACITY):
        flags[i] = 0
    pose[T], pose[LAST_SEEN] = -math.inf, -math.inf
    pose[P], pose[P + 1], pose[P + 2] = math.nan, math.nan, math.nan
    pose[Q] = 1.0
    flags[REGION], flags[GAP_MODEL] = -1, -1
    for j in range(setup.rules.models):
        _reset_model(setup.rules, flags, state.data[row], j)


@outer
def reset(setup: EstimatorSetup, state: EstimatorState, row: int) -> None:
    """See ``reset_lent``."""
    reset_lent(lend(setup), lend(state), row)


@inner
def _reset_model(c: Rules, k: IntArray, d: Array, j: int) -> None:
    """Make model ``j`` of a row as new."""
    model, counts, places = model_of(c, k, d, j), counts_of(c, k, j), place_of(c, k, j)
    for i in range(MODEL_COLUMNS):
        model[i] = 0.0
    for i in range(COUNT_COLUMNS):
        counts[i] = 0
    for i in range(len(places)):
        places[i] = -1
    # radius: three standard deviations of 5 cm before anything was measured
    model[MEAN_SQUARE] = (0.05 / 3.0) ** 2
    model[GATE], model[GATE + 1] = math.inf, math.inf
    model[RUN_BEGAN], model[CHANGED] = math.inf, math.inf

"""The learning estimator of many environments in the loop; its kernels are in `camnet.batch.estimator`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from camnet.batch.compiled import inner, owner
from camnet.batch.estimator import (
    EstimatorSetup,
    EstimatorState,
    correct_lent,
    estimate_lent,
    predict_lent,
    rollout_lent,
)
from camnet.batch.estimator_columns import T
from camnet.batch.loop import after_frames, finish, fly_and_sense, frame_taken, open_decision, time_of
from camnet.batch.network import Model, network_at
from camnet.batch.observe import due, find_entries, forget_entries
from camnet.batch.state import State, state_at
from camnet.geometry.pinned import Pins
from camnet.types import Array, IntArray

__all__ = ["LEARNING", "Learning", "decide"]


class Learning(NamedTuple):
    """Estimators of E environments and M targets: row ``e M + m`` is that of target m in environment e."""

    setup: EstimatorSetup
    rows: EstimatorState


#: estimators at addresses
LEARNING = Pins(Learning)
_learning_at = LEARNING.of


@inner
def update(est: Learning, state: State, e: int, m: int, t_s: float) -> None:
    """Advance the estimator of target ``m`` to ``t_s``, with the measurement if there is one."""
    r, z = e * state.target.shape[1] + m, state.measured[e, m]
    if z[7] < 0.0:
        predict_lent(est.setup, est.rows, r, t_s)
    else:
        correct_lent(est.setup, est.rows, r, t_s, z[0:3], z[3:7], int(z[7]))
    row = state.estimate[e, m]
    region = estimate_lent(est.setup, est.rows, r, row)
    row[16], row[15] = row[15], float(region)


@inner
def roll_out(est: Learning, model: Model, state: State, e: int, m: int, wide: Array, path: Array) -> float:
    """Write the predicted points and error radii (K, 4) to ``path``, by way of ``wide`` (K, 8); time before it, s."""
    r = e * state.target.shape[1] + m
    rollout_lent(est.setup, est.rows, r, model.rollout_dt_s, wide)
    for k in range(path.shape[0]):
        path[k, 0], path[k, 1], path[k, 2], path[k, 3] = wide[k, 0], wide[k, 1], wide[k, 2], wide[k, 7]
    return float(est.rows.pose[r, T])


@inner
def _predict_entries(est: Learning, model: Model, state: State, e: int, wide: Array, path: Array) -> None:
    """Predict where and when each target of environment ``e`` enters each region."""
    for m in range(state.target.shape[1]):
        if state.estimate[e, m, 15] >= 0.0:
            at = roll_out(est, model, state, e, m, wide, path)
            find_entries(model, state, e, m, path, at)
        else:
            forget_entries(state, e, m)


@inner
def _decide_block(
    model: Model,
    state: State,
    est: Learning,
    block: IntArray,
    fresh: bool,
    actions: Array,
    noise: Array,
    wide: Array,
    path: Array,
    observations: NDArray[np.float32],
    outcome: Array,
) -> None:
    """Run the environments of a block through one decision; ``noise`` (C, M, 6) and the paths are scratch."""
    for _ in range(open_decision(model, state, block, fresh, actions)):
        fly_and_sense(model, state, block, fresh, noise)
        for e in block:
            if frame_taken(model, state, e):
                for m in range(state.target.shape[1]):
                    update(est, state, e, m, time_of(model, state, e))
        after_frames(model, state, block)
    for e in block:
        if due(model, state, e, time_of(model, state, e)):
            _predict_entries(est, model, state, e, wide, path)
    finish(model, state, block, fresh, observations, outcome)


@owner
def decide(
    model_place: int,
    state_place: int,
    place: int,
    chosen: IntArray,
    fresh: bool,
    actions: Array,
    observations: NDArray[np.float32],
    outcome: Array,
) -> None:
    """Run the ``chosen`` environments through one decision; ``fresh`` ones sense where they start.

    The places are addresses at which `MODELS`, `STATES` and `LEARNING` have pinned network, state and estimators.
    """
    model, state, est = network_at(model_place), state_at(state_place), _learning_at(place)
    noise = np.empty((state.cameras.shape[1], state.target.shape[1], 6))
    path, wide = np.empty((model.steps, 4)), np.empty((model.steps, 8))
    together = state.lanes.shape[0]
    for first in range(0, len(chosen), together):
        block = chosen[first : first + together]
        _decide_block(model, state, est, block, fresh, actions, noise, wide, path, observations, outcome)

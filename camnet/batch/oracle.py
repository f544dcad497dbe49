"""The truth, now and to come, in place of an estimate: `camnet.simulation.oracle` for many environments.

A target's motion depends on its state, the time and its own stream alone, so copies of those, stepped ahead, go through
what the environment will show. They run ahead by the look-ahead time; where they were is kept in a ring.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from camnet.batch.compiled import inner, owner
from camnet.batch.loop import after_frames, finish, fly_and_sense, frame_taken, open_decision, time_of
from camnet.batch.motion import step_target
from camnet.batch.network import Model, network_at
from camnet.batch.observe import due, find_entries, forget_entries
from camnet.batch.random import Streams
from camnet.batch.state import State, state_at
from camnet.batch.target_planned import PLAN
from camnet.estimation.observation import LOST_PERIODS
from camnet.geometry.pinned import Pins
from camnet.types import Array, IntArray

__all__ = ["ORACLES", "Oracle", "allocate_oracle", "decide", "reset_oracle"]


class Oracle(NamedTuple):
    """Copies that run ahead, of E environments and M targets.

    Attributes
    ----------
    target, inner, streams : (E, M, 13), (E, M, 8), (E * M, 4) as in `State`, at the steps ``made`` (E,)
    plans : (E, M, PLAN) as there
    ring : (E, L, M, 3) points of the last L steps
    at : (E, M) time of the last sensing, s
    """

    target: Array
    inner: Array
    streams: Streams
    plans: Array
    made: IntArray
    ring: Array
    at: Array


#: copies at addresses
ORACLES = Pins(Oracle)
_oracle_at = ORACLES.of


def allocate_oracle(model: Model, environments: int) -> Oracle:
    """Room for the copies."""
    e, m = environments, len(model.speeds)
    length = round(model.steps * model.rollout_dt_s / model.dt_s) + model.decide_every + 2
    return Oracle(
        np.zeros((e, m, 13)),
        np.zeros((e, m, 8)),
        np.zeros((e * m, 4), dtype=np.uint64),
        np.zeros((e, m, PLAN)),
        np.zeros(e, dtype=np.int64),
        np.zeros((e, length, m, 3)),
        np.zeros((e, m)),
    )


def reset_oracle(oracle: Oracle, state: State, e: int) -> None:
    """Copy the start of environment ``e``."""
    m = state.target.shape[1]
    oracle.target[e], oracle.inner[e], oracle.made[e] = state.target[e], state.inner[e], 0
    oracle.streams[e * m : (e + 1) * m] = state.streams[e * (2 + m) + 2 : (e + 1) * (2 + m)]
    oracle.plans[e] = state.plans[e]
    oracle.ring[e, 0] = state.target[e, :, :3]


@inner
def update(oracle: Oracle, model: Model, state: State, e: int, m: int, t_s: float) -> None:
    """Know the truth of target ``m``, once it has been seen for the first time."""
    row, z = state.estimate[e, m], state.measured[e, m]
    if z[7] >= 0.0:
        row[13], row[14], row[15], row[16] = 1.0, t_s, z[7], 0.0
    elif row[15] < 0.0:
        return
    else:
        row[13] = 1.0 if t_s - row[14] <= LOST_PERIODS * model.sense_dt_s else 0.0
    for i in range(13):
        row[i] = state.target[e, m, i]
    oracle.at[e, m] = t_s


@inner
def _run_ahead(oracle: Oracle, model: Model, e: int, until: int) -> None:
    """Step the copies of environment ``e`` until they have made so many steps."""
    length, targets = oracle.ring.shape[1], oracle.ring.shape[2]
    while oracle.made[e] < until:
        t_s = oracle.made[e] * model.dt_s
        oracle.made[e] += 1
        for m in range(targets):
            row = e * targets + m
            plan = oracle.plans[e, m]
            step_target(
                model.targets, m, oracle.target, oracle.inner, e, t_s, model.dt_s, oracle.streams, row, plan
            )
            for i in range(3):
                oracle.ring[e, oracle.made[e] % length, m, i] = oracle.target[e, m, i]


@inner
def roll_out(oracle: Oracle, model: Model, state: State, e: int, m: int, path: Array) -> None:
    """Write the true coming points (K, 4), with no error, to ``path``: those of the nearest steps."""
    length, steps = oracle.ring.shape[1], path.shape[0]
    _run_ahead(oracle, model, e, int(np.rint((oracle.at[e, m] + model.rollout_dt_s * steps) / model.dt_s)))
    for k in range(steps):
        step = int(np.rint((oracle.at[e, m] + model.rollout_dt_s * (k + 1)) / model.dt_s))
        for i in range(3):
            path[k, i] = oracle.ring[e, step % length, m, i]
        path[k, 3] = 0.0


@inner
def _predict_entries(oracle: Oracle, model: Model, state: State, e: int, path: Array) -> None:
    """Predict where and when each target of environment ``e`` enters each region."""
    for m in range(state.target.shape[1]):
        if state.estimate[e, m, 15] >= 0.0:
            roll_out(oracle, model, state, e, m, path)
            find_entries(model, state, e, m, path, oracle.at[e, m])
        else:
            forget_entries(state, e, m)


@inner
def _decide_block(
    model: Model,
    state: State,
    oracle: Oracle,
    block: IntArray,
    fresh: bool,
    actions: Array,
    noise: Array,
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
                    update(oracle, model, state, e, m, time_of(model, state, e))
        after_frames(model, state, block)
    for e in block:
        if due(model, state, e, time_of(model, state, e)):
            _predict_entries(oracle, model, state, e, path)
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

    The places are addresses at which `MODELS`, `STATES` and `ORACLES` have pinned network, state and estimators.
    """
    model, state, oracle = network_at(model_place), state_at(state_place), _oracle_at(place)
    noise = np.empty((state.cameras.shape[1], state.target.shape[1], 6))
    path = np.empty((model.steps, 4))
    together = state.lanes.shape[0]
    for first in range(0, len(chosen), together):
        block = chosen[first : first + together]
        _decide_block(model, state, oracle, block, fresh, actions, noise, path, observations, outcome)

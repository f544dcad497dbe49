"""The constant-velocity filter of many environments; kernels and numbers of `camnet.estimation.ekf`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from camnet.batch.compiled import inner, inner_owner, owner
from camnet.batch.loop import after_frames, finish, fly_and_sense, frame_taken, open_decision, time_of
from camnet.batch.network import Model, network_at
from camnet.batch.observe import due, find_entries, forget_entries
from camnet.batch.state import State, state_at
from camnet.estimation.ekf import START_RATE_RADPS, START_SPEED_MPS
from camnet.estimation.ekf_step import correct_state, predict_state
from camnet.estimation.observation import LOST_PERIODS
from camnet.estimation.settings import EkfSettings
from camnet.geometry.pinned import Pins
from camnet.types import Array, IntArray

__all__ = ["KALMANS", "Kalman", "allocate_kalman", "decide", "reset_kalman"]


class Kalman(NamedTuple):
    """Filters of E environments and M targets.

    Attributes
    ----------
    noise : (4,) densities of the accelerations, variances of position and orientation
    at : (E, M) time of the state, s
    cov_p, cov_q : (E, M, 2, 2), (E, M, 6, 6)
    """

    noise: Array
    at: Array
    cov_p: Array
    cov_q: Array


#: filters at addresses
KALMANS = Pins(Kalman)
_kalman_at = KALMANS.of


def allocate_kalman(settings: EkfSettings, environments: int, targets: int) -> Kalman:
    """Room for the filters."""
    s, shape = settings, (environments, targets)
    noise = [
        s.accel_psd_m2ps3,
        s.angular_accel_psd_rad2ps3,
        s.position_noise_m**2,
        s.orientation_noise_rad**2,
    ]
    return Kalman(
        np.array(noise), np.full(shape, -np.inf), np.zeros((*shape, 2, 2)), np.zeros((*shape, 6, 6))
    )


def reset_kalman(kalman: Kalman, e: int) -> None:
    """Forget everything about environment ``e``."""
    kalman.at[e] = -np.inf
    kalman.cov_p[e] = np.diag([kalman.noise[2], START_SPEED_MPS**2])
    kalman.cov_q[e] = np.diag([kalman.noise[3]] * 3 + [START_RATE_RADPS**2] * 3)


@inner_owner
def _advance(kalman: Kalman, state: State, e: int, m: int, t_s: float) -> None:
    row, k = state.estimate[e, m], kalman.noise
    cov_p, cov_q = kalman.cov_p[e, m], kalman.cov_q[e, m]
    duration = t_s - kalman.at[e, m]
    predict_state(row[0:3], row[3:7], row[7:10], row[10:13], cov_p, cov_q, duration, k[0], k[1])
    kalman.at[e, m] = t_s


@inner_owner
def update(kalman: Kalman, model: Model, state: State, e: int, m: int, t_s: float) -> None:
    """Advance the filter of target ``m`` to ``t_s``, with the measurement if there is one."""
    row, z = state.estimate[e, m], state.measured[e, m]
    if z[7] < 0.0:
        if row[15] < 0.0:
            return
        row[13] = 1.0 if t_s - row[14] <= LOST_PERIODS * model.sense_dt_s else 0.0
        _advance(kalman, state, e, m, t_s)
    elif row[15] < 0.0:
        row[0:7] = z[0:7]
        kalman.at[e, m] = t_s
    else:
        _advance(kalman, state, e, m, t_s)
        correct_state(
            row[0:3],
            row[3:7],
            row[7:10],
            row[10:13],
            kalman.cov_p[e, m],
            kalman.cov_q[e, m],
            z[0:3],
            z[3:7],
            kalman.noise[2],
            kalman.noise[3],
        )
    if z[7] >= 0.0:
        row[13], row[14], row[15] = 1.0, t_s, z[7]
    row[16] = 3.0 * math.sqrt(kalman.cov_p[e, m, 0, 0]) + state.own_m[e, m]


@inner_owner
def roll_out(kalman: Kalman, model: Model, state: State, e: int, m: int, path: Array) -> None:
    """Write the coming points and error radii (K, 4) at constant velocity to ``path``."""
    c, rho = kalman.cov_p[e, m], kalman.noise[0]
    for k in range(path.shape[0]):
        tau = model.rollout_dt_s * (k + 1)
        for i in range(3):
            path[k, i] = state.estimate[e, m, i] + tau * state.estimate[e, m, 7 + i]
        variance = c[0, 0] + 2.0 * tau * c[0, 1] + tau**2 * c[1, 1] + rho * tau**3 / 3.0
        path[k, 3] = 3.0 * math.sqrt(variance)


@inner
def _predict_entries(kalman: Kalman, model: Model, state: State, e: int, path: Array) -> None:
    """Predict where and when each target of environment ``e`` enters each region."""
    for m in range(state.target.shape[1]):
        if state.estimate[e, m, 15] >= 0.0:
            roll_out(kalman, model, state, e, m, path)
            find_entries(model, state, e, m, path, kalman.at[e, m])
        else:
            forget_entries(state, e, m)


@inner
def _decide_block(
    model: Model,
    state: State,
    kalman: Kalman,
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
                    update(kalman, model, state, e, m, time_of(model, state, e))
        after_frames(model, state, block)
    for e in block:
        if due(model, state, e, time_of(model, state, e)):
            _predict_entries(kalman, model, state, e, path)
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

    The places are addresses at which `MODELS`, `STATES` and `KALMANS` have pinned network, state and estimators.
    """
    model, state, kalman = network_at(model_place), state_at(state_place), _kalman_at(place)
    noise = np.empty((state.cameras.shape[1], state.target.shape[1], 6))
    path = np.empty((model.steps, 4))
    together = state.lanes.shape[0]
    for first in range(0, len(chosen), together):
        block = chosen[first : first + together]
        _decide_block(model, state, kalman, block, fresh, actions, noise, path, observations, outcome)

"""The learning estimator for many environments: what loops over environments call.

Compiled twin of `camnet.estimation.learning_estimator.LearningEstimator` in the world frame, which is its oracle and
says what is done and why. All state is in rows of arrays (`camnet.batch.estimator_layout`); nothing here makes a Python
object or holds the interpreter's lock. A setup has the room that its rows are worked on in: threads need their own.

    setup = build_setup(settings, basis, n_regions, rate_hz, tracking_bounds, roads)   once, in Python
    state = allocate(setup, settings, rows, duration_s)                                once, in Python
    reset(setup, state, row)                                                           start of an episode
    correct(setup, state, row, t_s, p, q, region)                                      a measured world pose
    predict(setup, state, row, t_s)                                                    an instant without one
    rollout(setup, state, row, dt_s, out)                                              out (K, 8): path at dt, 2 dt, ...
    estimate(setup, state, row, out)                                                   out (16,): see ``ESTIMATE``

``p`` (3,) and ``q`` (4,) are the measured pose of the target in the world; ``region`` is the index of the camera that
measured it. Times must not run backwards; a measurement older than the state is moved along as in the class.

Loops that hold setup and state by their address (`camnet.geometry.borrow.lend`) call ``correct_lent`` and its like.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner, outer
from camnet.batch.estimator_columns import (
    ADVANCED,
    CROSSED,
    GAP_MODEL,
    LAST_SEEN,
    MEAN_SQUARE,
    MODEL,
    OWED,
    POSE_COLUMNS,
    RATES,
    REGION,
    SEEN,
    TWIST,
    P,
    Q,
    T,
)
from camnet.batch.estimator_layout import EstimatorState, allocate, reset, reset_lent
from camnet.batch.estimator_learn import lose, note_pose, refresh_prior
from camnet.batch.estimator_measured import active_sigma, align, correct_seen, learn, resight
from camnet.batch.estimator_model import settle
from camnet.batch.estimator_motion import advance, integrate
from camnet.batch.estimator_parts import counts_of, model_of
from camnet.batch.estimator_setup import EstimatorSetup, Rules, build_setup
from camnet.estimation.learning_estimator import MAX_STEP_S
from camnet.estimation.observation import LOST_PERIODS
from camnet.estimation.radius import BLIND_SHARE, MARGIN, REMEMBERED_GAPS
from camnet.geometry.borrow import lend
from camnet.geometry.triples import size
from camnet.types import Array, IntArray

__all__ = [
    "ESTIMATE",
    "EstimatorSetup",
    "EstimatorState",
    "allocate",
    "build_setup",
    "correct",
    "correct_lent",
    "estimate",
    "estimate_lent",
    "predict",
    "predict_lent",
    "reset",
    "reset_lent",
    "rollout",
    "rollout_lent",
]

#: where the fields of an estimate are in ``out`` of `estimate`: first column and number of columns
ESTIMATE = {
    "p_world": (0, 3),
    "q_world": (3, 4),
    "v_world": (7, 3),
    "w_body": (10, 3),
    "seen": (13, 1),
    "last_seen_s": (14, 1),
    "radius_m": (15, 1),
}


# --- results ---------------------------------------------------------------------------------------------------------


@inner
def _growth(c: Rules, pose: Array, k: IntArray, d: Array) -> float:
    """Growth of the error radius while unseen, m/s."""
    j = k[MODEL]
    crossed = min(counts_of(c, k, j)[CROSSED], REMEMBERED_GAPS)
    if crossed == 0:
        return BLIND_SHARE * size(pose[TWIST], pose[TWIST + 1], pose[TWIST + 2])
    model, most = model_of(c, k, d, j), 0.0
    for i in range(crossed):
        most = max(most, model[RATES + i])
    return MARGIN * most


@inner
def _radius(c: Rules, pose: Array, k: IntArray, d: Array) -> float:
    if k[REGION] < 0:
        return math.inf
    base = 3.0 * math.sqrt(model_of(c, k, d, k[MODEL])[MEAN_SQUARE])
    return float(base + _growth(c, pose, k, d) * max(0.0, pose[T] - pose[LAST_SEEN]))


@inner
def estimate_lent(setup: EstimatorSetup, state: EstimatorState, row: int, out: Array) -> int:
    """Write what is believed now to ``out`` (16,), fields as in ``ESTIMATE``; return the region last seen in or -1.

    Before the first measurement the position is NaN and the error radius infinite.
    """
    pose, k = state.pose[row], state.flags[row]
    for i in range(3):
        out[i], out[7 + i], out[10 + i] = pose[P + i], pose[TWIST + i], pose[TWIST + 3 + i]
    for i in range(4):
        out[3 + i] = pose[Q + i]
    out[13], out[14], out[15] = k[SEEN], pose[LAST_SEEN], _radius(setup.rules, pose, k, state.data[row])
    return int(k[REGION])


@inner
def rollout_lent(setup: EstimatorSetup, state: EstimatorState, row: int, dt_s: float, out: Array) -> None:
    """Future path if no measurement came any more: ``out`` (K, 8) takes p, q and radius at dt, 2 dt, ... from now.

    What is believed does not change. Before the first measurement positions are NaN and the radius is infinite.
    """
    pose, k, d = state.pose[row], state.flags[row], state.data[row]
    if k[REGION] < 0:
        for i in range(len(out)):
            out[i, 0], out[i, 1], out[i, 2], out[i, 7] = math.nan, math.nan, math.nan, math.inf
            out[i, 3], out[i, 4], out[i, 5], out[i, 6] = pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3]
        return
    c = setup.rules
    refresh_prior(c, pose, k, d)
    start, rate = _radius(c, pose, k, d), _growth(c, pose, k, d)
    substeps = max(1, math.ceil(dt_s / (4.0 * MAX_STEP_S)))
    copy = c.work.pose
    for i in range(POSE_COLUMNS):
        copy[i] = pose[i]
    integrate(setup.kernels, setup.roads, c, k, d, copy, dt_s, substeps, out)
    for i in range(len(out)):
        out[i, 7] = start + rate * (dt_s * (i + 1))


# --- advancing -------------------------------------------------------------------------------------------------------


@inner
def predict_lent(setup: EstimatorSetup, state: EstimatorState, row: int, t_s: float) -> None:
    """Advance ``row`` to ``t_s`` without a measurement; nothing happens before the first one."""
    c, pose, k, d = setup.rules, state.pose[row], state.flags[row], state.data[row]
    if k[REGION] < 0 or t_s <= pose[T]:
        return
    if k[SEEN] and t_s - pose[LAST_SEEN] > LOST_PERIODS * c.dt_s:
        lose(c, pose, k, d, setup.roads)
    advance(setup.kernels, setup.roads, c, pose, k, d, t_s)


@inner
def correct_lent(
    setup: EstimatorSetup, state: EstimatorState, row: int, t_s: float, p: Array, q: Array, region: int
) -> bool:
    """Advance ``row`` to ``t_s`` with a measured world pose p (3,), q (4,) in force; the first call initialises.

    True if a measured window was offered to the stack: it then is in ``work.offered``, over the active kernels.
    """
    kernels, c = setup.kernels, setup.rules
    pose, k, d = state.pose[row], state.flags[row], state.data[row]
    j = 0 if c.models == 1 else region
    first = k[REGION] < 0
    t = t_s if first else max(t_s, pose[T])
    at, measured = c.work.position, c.work.orientation
    for i in range(3):
        at[i] = p[i] + (t - t_s) * pose[TWIST + i]
    for i in range(4):
        measured[i] = q[i]
    known = not first and t - pose[LAST_SEEN] <= LOST_PERIODS * c.dt_s and j == k[MODEL]
    if not (first or known):
        if k[SEEN] and t - pose[LAST_SEEN] > LOST_PERIODS * c.dt_s:
            lose(c, pose, k, d, setup.roads)
        advance(kernels, setup.roads, c, pose, k, d, t)
        resight(c, pose, k, d, t, at)
    if not first:
        align(measured, pose[Q:])
    if first or (not known and c.reset_on_sighting):
        for i in range(3):
            pose[P + i] = at[i]
        for i in range(4):
            pose[Q + i] = measured[i]
    k[MODEL] = j
    if not known:
        # the law ran on while the model was not in force
        model = model_of(c, k, d, j)
        settle(c, k, d, j, t - model[ADVANCED])
        model[ADVANCED], pose[OWED] = max(t, model[ADVANCED]), 0.0
    count = active_sigma(kernels, c, k, d, j, at, measured)
    if known:
        correct_seen(c, pose, k, d, t, at, measured, count)
    k[REGION], k[SEEN], pose[LAST_SEEN], pose[T] = region, 1, t, t
    complete = note_pose(c, k, d, t, at, measured, c.work.places, c.work.sigma, count)
    offered = False
    for across in range(2):
        if (across == 0 and complete) or (across == 1 and k[GAP_MODEL] >= 0):
            entered = learn(kernels, c, pose, k, d, across)
            if across == 0 and entered:
                offered = True
                for a in range(c.size):
                    c.work.offered[a] = c.work.rows[0, a]
    return offered


# --- from Python -----------------------------------------------------------------------------------------------------


@outer
def estimate(setup: EstimatorSetup, state: EstimatorState, row: int, out: Array) -> int:
    """See ``estimate_lent``."""
    return int(estimate_lent(lend(setup), lend(state), row, out))


@outer
def rollout(setup: EstimatorSetup, state: EstimatorState, row: int, dt_s: float, out: Array) -> None:
    """See ``rollout_lent``."""
    rollout_lent(lend(setup), lend(state), row, dt_s, out)


@outer
def predict(setup: EstimatorSetup, state: EstimatorState, row: int, t_s: float) -> None:
    """See ``predict_lent``."""
    predict_lent(lend(setup), lend(state), row, t_s)


@outer
def correct(
    setup: EstimatorSetup, state: EstimatorState, row: int, t_s: float, p: Array, q: Array, region: int
) -> None:
    """See ``correct_lent``."""
    correct_lent(lend(setup), lend(state), row, t_s, p, q, region)

"""A learned model that is not learned any further, of many environments: cheap enough for training.

The estimator is `camnet.estimation.learning_estimator` with its weights held: the same feedback while the target is
seen (harris2020 (3-8), (4-16)), the same predictor while it is not (3-15), the same error radius. What it takes from
the weights, the twist and the support at a place, is read from a table (bilinear), so that a step costs the same
whatever the number of kernels. Three things differ. The prior mean turns about the vertical, not about the estimated
body axis (they differ by the measured tilt, hundredths of a radian). While the target is seen and the model answers for
its motion the prior is renewed when it is next needed rather than at every measurement. And the prior is integrated to
second order (`camnet.batch.frozen_motion.midpoint`), the class's to first, so that roll-outs may take longer steps.

| array | row of one (environment, target) |
| --- | --- |
| ``pose`` (E, M, 15) | t, p (3), q (4), prior mean (v, w: 6), how far left of its way on the road it left |
| ``history`` (E, M, 2 H, 8) | latest H poses of the sighting (t, p, q), a ring kept twice: they lie in one piece |
| ``fitted`` (E, M, 13) | last fit to them |
| ``held`` (E, M, 3) | their count, next place, whether a fit is due |
| ``square`` (E, M, J) | mean square residual of each of a target's J models, m^2 |
| ``rates`` (E, M, J, 9) | error rates of the last 8 gaps, m/s, and their count |
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.batch.compiled import inner, owner
from camnet.batch.frozen_memory import growth_rate, model_in_force, refresh_prior, remember, set_radius
from camnet.batch.frozen_motion import Frozen, blended, frozen_at, learned, midpoint
from camnet.batch.loop import after_frames, finish, fly_and_sense, frame_taken, open_decision, time_of
from camnet.batch.network import Model, network_at
from camnet.batch.observe import due, find_entries, forget_entries
from camnet.batch.state import State, state_at
from camnet.batch.triples import turn
from camnet.estimation.concurrent_learning import switching
from camnet.estimation.observation import LOST_PERIODS
from camnet.estimation.radius import MEMORY, REMEMBERED_GAPS
from camnet.estimation.road_prior import offset_of
from camnet.geometry.triples import Quaternion, Triple, multiply
from camnet.types import Array, IntArray

__all__ = ["Frozen", "decide"]

#: longest step of the predictor's integration, s
_MAX_STEP_S = 0.05
#: share of the motion that the model leaves to the prior from which on the prior is kept up to date while seen
_PRIOR_MATTERS = 0.05


@inner
def _shares(f: Frozen, dt: float) -> tuple[float, float, float]:
    """Return what half of ``dt`` leaves of the prior's turn, and how far prior and feedback come in ``dt``."""
    if abs(dt - f.period[0]) < 1e-12:
        return f.period[1], f.period[2], f.period[3]
    return math.exp(-0.5 * dt / f.turn_memory_s), -math.expm1(-dt / f.handover_s), -math.expm1(-f.k1 * dt)


@inner
def _road_offset(f: Frozen, state: State, e: int, m: int) -> float:
    """How far left of its way on the road the target is, or was when last seen."""
    if state.estimate[e, m, 13] > 0.0:
        p = f.pose[e, m]
        f.pose[e, m, 14] = offset_of(p[1], p[2], p[8], p[9], f.roads)
    return float(f.pose[e, m, 14])


@inner
def _advance(f: Frozen, state: State, e: int, m: int, t_s: float) -> None:
    """Motion without feedback up to ``t_s``: (3-15)."""
    pose = f.pose
    duration = t_s - pose[e, m, 0]
    if duration <= 0.0:
        return
    k = f.model_of[m, int(state.estimate[e, m, 15])]
    steps = math.ceil(duration / _MAX_STEP_S)
    dt = duration / steps
    fade, share, _ = _shares(f, dt)
    p = (pose[e, m, 1], pose[e, m, 2], pose[e, m, 3])
    q: Quaternion = (pose[e, m, 4], pose[e, m, 5], pose[e, m, 6], pose[e, m, 7])
    pv = (pose[e, m, 8], pose[e, m, 9], pose[e, m, 10])
    pw = (pose[e, m, 11], pose[e, m, 12], pose[e, m, 13])
    v, w, offset = pv, pw, _road_offset(f, state, e, m)
    for _ in range(steps):
        p, v, w, pv, pw = midpoint(f, k, p, pv, pw, dt, fade, share, offset)
        q = multiply(q, turn(dt * w[0], dt * w[1], dt * w[2]))
    _keep(f, state, e, m, t_s, p, q, v, w)
    for i in range(3):
        pose[e, m, 8 + i], pose[e, m, 11 + i] = pv[i], pw[i]


@inner
def _keep(
    f: Frozen, state: State, e: int, m: int, t_s: float, p: Triple, q: Quaternion, v: Triple, w: Triple
) -> None:
    """Store time, pose (its quaternion normalised) and twist, and show them."""
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    f.pose[e, m, 0] = t_s
    for i in range(3):
        f.pose[e, m, 1 + i] = state.estimate[e, m, i] = p[i]
        state.estimate[e, m, 7 + i], state.estimate[e, m, 10 + i] = v[i], w[i]
    for i in range(4):
        f.pose[e, m, 4 + i] = state.estimate[e, m, 3 + i] = scale * q[i]


@inner
def _lose(f: Frozen, state: State, e: int, m: int) -> None:
    """Note that the target has become unseen, and how it left."""
    refresh_prior(f, e, m)
    _road_offset(f, state, e, m)
    state.estimate[e, m, 13] = 0.0


@inner
def _resight(f: Frozen, model: Model, state: State, e: int, m: int, t_s: float) -> None:
    """Take the target up again, after a gap or handed over without one."""
    s, z = state.estimate, state.measured
    if s[e, m, 13] > 0.0 and t_s - s[e, m, 14] > LOST_PERIODS * model.sense_dt_s:
        _lose(f, state, e, m)
    refresh_prior(f, e, m)
    without_gap = s[e, m, 13] > 0.0
    _advance(f, state, e, m, t_s)
    f.held[e, m, 0] = 0
    duration, r = t_s - s[e, m, 14], model_in_force(f, state, e, m)
    if not without_gap and duration > 0.0:
        miss = 0.0
        for i in range(3):
            miss += (z[e, m, i] - f.pose[e, m, 1 + i]) ** 2
        count = int(f.rates[e, m, r, REMEMBERED_GAPS])
        f.rates[e, m, r, count % REMEMBERED_GAPS] = math.sqrt(miss) / duration
        f.rates[e, m, r, REMEMBERED_GAPS] = count + 1
    if f.reset_on_sighting:
        _restart_pose(f, state, e, m, t_s)


@inner
def _restart_pose(f: Frozen, state: State, e: int, m: int, t_s: float) -> None:
    """Put the pose at the measured one; the quaternion with the sign of the present."""
    z, pose = state.measured, f.pose
    dot = 0.0
    for i in range(4):
        dot += pose[e, m, 4 + i] * z[e, m, 3 + i]
    sign = -1.0 if dot < 0.0 else 1.0
    pose[e, m, 0] = t_s
    for i in range(3):
        pose[e, m, 1 + i] = state.estimate[e, m, i] = z[e, m, i]
    for i in range(4):
        pose[e, m, 4 + i] = state.estimate[e, m, 3 + i] = sign * z[e, m, 3 + i]


@inner
def _follow(f: Frozen, model: Model, state: State, e: int, m: int, t_s: float) -> None:
    """In view, (3-8), (4-16): the model's rates at the measured pose, then the feedback."""
    z, pose, r = state.measured, f.pose, model_in_force(f, state, e, m)
    answer = learned(f, f.model_of[m, 0] + r, z[e, m, 0], z[e, m, 1])
    if 1.0 - answer[6] > _PRIOR_MATTERS:
        refresh_prior(f, e, m)
    pv = (pose[e, m, 8], pose[e, m, 9], pose[e, m, 10])
    v, w, _ = blended(answer, pv, (pose[e, m, 11], pose[e, m, 12], pose[e, m, 13]), f.prior > 0)
    dt = t_s - pose[e, m, 0]
    q: Quaternion = (pose[e, m, 4], pose[e, m, 5], pose[e, m, 6], pose[e, m, 7])
    spin = multiply(q, (0.0, w[0], w[1], w[2]))
    q = (
        q[0] + 0.5 * dt * spin[0],
        q[1] + 0.5 * dt * spin[1],
        q[2] + 0.5 * dt * spin[2],
        q[3] + 0.5 * dt * spin[3],
    )
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    q = (scale * q[0], scale * q[1], scale * q[2], scale * q[3])
    dot = q[0] * z[e, m, 3] + q[1] * z[e, m, 4] + q[2] * z[e, m, 5] + q[3] * z[e, m, 6]
    sign = -1.0 if dot < 0.0 else 1.0
    _, _, share = _shares(f, dt)
    x, dx = _fed_back(f, pose[e, m, 1] + dt * v[0], z[e, m, 0], share, dt)
    y, dy = _fed_back(f, pose[e, m, 2] + dt * v[1], z[e, m, 1], share, dt)
    h, dh = _fed_back(f, pose[e, m, 3] + dt * v[2], z[e, m, 2], share, dt)
    q = (
        _fed_back(f, q[0], sign * z[e, m, 3], share, dt)[0],
        _fed_back(f, q[1], sign * z[e, m, 4], share, dt)[0],
        _fed_back(f, q[2], sign * z[e, m, 5], share, dt)[0],
        _fed_back(f, q[3], sign * z[e, m, 6], share, dt)[0],
    )
    _keep(f, state, e, m, t_s, (x, y, h), q, v, w)
    f.square[e, m, r] += (dx * dx + dy * dy + dh * dh - f.square[e, m, r]) / MEMORY


@inner
def _fed_back(f: Frozen, x: float, measured: float, share: float, dt: float) -> tuple[float, float]:
    """One coordinate after the feedback, and its error before."""
    error = measured - x
    return x + share * error + dt * f.k2 * switching(error, f.switching, f.layer), error


@inner
def update(f: Frozen, model: Model, state: State, e: int, m: int, t_s: float) -> None:
    """Advance the estimate of target ``m`` to ``t_s``, with the measurement if there is one."""
    s, region = state.estimate, state.measured[e, m, 7]
    lost_s = LOST_PERIODS * model.sense_dt_s
    if region < 0.0:
        if s[e, m, 15] < 0.0:
            return
        if s[e, m, 13] > 0.0 and t_s - s[e, m, 14] > lost_s:
            _lose(f, state, e, m)
            f.held[e, m, 0] = 0
        elif s[e, m, 13] > 0.0:
            refresh_prior(f, e, m)
        _advance(f, state, e, m, t_s)
    else:
        if s[e, m, 15] < 0.0:
            _restart_pose(f, state, e, m, t_s)
        elif t_s - s[e, m, 14] > lost_s or f.model_of[m, int(region)] != f.model_of[m, int(s[e, m, 15])]:
            _resight(f, model, state, e, m, t_s)
        else:
            _follow(f, model, state, e, m, t_s)
        s[e, m, 13], s[e, m, 14], s[e, m, 15] = 1.0, t_s, region
        remember(f, state, e, m, t_s)
    set_radius(f, state, e, m)


@inner
def roll_out(f: Frozen, model: Model, state: State, e: int, m: int, path: Array) -> None:
    """Write the predicted points and error radii (K, 4) to ``path``; those within a step lie on its chord."""
    refresh_prior(f, e, m)
    pose, dt = f.pose, model.rollout_dt_s
    k = f.model_of[m, int(state.estimate[e, m, 15])]
    stride, substeps = f.strides
    h = dt * stride / substeps
    fade, share, _ = _shares(f, h)
    per_stride = 1.0 / stride
    p = (pose[e, m, 1], pose[e, m, 2], pose[e, m, 3])
    pv = (pose[e, m, 8], pose[e, m, 9], pose[e, m, 10])
    pw = (pose[e, m, 11], pose[e, m, 12], pose[e, m, 13])
    radius, per_s, offset = (
        state.estimate[e, m, 16],
        growth_rate(f, state, e, m),
        _road_offset(f, state, e, m),
    )
    for first in range(0, path.shape[0], stride):
        begin = p
        for _ in range(substeps):
            p, _, _, pv, pw = midpoint(f, k, p, pv, pw, h, fade, share, offset)
        for i in range(first, min(first + stride, path.shape[0])):
            gone = per_stride * (i - first + 1.0)
            for j in range(3):
                path[i, j] = begin[j] + gone * (p[j] - begin[j])
            path[i, 3] = radius + per_s * dt * (i + 1)


@inner
def _predict_entries(f: Frozen, model: Model, state: State, e: int, path: Array) -> None:
    """Predict where and when each target of environment ``e`` enters each region."""
    for m in range(state.target.shape[1]):
        if state.estimate[e, m, 15] >= 0.0:
            roll_out(f, model, state, e, m, path)
            find_entries(model, state, e, m, path, f.pose[e, m, 0])
        else:
            forget_entries(state, e, m)


@inner
def _decide_block(
    model: Model,
    state: State,
    f: Frozen,
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
                    update(f, model, state, e, m, time_of(model, state, e))
        after_frames(model, state, block)
    for e in block:
        if due(model, state, e, time_of(model, state, e)):
            _predict_entries(f, model, state, e, path)
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

    The places are addresses at which `MODELS`, `STATES` and `FROZEN` have pinned network, state and estimators.
    """
    model, state, f = network_at(model_place), state_at(state_place), frozen_at(place)
    noise = np.empty((state.cameras.shape[1], state.target.shape[1], 6))
    path = np.empty((model.steps, 4))
    together = state.lanes.shape[0]
    for first in range(0, len(chosen), together):
        block = chosen[first : first + together]
        _decide_block(model, state, f, block, fresh, actions, noise, path, observations, outcome)

"""What is counted while environments run: handoffs, view time, errors, control; and the reward.

The rules are those of `camnet.simulation.handoff`, `camnet.simulation.statistics` and ``camnet.env.rewards``, which
are the oracles. Columns of ``count``, ``track`` and ``clock`` are named in `camnet.batch.state`.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.network import Model
from camnet.batch.sense import contains
from camnet.batch.state import (
    ATTEMPTED,
    COMPLETED,
    DELAYED,
    DELAYS,
    EFFORT,
    ENTRIES,
    ERRORS,
    EXITS,
    FIRST_REGION,
    INSIDE,
    LAP,
    LAST_REGION,
    LOST_S,
    NEAREST,
    OPEN,
    PENDING,
    REGION,
    SEEN,
    SENSES,
    SLIP,
    TRACKING,
    WAS_SEEN,
    State,
)
from camnet.batch.touch import collided
from camnet.geometry.spacing import least_distance
from camnet.geometry.triples import multiply
from camnet.types import Array

__all__ = ["after_control", "after_sense", "note_slip", "reward_of"]

_STEADY_LAP = 3
#: states of a row of ``pending``
_FREE, _UNPAID, _PAID = 0.0, 1.0, 2.0


@inner
def _close(state: State, e: int, m: int) -> None:
    """End the handoff in progress: nothing more can happen to it."""
    k = int(state.track[e, m, OPEN])
    state.track[e, m, OPEN] = -1.0
    if state.pending[e, m, k, 2] == _PAID:
        state.pending[e, m, k, 2] = _FREE


@inner
def _open(state: State, e: int, m: int, t_s: float) -> None:
    """Begin a handoff."""
    if state.track[e, m, OPEN] >= 0:
        _close(state, e, m)
    oldest, k = math.inf, 0
    for i in range(PENDING):
        if state.pending[e, m, i, 2] == _FREE:
            k = i
            break
        if state.pending[e, m, i, 0] < oldest:
            oldest, k = state.pending[e, m, i, 0], i
    state.pending[e, m, k, 0], state.pending[e, m, k, 1], state.pending[e, m, k, 2] = t_s, math.nan, _UNPAID
    state.track[e, m, OPEN] = k
    state.count[e, ATTEMPTED] += 1.0


@inner
def _sighted(model: Model, state: State, e: int, m: int, t_s: float, region: int) -> None:
    track = state.track
    if track[e, m, OPEN] >= 0:
        k = int(track[e, m, OPEN])
        state.pending[e, m, k, 1] = t_s
        delay = t_s - state.pending[e, m, k, 0]
        done = int(state.count[e, DELAYED])
        if done < DELAYS:
            state.delays[e, done] = delay
        state.count[e, DELAYED] += 1.0
        if delay <= model.grace_s + 1e-9:
            state.count[e, COMPLETED] += 1.0
        _close(state, e, m)
    if region != track[e, m, LAST_REGION]:
        if track[e, m, FIRST_REGION] < 0:
            track[e, m, FIRST_REGION] = region
        elif region == track[e, m, FIRST_REGION]:
            track[e, m, LAP] += 1.0
    track[e, m, LAST_REGION] = region


@inner
def _follow(model: Model, state: State, e: int, m: int, t_s: float, camera: int) -> None:
    """`HandoffTracker.update`: the target is in ``region`` and seen by ``camera`` (-1: nobody)."""
    track, region = state.track, state.region[e, m]
    seen, was_seen = camera >= 0, track[e, m, WAS_SEEN] > 0
    if was_seen and not seen:
        track[e, m, LOST_S] = t_s
    last = track[e, m, LAST_REGION]
    moved = region != track[e, m, REGION]
    lost, entered = not was_seen and last >= 0 and last != region, region >= 0 and moved and t_s > 0.0
    state.count[e, ENTRIES] += 1.0 if entered else 0.0
    if entered and (lost or model.every_entry):
        _open(state, e, m, t_s)
        into = region
    else:
        into = int(track[e, m, REGION]) if track[e, m, OPEN] >= 0 else -1
    if moved and track[e, m, OPEN] >= 0 and region != into:
        _close(state, e, m)  # left again unseen: the attempt has failed
    if seen:
        _sighted(model, state, e, m, t_s, region if region >= 0 else camera)
    track[e, m, WAS_SEEN], track[e, m, REGION] = (1.0 if camera >= 0 else 0.0), region


@inner
def _errors(state: State, e: int, m: int, seen: bool) -> None:
    """Add the estimate's error to its group, once the target is known."""
    if not math.isfinite(state.estimate[e, m, 14]):
        return
    lap = state.track[e, m, LAP]
    if seen:
        group = 0
    elif lap >= _STEADY_LAP:
        group = 1
    elif lap == 1:
        group = 2
    else:
        return
    square = 0.0
    for i in range(3):
        square += (state.estimate[e, m, i] - state.target[e, m, i]) ** 2
    a, t = state.estimate, state.target
    off = multiply(
        (a[e, m, 3], -a[e, m, 4], -a[e, m, 5], -a[e, m, 6]),
        (t[e, m, 3], t[e, m, 4], t[e, m, 5], t[e, m, 6]),
    )
    sine = math.sqrt(off[1] * off[1] + off[2] * off[2] + off[3] * off[3])
    angle = 2.0 * math.atan2(sine, abs(off[0]))
    column = ERRORS + 3 * group
    state.count[e, column] += 1.0
    state.count[e, column + 1] += square
    state.count[e, column + 2] += angle * angle


@inner
def after_sense(model: Model, state: State, e: int, t_s: float) -> None:
    """Follow the targets through the network and record what the estimates missed; `RunStatistics.after_sense`."""
    bodies, count = state.bodies, state.count
    for n in range(bodies.shape[1]):
        outside = 0 if contains(model, n, (bodies[e, n, 0], bodies[e, n, 1], bodies[e, n, 2])) else 1
        if outside == 1 and state.outside[e, n] == 0:
            count[e, EXITS] += 1.0
        state.outside[e, n] = outside
    count[e, NEAREST] = min(count[e, NEAREST], least_distance(bodies[e, :, :3]))
    for m in range(state.target.shape[1]):
        camera = -1
        for c in range(state.cameras.shape[1]):
            if state.visible[e, c, m] == 1:
                camera = c
                break
        _follow(model, state, e, m, t_s, camera)
        count[e, SEEN] += 1.0 if camera >= 0 else 0.0
        count[e, SENSES] += 1.0
        _errors(state, e, m, camera >= 0)


@inner
def after_control(model: Model, state: State, e: int, effort: float, errors: float) -> None:
    """Add up squared speeds and squared errors of the references; `RunStatistics.after_control`."""
    state.count[e, EFFORT] += model.dt_s * effort
    state.count[e, TRACKING + 1] += errors


@inner
def note_slip(state: State, e: int, slip: float, slip_angular: float) -> None:
    """Keep the largest squared difference between motion and command: the disturbance of Assumption 4.3."""
    state.count[e, SLIP] = max(state.count[e, SLIP], slip)
    state.count[e, SLIP + 1] = max(state.count[e, SLIP + 1], slip_angular)


@inner
def _pay(model: Model, state: State, e: int, m: int, t_s: float) -> float:
    """Pay each handoff once: when it is completed, or when its grace time is over."""
    total = 0.0
    for k in range(PENDING):
        if state.pending[e, m, k, 2] != _UNPAID:
            continue
        entered, seen = state.pending[e, m, k, 0], state.pending[e, m, k, 1]
        is_open = int(state.track[e, m, OPEN]) == k
        if seen - entered <= model.grace_s + 1e-9:
            total += model.rewards[1] * (1.0 - max(seen - entered, 0.0) / model.grace_s)
            state.pending[e, m, k, 2] = _FREE
        elif t_s - entered > model.grace_s:
            total -= model.rewards[2]
            state.pending[e, m, k, 2] = _PAID if is_open else _FREE
    return total


@inner
def reward_of(model: Model, state: State, e: int, t_s: float, dt_s: float) -> float:
    """Shared reward of the decision of length ``dt_s`` that has just ended."""
    weights: Array = model.rewards
    agents, targets, b = state.bodies.shape[1], state.target.shape[1], state.bodies
    in_view = 0.0
    for m in range(targets):
        # a fixed camera sees beyond its region
        could = state.region[e, m] >= 0 or state.cameras.shape[1] > agents
        state.count[e, INSIDE] += 1.0 if could else 0.0
        for c in range(state.cameras.shape[1]):
            if state.visible[e, c, m] == 1:
                in_view += 1.0
                break
    effort, outside = 0.0, 0.0
    for n in range(agents):
        speed = math.sqrt(b[e, n, 7] ** 2 + b[e, n, 8] ** 2 + b[e, n, 9] ** 2) / model.v_max
        effort += min(speed, 3.0) ** 2
        outside += 0.0 if contains(model, n, (b[e, n, 0], b[e, n, 1], b[e, n, 2])) else 1.0
    reward = weights[0] * dt_s * in_view / targets
    reward -= weights[3] * dt_s * effort / max(agents, 1)
    reward -= weights[4] * dt_s * outside
    reward -= weights[5] * (1.0 if collided(state, e) else 0.0)
    for m in range(targets):
        reward += _pay(model, state, e, m, t_s)
    return reward

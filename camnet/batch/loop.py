"""A few environments through one decision: setpoints, flight, sensing, books; the estimators' drivers are built of it.

For each environment the order of things is that of `camnet.simulation.loop.NetworkSimulation`:

    open_decision -> [ fly_and_sense -> (at sensing instants) estimator -> after_frames ] ... -> entries -> finish

A block of `BLOCK` environments goes through each of these together, so that the code, which is larger than a
processor's first cache, is fetched once for all of them. Every estimator has a driver of its own
(`camnet.batch.frozen.decide`, ...), so that only its code is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.batch.book import after_control, after_sense, note_slip, reward_of
from camnet.batch.compiled import inner
from camnet.batch.flight import fly_agents, load, show_agents, store, sums
from camnet.batch.gimbal import camera_of
from camnet.batch.lane_layout import LANES
from camnet.batch.lane_touches import may_touch, note_places
from camnet.batch.motion import step_target
from camnet.batch.network import CYLINDER, Model
from camnet.batch.observe import observe
from camnet.batch.own_pose import step_own
from camnet.batch.sense import sense
from camnet.batch.state import COUNT, CYCLE, RETURN, State
from camnet.batch.target_lanes import in_lanes, step_loops
from camnet.batch.touch import collided, note_touches
from camnet.geometry.triples import Triple
from camnet.types import Array, IntArray

__all__ = ["after_frames", "finish", "fly_and_sense", "frame_taken", "open_decision", "time_of"]

#: columns of the outcome (E, 5) of a decision: reward, terminated, diverged, time, decisions so far
REWARD, TERMINATED, DIVERGED, TIME, DECISIONS = range(5)


@inner
def _place_cameras(model: Model, state: State, e: int) -> None:
    """Put the agents' cameras where their bodies and gimbals are."""
    for n in range(state.bodies.shape[1]):
        camera_of(state.bodies, state.memory, e, n, model.offset, state.cameras)


@inner
def _start_references(state: State, e: int) -> None:
    """Put the references at rest at the cameras."""
    for n in range(state.bodies.shape[1]):
        for i in range(13):
            state.motion[e, n, i] = state.cameras[e, n, i] if i < 3 else 0.0


@inner
def _goal(model: Model, n: int, p: Triple) -> Triple:
    """Nearest point at least the margin inside region ``n``."""
    margin, low, high = model.margin, model.flight[n, 0], model.flight[n, 1]
    x, y = p[0], p[1]
    z = min(max(p[2], low[2] + margin), high[2] - margin)
    if model.kind[n] == CYLINDER:
        dx, dy, radius = x - model.discs[n, 0], y - model.discs[n, 1], model.discs[n, 2] - margin
        d = math.sqrt(dx * dx + dy * dy)
        if d > radius:
            x, y = model.discs[n, 0] + radius * dx / d, model.discs[n, 1] + radius * dy / d
        return x, y, z
    x = min(max(x, low[0] + margin), high[0] - margin)
    return x, min(max(y, low[1] + margin), high[1] - margin), z


@inner
def _ask(model: Model, state: State, e: int, n: int, p: Triple, pan: float, tilt: float) -> None:
    """Make a position in the world and a gaze the setpoint of agent ``n``, as far as they are admissible."""
    goal = _goal(model, n, p)
    for i in range(3):
        state.setpoint[e, n, i] = goal[i]
    state.setpoint[e, n, 3] = min(max(pan, -model.gaze_max), model.gaze_max)
    state.setpoint[e, n, 4] = min(max(tilt, -model.gaze_max), model.gaze_max)


@inner
def _begin(model: Model, state: State, e: int, actions: Array) -> None:
    """Take actions (E, N, 5) as setpoints: in [-1, 1] as ``HandoffEnv.setpoints``, or in the world (``in_world``)."""
    for n in range(state.bodies.shape[1]):
        if model.in_world:
            p = (actions[e, n, 0], actions[e, n, 1], actions[e, n, 2])
            _ask(model, state, e, n, p, actions[e, n, 3], actions[e, n, 4])
            continue
        a = (
            min(max(actions[e, n, 0], -1.0), 1.0) * max(model.halves[n, 0] - model.margin, 0.0),
            min(max(actions[e, n, 1], -1.0), 1.0) * max(model.halves[n, 1] - model.margin, 0.0),
            min(max(actions[e, n, 2], -1.0), 1.0) * max(model.halves[n, 2] - model.margin, 0.0),
        )
        c = model.centers
        pan = min(max(actions[e, n, 3], -1.0), 1.0) * model.gaze_scale
        tilt = min(max(actions[e, n, 4], -1.0), 1.0) * model.gaze_scale
        _ask(model, state, e, n, (c[n, 0] + a[0], c[n, 1] + a[1], c[n, 2] + a[2]), pan, tilt)


@inner
def _step_targets(model: Model, state: State, block: IntArray) -> None:
    """Advance the targets by one control period."""
    targets, t, dt = state.target.shape[1], model.targets, model.dt_s
    for m in range(targets):
        if in_lanes(t, m):
            for first in range(0, block.shape[0], LANES):
                step_loops(t, m, state.target, state.inner, block, first, dt, state.chase)
        else:
            for e in block:
                t_s, row = time_of(model, state, e), e * (2 + targets) + 2 + m
                plan = state.plans[e, m]
                step_target(t, m, state.target, state.inner, e, t_s, dt, state.streams, row, plan)


@inner
def _fly_once(model: Model, state: State, block: IntArray) -> None:
    """Advance the environments by one control period."""
    _step_targets(model, state, block)
    if state.bodies.shape[1] > 0:
        fly_agents(model, state, block)
        if model.own_numbers.shape[0] > 0:
            for k in range(block.shape[0]):
                step_own(model, state, k, block[k], (state.clock[block[k], COUNT] + 1.0) * model.dt_s)
        note_places(state.lanes, block.shape[0])
    for k in range(block.shape[0]):
        _end_period(model, state, k, block[k])


@inner
def _end_period(model: Model, state: State, k: int, e: int) -> None:
    """Keep the books of a control period of the block's ``k``-th environment; show its agents if looked at."""
    state.clock[e, COUNT] += 1.0
    near = may_touch(model, state, k, e) if state.bodies.shape[1] > 0 else False
    decided = int(state.clock[e, COUNT]) % model.decide_every == 0
    if near or decided or frame_taken(model, state, e):
        show_agents(state, k, e)
    if near:
        note_touches(model, state, e)
    effort, errors, slip, slip_angular = sums(state, k)
    after_control(model, state, e, effort, errors)
    note_slip(state, e, slip, slip_angular)


@inner
def time_of(model: Model, state: State, e: int) -> float:
    """Time of environment ``e``, s."""
    return state.clock[e, COUNT] * model.dt_s


@inner
def frame_taken(model: Model, state: State, e: int) -> bool:
    """Whether sensors take a frame at the present control period."""
    return int(state.clock[e, COUNT]) % model.sense_every == 0


@inner
def open_decision(model: Model, state: State, block: IntArray, fresh: bool, actions: Array) -> int:
    """Take the actions (E, N, 5) of the environments of a block, or put ``fresh`` ones in place.

    Returns
    -------
    int
        How often `fly_and_sense` is to be called.
    """
    if fresh:
        for e in block:
            _place_cameras(model, state, e)
            _start_references(state, e)
        return 1
    for k in range(block.shape[0]):
        _begin(model, state, block[k], actions)
        load(state, state.lanes[k], block[k])
    return model.decide_every


@inner
def fly_and_sense(model: Model, state: State, block: IntArray, fresh: bool, noise: Array) -> None:
    """Advance by one control period, ``fresh`` environments by none, and take the frames that are due."""
    if not fresh:
        _fly_once(model, state, block)
    for e in block:
        if frame_taken(model, state, e):
            sense(model, state, e, noise)


@inner
def after_frames(model: Model, state: State, block: IntArray) -> None:
    """Keep the books of the frames taken, once estimators have them."""
    for e in block:
        if frame_taken(model, state, e):
            after_sense(model, state, e, time_of(model, state, e))


@inner
def _diverged(model: Model, state: State, e: int) -> bool:
    b = state.bodies
    for n in range(b.shape[1]):
        for i in range(13):
            if not math.isfinite(b[e, n, i]):
                return True
        for i in range(3):
            away = abs(b[e, n, i] - model.start_p[n, i])
            if away >= model.guard[0] or abs(b[e, n, 7 + i]) >= model.guard[1]:
                return True
    return False


@inner
def _ended(model: Model, state: State, e: int, t_s: float) -> bool:
    """Whether a collision, or a target lost for too long, ends the episode."""
    if model.ends[0] > 0.0 and collided(state, e):
        return True
    for m in range(state.target.shape[1]):
        if state.estimate[e, m, 15] >= 0.0 and t_s - state.estimate[e, m, 14] > model.ends[1]:
            return True
    return False


@inner
def _settle(model: Model, state: State, e: int, t_s: float, outcome: Array) -> None:
    """Reward a decision, and look whether it was the last."""
    state.clock[e, CYCLE] += 1.0
    reward = reward_of(model, state, e, t_s, model.dt_s * model.decide_every)
    state.clock[e, RETURN] += reward
    outcome[e, REWARD] = reward
    outcome[e, TERMINATED] = 1.0 if _ended(model, state, e, t_s) else 0.0
    outcome[e, DIVERGED] = 1.0 if _diverged(model, state, e) else 0.0


@inner
def finish(
    model: Model,
    state: State,
    block: IntArray,
    fresh: bool,
    observations: NDArray[np.float32],
    outcome: Array,
) -> None:
    """Reward the decision and show the agents what they may know; ``fresh`` environments have no reward yet."""
    for k in range(block.shape[0]):
        e = block[k]
        if not fresh:
            store(state, state.lanes[k], e)
            _settle(model, state, e, time_of(model, state, e), outcome)
        outcome[e, TIME], outcome[e, DECISIONS] = time_of(model, state, e), state.clock[e, CYCLE]
    for e in block:
        observe(model, state, e, outcome[e, TIME], observations)

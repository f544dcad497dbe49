"""One environment through one decision: setpoints, flight, sensing, books; the estimators' drivers are built of it.

The order of things is that of `camnet.simulation.loop.NetworkSimulation`, one environment after the other:

    open_decision -> [ fly_and_sense -> (at sensing instants) estimator -> after_sense ] ... -> entries -> finish

Every estimator has a driver of its own (`camnet.batch.frozen.decide`, ...), so that only its code is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.batch.body import camera_of, fly
from camnet.batch.book import after_control, collided, reward_of
from camnet.batch.compiled import inner
from camnet.batch.lane_layout import (
    ALLOWED,
    ERROR,
    HEADING,
    LANES,
    LOOK,
    MOTION,
    SETPOINT,
    WIND,
    A,
    U,
    get,
    get_pair,
    load_flight,
    load_plan,
    put,
    show,
    store_flight,
    store_plan,
)
from camnet.batch.lane_references import ask_lanes, follow_lanes
from camnet.batch.lanes import fly_lanes, note_joints
from camnet.batch.motion import step_target
from camnet.batch.network import CYLINDER, Model
from camnet.batch.observe import observe
from camnet.batch.random import normal
from camnet.batch.reference import position_step
from camnet.batch.sense import sense
from camnet.batch.state import COUNT, CYCLE, RETURN, State
from camnet.geometry.triples import Triple
from camnet.types import Array

__all__ = ["finish", "fly_and_sense", "open_decision"]

#: columns of the outcome (E, 4) of a decision: reward, terminated, diverged, time
REWARD, TERMINATED, DIVERGED, TIME = 0, 1, 2, 3


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
    margin, low, high = model.margin, model.boxes[n, 0], model.boxes[n, 1]
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
    _load(state, e)


@inner
def _air(model: Model, state: State, e: int) -> None:
    """Draw the next gusts: first-order Gauss-Markov, as in the flight of the PyBullet back end."""
    if model.gust_std == 0.0:
        return
    row = e * (2 + state.target.shape[1]) + 1
    kick = math.sqrt(1.0 - model.gust_keep * model.gust_keep) * model.gust_std
    for n in range(state.gust.shape[1]):
        for i in range(3):
            state.gust[e, n, i] = model.gust_keep * state.gust[e, n, i] + kick * normal(state.streams, row)


@inner
def _load(state: State, e: int) -> None:
    """Put the agents into the workspaces."""
    agents = state.bodies.shape[1]
    for k in range(state.lanes.shape[0] * LANES):
        x, lane, n = state.lanes[k // LANES], k % LANES, min(k, agents - 1)
        load_flight(x, lane, state.bodies, state.memory, state.cameras, e, n)
        load_plan(x, lane, state.motion, state.setpoint, e, n)
    for b in range(state.lanes.shape[0]):
        note_joints(state.lanes[b])


@inner
def _store(state: State, e: int) -> None:
    """Take them back."""
    for n in range(state.bodies.shape[1]):
        x, lane = state.lanes[n // LANES], n % LANES
        store_flight(x, lane, state.bodies, state.memory, e, n)
        store_plan(x, lane, state.motion, e, n)


@inner
def _blow(model: Model, state: State, e: int, b: int) -> None:
    """Let the gusts blow on the agents of workspace ``b``."""
    last = state.bodies.shape[1] - 1
    for i in range(LANES):
        g, n = state.gust, min(LANES * b + i, last)
        gust = (g[e, n, 0], g[e, n, 1], g[e, n, 2])
        put(
            state.lanes[b],
            WIND,
            i,
            (model.wind[0] + gust[0], model.wind[1] + gust[1], model.wind[2] + gust[2]),
        )


@inner
def _fly_one_by_one(model: Model, state: State, e: int, b: int) -> None:
    """Fly the agents of a workspace one by one."""
    x, agents = state.lanes[b], state.bodies.shape[1]
    for i in range(LANES):
        n = LANES * b + i
        if n < agents:
            store_flight(x, i, state.bodies, state.memory, e, n)
            u, a, w, wind = get(x, U, i), get(x, A, i), get(x, LOOK, i), get(x, WIND, i)
            heading, c = get_pair(x, HEADING, i), model.constants
            fly(state.bodies, state.memory, e, n, u, a, w, heading, wind, c, model.periods)
            camera_of(state.bodies, state.memory, e, n, model.offset, state.cameras)
        load_flight(x, i, state.bodies, state.memory, state.cameras, e, min(n, agents - 1))
    note_joints(x)


@inner
def _brake(model: Model, state: State, e: int, b: int) -> None:
    """Move those references on that have to brake."""
    x, agents = state.lanes[b], state.bodies.shape[1]
    for i in range(LANES):
        if x[ALLOWED * LANES + i] == 0.0:
            p, v, a = position_step(
                get(x, MOTION, i),
                get(x, MOTION + 3, i),
                get(x, MOTION + 6, i),
                get(x, SETPOINT, i),
                min(LANES * b + i, agents - 1),
                model.margin,
                model.planes,
                model.plane_ends,
                model.discs,
                model.limits,
                model.dt_s,
            )
            put(x, MOTION, i, p)
            put(x, MOTION + 3, i, v)
            put(x, MOTION + 6, i, a)


@inner
def _fly(model: Model, state: State, e: int) -> float:
    """Fly all agents for a control period; sum of the squared errors of their references at the beginning, m^2."""
    agents, errors = state.bodies.shape[1], 0.0
    for b in range(state.lanes.shape[0]):
        x = state.lanes[b]
        if model.gust_std > 0.0:
            _blow(model, state, e, b)
        ask_lanes(x, model.gains, model.switching)
        if not fly_lanes(x, model.periods, model.constants, model.offset):
            _fly_one_by_one(model, state, e, b)
        if not follow_lanes(x, model.margin, model.limits, model.gaze_limits, model.dt_s):
            _brake(model, state, e, b)
        for i in range(min(LANES, agents - LANES * b)):
            show(x, i, state.bodies, state.cameras, e, LANES * b + i)
            errors += x[ERROR * LANES + i]
    return errors


@inner
def _fly_once(model: Model, state: State, e: int) -> float:
    """Advance environment ``e`` by one control period; the time after it, s."""
    targets = state.target.shape[1]
    t_s, row = state.clock[e, COUNT] * model.dt_s, e * (2 + targets) + 2
    for m in range(targets):
        step_target(model.targets, m, state.target, state.inner, e, t_s, model.dt_s, state.streams, row + m)
    _air(model, state, e)
    errors = _fly(model, state, e)
    state.clock[e, COUNT] += 1.0
    after_control(model, state, e, errors)
    return state.clock[e, COUNT] * model.dt_s


@inner
def _sensing_due(model: Model, state: State, e: int) -> bool:
    """Whether sensors take a frame at the present control period."""
    return int(state.clock[e, COUNT]) % model.sense_every == 0


@inner
def open_decision(model: Model, state: State, e: int, fresh: bool, actions: Array) -> int:
    """Take the actions (E, N, 5) of environment ``e``, or put a ``fresh`` one in place.

    Returns
    -------
    int
        How often `fly_and_sense` is to be called.
    """
    if fresh:
        _place_cameras(model, state, e)
        _start_references(state, e)
        return 1
    _begin(model, state, e, actions)
    return model.decide_every


@inner
def fly_and_sense(model: Model, state: State, e: int, fresh: bool, noise: Array) -> tuple[float, bool]:
    """Advance by one control period, a ``fresh`` environment by none; the time then, and whether there is a frame."""
    t_s = 0.0 if fresh else _fly_once(model, state, e)
    due = _sensing_due(model, state, e)
    if due:
        sense(model, state, e, noise)
    return t_s, due


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
def finish(
    model: Model, state: State, e: int, fresh: bool, observations: NDArray[np.float32], outcome: Array
) -> None:
    """Reward the decision and show the agents what they may know; a ``fresh`` environment has no reward yet."""
    t_s = state.clock[e, COUNT] * model.dt_s
    if not fresh:
        _store(state, e)
        state.clock[e, CYCLE] += 1.0
        reward = reward_of(model, state, e, t_s, model.dt_s * model.decide_every)
        state.clock[e, RETURN] += reward
        outcome[e, REWARD] = reward
        outcome[e, TERMINATED] = 1.0 if _ended(model, state, e, t_s) else 0.0
        outcome[e, DIVERGED] = 1.0 if _diverged(model, state, e) else 0.0
    outcome[e, TIME] = t_s
    observe(model, state, e, t_s, observations)

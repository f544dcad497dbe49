"""One environment through one decision: setpoints, flight, sensing, books; the estimators' drivers are built of it.

The order of things is that of `camnet.simulation.loop.NetworkSimulation`, one environment after the other:

    begin -> [ fly -> (at sensing instants) sense -> estimator -> after_sense ] ... -> entries -> finish

Every estimator has a driver of its own (`camnet.batch.frozen.decide`, ...), so that only its code is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.batch.body import camera_of, fly
from camnet.batch.book import after_control, collided, reward_of
from camnet.batch.compiled import inner
from camnet.batch.motion import step_target
from camnet.batch.network import CYLINDER, Model
from camnet.batch.observe import observe
from camnet.batch.random import normal
from camnet.batch.reference import command_of, gaze_motion, gaze_step, position_step
from camnet.batch.state import COUNT, CYCLE, RETURN, State
from camnet.batch.triples import Quaternion, Triple
from camnet.types import Array

__all__ = ["begin", "finish", "fly_once", "place_cameras", "sensing_due"]

#: columns of the outcome (E, 4) of a decision: reward, terminated, diverged, time
REWARD, TERMINATED, DIVERGED, TIME = 0, 1, 2, 3


@inner
def place_cameras(model: Model, state: State, e: int) -> None:
    """Put the agents' cameras where their bodies and gimbals are."""
    for n in range(state.bodies.shape[1]):
        camera_of(state.bodies, state.memory, e, n, model.offset, state.cameras)


@inner
def start_references(state: State, e: int) -> None:
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
def begin(model: Model, state: State, e: int, actions: Array) -> None:
    """Take actions (E, N, 5) as setpoints: in [-1, 1] as ``HandoffEnv.setpoints``, or in the world; see ``in_world``."""
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
def _advance_reference(model: Model, state: State, e: int, n: int) -> None:
    r, s = state.motion, state.setpoint
    p, v, a = position_step(
        (r[e, n, 0], r[e, n, 1], r[e, n, 2]),
        (r[e, n, 3], r[e, n, 4], r[e, n, 5]),
        (r[e, n, 6], r[e, n, 7], r[e, n, 8]),
        (s[e, n, 0], s[e, n, 1], s[e, n, 2]),
        n,
        model.margin,
        model.planes,
        model.plane_ends,
        model.discs,
        model.limits,
        model.dt_s,
    )
    g = model.gaze_limits
    look = gaze_step(
        (r[e, n, 9], r[e, n, 10]),
        (r[e, n, 11], r[e, n, 12]),
        (s[e, n, 3], s[e, n, 4]),
        g[0],
        g[1],
        g[2],
        model.dt_s,
    )
    for i in range(3):
        r[e, n, i], r[e, n, 3 + i], r[e, n, 6 + i] = p[i], v[i], a[i]
    for i in range(4):
        r[e, n, 9 + i] = look[i]


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
def _fly_agent(model: Model, state: State, e: int, n: int) -> float:
    """Fly one agent for a control period; squared error of its reference at the beginning, m^2."""
    r, cam = state.motion, state.cameras
    yaw = (model.yaw[n, 0], model.yaw[n, 1])
    q_d, w_d = gaze_motion(
        r[e, n, 9], r[e, n, 10], r[e, n, 11], r[e, n, 12], yaw, (model.half_yaw[n, 0], model.half_yaw[n, 1])
    )
    q: Quaternion = (cam[e, n, 3], cam[e, n, 4], cam[e, n, 5], cam[e, n, 6])
    u, w, e_l = command_of(
        (cam[e, n, 0], cam[e, n, 1], cam[e, n, 2]),
        q,
        (r[e, n, 0], r[e, n, 1], r[e, n, 2]),
        q_d,
        (r[e, n, 3], r[e, n, 4], r[e, n, 5]),
        w_d,
        model.gains,
        model.switching,
    )
    wind = (
        model.wind[0] + state.gust[e, n, 0],
        model.wind[1] + state.gust[e, n, 1],
        model.wind[2] + state.gust[e, n, 2],
    )
    a = (r[e, n, 6], r[e, n, 7], r[e, n, 8])
    fly(state.bodies, state.memory, e, n, u, a, w, yaw, wind, model.constants, model.periods)
    camera_of(state.bodies, state.memory, e, n, model.offset, state.cameras)
    return e_l[0] * e_l[0] + e_l[1] * e_l[1] + e_l[2] * e_l[2]


@inner
def fly_once(model: Model, state: State, e: int) -> float:
    """Advance environment ``e`` by one control period; the time after it, s."""
    targets = state.target.shape[1]
    t_s, row = state.clock[e, COUNT] * model.dt_s, e * (2 + targets) + 2
    for m in range(targets):
        step_target(model.targets, m, state.target, state.inner, e, t_s, model.dt_s, state.streams, row + m)
    _air(model, state, e)
    errors = 0.0
    for n in range(state.bodies.shape[1]):
        errors += _fly_agent(model, state, e, n)
        _advance_reference(model, state, e, n)
    state.clock[e, COUNT] += 1.0
    after_control(model, state, e, errors)
    return state.clock[e, COUNT] * model.dt_s


@inner
def sensing_due(model: Model, state: State, e: int) -> bool:
    """Whether sensors take a frame at the present control period."""
    return int(state.clock[e, COUNT]) % model.sense_every == 0


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
        state.clock[e, CYCLE] += 1.0
        reward = reward_of(model, state, e, t_s, model.dt_s * model.decide_every)
        state.clock[e, RETURN] += reward
        outcome[e, REWARD] = reward
        outcome[e, TERMINATED] = 1.0 if _ended(model, state, e, t_s) else 0.0
        outcome[e, DIVERGED] = 1.0 if _diverged(model, state, e) else 0.0
    outcome[e, TIME] = t_s
    observe(model, state, e, t_s, observations)

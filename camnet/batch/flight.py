"""Flight of a block of environments for a control period, stage by stage, in the lanes of their workspaces."""

from __future__ import annotations

import math

from camnet.batch.body import fly
from camnet.batch.compiled import inlined, inner
from camnet.batch.gimbal import camera_of
from camnet.batch.lane_layout import (
    ALLOWED,
    CAMERA,
    ERROR,
    HEADING,
    LANES,
    LOOK,
    MOTION,
    NEAR,
    SETPOINT,
    WILD,
    WIND,
    A,
    U,
    V,
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
from camnet.batch.lanes import carry_cameras, fly_lanes, note_joints
from camnet.batch.network import Model
from camnet.batch.own_pose import believe, turn_back
from camnet.batch.random import normal
from camnet.batch.reference import position_step
from camnet.batch.state import State
from camnet.batch.touch import collided
from camnet.geometry.triples import Triple
from camnet.types import Array, IntArray

__all__ = ["fly_agents", "load", "show_agents", "store", "sums"]


@inner
def _air(model: Model, state: State, e: int) -> None:
    """Draw the next gusts: first-order Gauss-Markov, as in the flight of the PyBullet back end."""
    row = e * (2 + state.target.shape[1]) + 1
    kick = math.sqrt(1.0 - model.gust_keep * model.gust_keep) * model.gust_std
    for n in range(state.gust.shape[1]):
        for i in range(3):
            state.gust[e, n, i] = model.gust_keep * state.gust[e, n, i] + kick * normal(state.streams, row)


@inner
def load(state: State, lanes: Array, e: int) -> None:
    """Put the agents into the workspaces ``lanes`` (B, 4 ROWS) of one environment."""
    agents = state.bodies.shape[1]
    if agents == 0:
        return
    for k in range(lanes.shape[0] * LANES):
        x, lane, n = lanes[k // LANES], k % LANES, min(k, agents - 1)
        load_flight(x, lane, state.bodies, state.memory, state.cameras, e, n)
        load_plan(x, lane, state.motion, state.setpoint, e, n)
        put(x, WIND, lane, (state.wind[e, 0], state.wind[e, 1], state.wind[e, 2]))
    for b in range(lanes.shape[0]):
        note_joints(lanes[b])
    lanes[0, NEAR * LANES] = 1.0 if collided(state, e) else 0.0


@inner
def store(state: State, lanes: Array, e: int) -> None:
    """Take them back."""
    for n in range(state.bodies.shape[1]):
        x, lane = lanes[n // LANES], n % LANES
        store_flight(x, lane, state.bodies, state.memory, e, n)
        store_plan(x, lane, state.motion, e, n)


@inner
def _blow(state: State, e: int, b: int, x: Array) -> None:
    """Let the gusts blow on the agents of the workspace ``x``, the ``b``-th of environment ``e``."""
    last = state.bodies.shape[1] - 1
    for i in range(LANES):
        g, n = state.gust, min(LANES * b + i, last)
        gust = (g[e, n, 0], g[e, n, 1], g[e, n, 2])
        mean = state.wind
        put(x, WIND, i, (mean[e, 0] + gust[0], mean[e, 1] + gust[1], mean[e, 2] + gust[2]))


@inner
def _fly_one_by_one(model: Model, state: State, e: int, b: int, x: Array) -> None:
    """Fly the agents of a workspace one by one."""
    agents = state.bodies.shape[1]
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
def _brake(model: Model, agents: int, b: int, x: Array) -> None:
    """Move those references on that have to brake."""
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
def _blow_all(model: Model, state: State, block: IntArray) -> None:
    """Let the air blow."""
    for k in range(block.shape[0]):
        _air(model, state, block[k])
        for b in range(state.lanes.shape[1]):
            _blow(state, block[k], b, state.lanes[k, b])


@inner
def _fly_wild(model: Model, state: State, block: IntArray) -> None:
    """Fly those agents that their workspaces cannot."""
    for k in range(block.shape[0]):
        for b in range(state.lanes.shape[1]):
            if state.lanes[k, b, WILD * LANES] > 0.0:
                _fly_one_by_one(model, state, block[k], b, state.lanes[k, b])


@inner
def _brake_all(model: Model, state: State, block: IntArray) -> None:
    """Move those references on that have to brake."""
    for k in range(block.shape[0]):
        for b in range(state.lanes.shape[1]):
            _brake(model, state.bodies.shape[1], b, state.lanes[k, b])


@inner
def fly_agents(model: Model, state: State, block: IntArray) -> None:
    """Command the agents, fly them, and move their references on."""
    lanes, count = state.lanes, block.shape[0]
    if model.gust_std > 0.0:
        _blow_all(model, state, block)
    lost = model.own_numbers.shape[0] > 0
    if lost:
        for k in range(count):
            believe(model, state, k, block[k])
    ask_lanes(lanes, count, model.gains, model.switching)
    if lost:
        for k in range(count):
            turn_back(model, state, k, block[k])
    wild = fly_lanes(lanes, count, model.periods, model.constants)
    carry_cameras(lanes, count, model.offset)
    if wild > 0:
        _fly_wild(model, state, block)
    if follow_lanes(lanes, count, model.margin, model.limits, model.gaze_limits, model.dt_s) > 0:
        _brake_all(model, state, block)


@inner
def show_agents(state: State, k: int, e: int) -> None:
    """Show where the agents of the block's ``k``-th environment ``e`` are."""
    agents = state.bodies.shape[1]
    for b in range(state.lanes.shape[1]):
        first = LANES * b
        show(state.lanes[k, b], min(LANES, agents - first), state.bodies, state.cameras, e, first)


@inlined
def _square_apart(a: Triple, b: Triple) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@inner
def sums(state: State, k: int) -> tuple[float, float, float, float]:
    """Sum over the agents of the block's ``k``-th environment.

    Returns
    -------
    effort : of the squared speeds now, m^2/s^2
    errors : of the squared errors of the references when the period began, m^2
    slip, slip_angular : largest square of a camera's velocity less the commanded one at the end of the period, m^2/s^2,
        rad^2/s^2
    """
    agents, effort, errors, slip, slip_angular = state.bodies.shape[1], 0.0, 0.0, 0.0, 0.0
    for b in range(state.lanes.shape[1]):
        x = state.lanes[k, b]
        for i in range(min(LANES, agents - LANES * b)):
            v = get(x, V, i)
            effort += v[0] ** 2 + v[1] ** 2 + v[2] ** 2
            errors += x[ERROR * LANES + i]
            slip = max(slip, _square_apart(get(x, CAMERA + 7, i), get(x, U, i)))
            slip_angular = max(slip_angular, _square_apart(get(x, CAMERA + 10, i), get(x, LOOK, i)))
    return effort, errors, slip, slip_angular

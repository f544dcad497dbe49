"""Own poses of agents in many environments: what `camnet.simulation.own_pose` does for one, with the same kernels.

| array | shape | what |
| --- | --- | --- |
| ``own_x``, ``own_cov`` | (E, A, 9), (E, A, 9, 9) | as in `camnet.estimation.own_pose.dead_reckoning` |
| ``own_errors`` | (E, A, 2) | scale and gyro bias of the run |
| ``own_truth`` | (E, A, 4) | true x, y, heading; heading at the last image |
| ``own_turn`` | (E, A) | error of the believed heading, rad |
| ``own_m`` | (E, M) | what the last measurement's camera adds to a target's error radius, m |
| ``own_streams`` | (E, 4) | the generator of all of it |

A is the number of agents that may lose their pose. Where there are none nothing is asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from camnet.batch.compiled import inlined, inner, inner_owner
from camnet.batch.lane_layout import CAMERA, LANES, A, U, get, get_four, orientation, put, put_four
from camnet.batch.random import normals, stream_of
from camnet.estimation.own_pose.considered import SIGMAS
from camnet.estimation.own_pose.dead_reckoning import (
    draw_errors,
    own_model,
    start_own,
)
from camnet.estimation.own_pose.sources import DRAWS, step_source
from camnet.geometry.triples import Quaternion, Triple, multiply
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array

if TYPE_CHECKING:
    from camnet.batch.network import Model
    from camnet.batch.state import State

__all__ = ["as_believed", "believe", "radius_of", "start_poses", "step_own", "turn_back"]


def start_poses(
    sources: Sequence[PoseSource], poses: Array, dt_s: float, state: State, e: int, rng: np.random.Generator
) -> None:
    """Draw environment ``e``'s errors and first fixes, in the order of `OwnPoses`; ``poses`` (A,3) are true."""
    errors = [draw_errors(source, rng) for source in sources]
    draws = rng.standard_normal((len(sources), 3))
    for a, source in enumerate(sources):
        state.own_errors[e, a] = errors[a]
        start_own(state.own_x[e, a], state.own_cov[e, a], own_model(source, dt_s), poses[a], draws[a])
        state.own_truth[e, a] = [*poses[a], poses[a, 2]]
        state.own_turn[e, a] = math.remainder(state.own_x[e, a, 2] - poses[a, 2], 2.0 * math.pi)
    state.own_m[e] = 0.0
    state.own_streams[e] = stream_of(rng)


@inlined
def _about_up(turn: float, v: Triple) -> Triple:
    c, s = math.cos(turn), math.sin(turn)
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


@inlined
def _turned(turn: float, q: Quaternion) -> Quaternion:
    return multiply((math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)), q)


@inner
def believe(model: Model, state: State, k: int, e: int) -> None:
    """Put the cameras of the block's ``k``-th environment where their agents believe them to be."""
    for n in range(state.bodies.shape[1]):
        a = model.own_index[n]
        if a >= 0:
            x, i = state.lanes[k, n // LANES], n % LANES
            p = get(x, CAMERA, i)
            put(x, CAMERA, i, (state.own_x[e, a, 0], state.own_x[e, a, 1], p[2]))
            put_four(x, CAMERA + 3, i, _turned(state.own_turn[e, a], get_four(x, CAMERA + 3, i)))


@inner
def turn_back(model: Model, state: State, k: int, e: int) -> None:
    """Turn commanded velocities and accelerations from the agents' worlds into the true one."""
    for n in range(state.bodies.shape[1]):
        a = model.own_index[n]
        if a >= 0:
            x, i = state.lanes[k, n // LANES], n % LANES
            put(x, U, i, _about_up(-state.own_turn[e, a], get(x, U, i)))
            put(x, A, i, _about_up(-state.own_turn[e, a], get(x, A, i)))


@inner_owner
def step_own(model: Model, state: State, k: int, e: int, t_s: float) -> None:
    """Take a control period that ends at ``t_s``; the lanes hold the truth."""
    agents = model.own_numbers.shape[0]
    draws = np.empty((1, agents, DRAWS))
    normals(state.own_streams, e, draws)
    for n in range(state.bodies.shape[1]):
        a = model.own_index[n]
        if a >= 0:
            x, i = state.lanes[k, n // LANES], n % LANES
            p, q = get(x, CAMERA, i), orientation(x, i)
            heading = math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
            state.own_turn[e, a], _ = step_source(
                state.own_x[e, a],
                state.own_cov[e, a],
                state.own_truth[e, a],
                state.own_errors[e, a],
                model.own_numbers[a],
                model.own_outages,
                a,
                np.array([p[0], p[1], heading]),
                draws[0, a],
                False,
                t_s,
                model.dt_s,
            )


@inner
def as_believed(
    model: Model, state: State, e: int, c: int, p: Triple, q: Quaternion
) -> tuple[Triple, Triple, Quaternion]:
    """Return the camera's place, the way (3,) to a target and the target's orientation, as the agent believes."""
    a, base = model.own_index[c], (state.cameras[e, c, 0], state.cameras[e, c, 1], state.cameras[e, c, 2])
    if a < 0:
        return base, p, q
    turn = state.own_turn[e, a]
    return (state.own_x[e, a, 0], state.own_x[e, a, 1], base[2]), _about_up(turn, p), _turned(turn, q)


@inner
def radius_of(model: Model, state: State, e: int, c: int, way: Triple) -> float:
    """Return what the own pose of camera ``c`` adds to the error radius of a target ``way`` (3,) off, m."""
    a = model.own_index[c]
    if a < 0:
        return 0.0
    v, x, y = state.own_cov, -way[1], way[0]
    xx = v[e, a, 0, 0] + 2.0 * x * v[e, a, 0, 2] + x * x * v[e, a, 2, 2]
    yy = v[e, a, 1, 1] + 2.0 * y * v[e, a, 1, 2] + y * y * v[e, a, 2, 2]
    xy = v[e, a, 0, 1] + y * v[e, a, 0, 2] + x * v[e, a, 1, 2] + x * y * v[e, a, 2, 2]
    largest = 0.5 * (xx + yy) + math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    return SIGMAS * math.sqrt(max(largest, 0.0))

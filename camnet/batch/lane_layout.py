"""Workspaces of `camnet.batch.lanes`: what is in which row, and how a lane is read and written.

A number of an agent is a row of the workspace, (4 ROWS,) in one piece: one entry a lane. Agents 4 b to 4 b + 3 of
an environment that flies are in its workspace b; lanes without an agent repeat the last one. All a lane needs is in the
workspace, constants as well: only then does the compiler know that nothing else is written to.
"""

from __future__ import annotations

import numpy as np

from camnet.batch.compiled import inlined, inner
from camnet.geometry.triples import Quaternion, Triple
from camnet.types import Array

__all__ = [
    "BLOCK",
    "LANES",
    "build_lanes",
    "lanes_of",
    "load_flight",
    "load_plan",
    "on_cache_lines",
    "show",
    "store_flight",
    "store_plan",
]

LANES = 4
#: environments that fly side by side: each has workspaces of its own
BLOCK = 32
# a body and its memory, in their order: p, q (x y z w), v, w; rotors, gimbal angles and rates, integral, thrust axis
P, Q, V, W = 0, 3, 7, 10
ROTORS, JOINTS, RATES, INTEGRAL, AXIS, AXIS_RATE = 13, 17, 20, 23, 26, 29
BODY, MEMORY = 13, 19
#: camera: p, q (w first), v, w
CAMERA = 32
#: reference: p, v, a, gaze, its rate; where it is to go: goal, gaze
MOTION, REFERENCE = 45, 13
SETPOINT, ASKED = 58, 5
# what is commanded: velocity, acceleration, angular velocity of the camera, heading (cosine, sine), wind
U, A, LOOK, HEADING, WIND = 63, 66, 69, 72, 74
# (cosine, sine) of the joints
CIRCLES = 77
# of one period: gain of velocity; in the body's frame: torque, angular velocity at the beginning and now; speeds asked
# of the rotors, sums of their squares
GAIN, TORQUE, BEFORE, AFTER, GOALS, SQUARES = 83, 86, 89, 92, 95, 99
# after the flight, in the same rows: reference after the period; where it would stop, braking fully and gently; depths
# of all these in the region; then places twice over, x, y, z
NEXT, STOP, GENTLE_STOP, DEPTHS, PLACES = 83, 92, 95, 98, 83
ALLOWED = 103
# constants: half the heading (cosine, sine), disc of the region, its lowest and highest corner; how far aside lanes
# without an agent are put among the places
HALF_YAW, DISC, LOW, HIGH, ASIDE = 104, 106, 109, 112, 115
#: square of the reference's error at the beginning of the period
ERROR = 116
#: in the first lane: whether one turned too fast; whether anything of the environment may have touched
WILD, NEAR = 117, 118
ROWS = 119
#: see ``ASIDE``: m, from lane to lane
_FAR_M = 1e6


def on_cache_lines(values: Array) -> Array:
    """Copy of an array that begins where a cache line does, so that what is 64 bytes long lies in one."""
    room = np.empty(values.size + 8)
    first = -room.ctypes.data // 8 % 8
    copy = room[first : first + values.size].reshape(values.shape)
    copy[...] = values
    return copy


def build_lanes(n_agents: int, yaw: Array, half_yaw: Array, boxes: Array, discs: Array, wind: Array) -> Array:
    """Workspaces (BLOCK, B, 4 ROWS) of so many agents, constants in place; arrays as in `Model`."""
    blocks = -(-n_agents // LANES)
    if blocks == 0:
        return np.zeros((BLOCK, 0, ROWS * LANES))
    x = np.zeros((blocks, ROWS, LANES))
    for k in range(blocks * LANES):
        b, lane, n = k // LANES, k % LANES, min(k, n_agents - 1)
        x[b, HEADING : HEADING + 2, lane], x[b, HALF_YAW : HALF_YAW + 2, lane] = yaw[n], half_yaw[n]
        x[b, DISC : DISC + 3, lane], x[b, WIND : WIND + 3, lane] = discs[n], wind
        x[b, LOW : LOW + 3, lane], x[b, HIGH : HIGH + 3, lane] = boxes[n]
        x[b, ASIDE, lane] = _FAR_M * max(k - n_agents + 1, 0)
    return on_cache_lines(np.tile(x.reshape(blocks, -1), (BLOCK, 1, 1)))


@inlined
def lanes_of(x: Array, rows: int) -> int:
    """Return how many lanes a workspace of so many rows has: `LANES`.

    Loops of a known few rounds the compiler unrolls first, and what is short then becomes no vector instructions. For a
    short loop, this is a number that it does not know.
    """
    return x.shape[0] // rows


@inlined
def get(x: Array, row: int, lane: int) -> Triple:
    """Three rows of a lane."""
    return x[row * LANES + lane], x[(row + 1) * LANES + lane], x[(row + 2) * LANES + lane]


@inlined
def put(x: Array, row: int, lane: int, v: Triple) -> None:
    """Write three rows of a lane."""
    x[row * LANES + lane] = v[0]
    x[(row + 1) * LANES + lane] = v[1]
    x[(row + 2) * LANES + lane] = v[2]


@inlined
def get_pair(x: Array, row: int, lane: int) -> tuple[float, float]:
    """Two rows of a lane."""
    return x[row * LANES + lane], x[(row + 1) * LANES + lane]


@inlined
def get_four(x: Array, row: int, lane: int) -> Quaternion:
    """Four rows of a lane."""
    first = row * LANES + lane
    return x[first], x[first + LANES], x[first + 2 * LANES], x[first + 3 * LANES]


@inlined
def put_four(x: Array, row: int, lane: int, v: Quaternion) -> None:
    """Write four rows of a lane."""
    first = row * LANES + lane
    x[first], x[first + LANES], x[first + 2 * LANES], x[first + 3 * LANES] = v[0], v[1], v[2], v[3]


@inlined
def orientation(x: Array, lane: int) -> Quaternion:
    """Return the body's quaternion, w first."""
    q = get_four(x, Q, lane)
    return q[3], q[0], q[1], q[2]


@inner
def load_flight(x: Array, lane: int, bodies: Array, memory: Array, cameras: Array, e: int, n: int) -> None:
    """Put body and camera of agent ``n`` of environment ``e`` into a lane."""
    for k in range(BODY):
        x[k * LANES + lane], x[(CAMERA + k) * LANES + lane] = bodies[e, n, k], cameras[e, n, k]
    for k in range(MEMORY):
        x[(BODY + k) * LANES + lane] = memory[e, n, k]


@inner
def load_plan(x: Array, lane: int, motion: Array, setpoint: Array, e: int, n: int) -> None:
    """Put reference and setpoint into a lane."""
    for k in range(REFERENCE):
        x[(MOTION + k) * LANES + lane] = motion[e, n, k]
    for k in range(ASKED):
        x[(SETPOINT + k) * LANES + lane] = setpoint[e, n, k]


@inner
def show(x: Array, count: int, bodies: Array, cameras: Array, e: int, first: int) -> None:
    """Take back what others look at: bodies and cameras of ``count`` agents from ``first`` on."""
    for i in range(count):
        for k in range(BODY):
            bodies[e, first + i, k] = x[k * LANES + i]
            cameras[e, first + i, k] = x[(CAMERA + k) * LANES + i]


@inner
def store_flight(x: Array, lane: int, bodies: Array, memory: Array, e: int, n: int) -> None:
    """Take back the body and its memory."""
    for k in range(BODY):
        bodies[e, n, k] = x[k * LANES + lane]
    for k in range(MEMORY):
        memory[e, n, k] = x[(BODY + k) * LANES + lane]


@inner
def store_plan(x: Array, lane: int, motion: Array, e: int, n: int) -> None:
    """Take back the reference."""
    for k in range(REFERENCE):
        motion[e, n, k] = x[(MOTION + k) * LANES + lane]

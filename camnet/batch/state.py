"""Environments as arrays, the environment as first axis, and their start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from camnet.batch.lane_layout import LANES, build_lanes, on_cache_lines
from camnet.batch.network import Model
from camnet.batch.own_pose import start_poses
from camnet.batch.random import Streams, stream_of
from camnet.batch.target_field import PACE
from camnet.batch.target_lanes import ROWS
from camnet.batch.target_planned import PLAN, pack_plan
from camnet.control.trim import trimmed
from camnet.geometry.pinned import Pins
from camnet.geometry.rotations import rotate
from camnet.motion.protocol import TargetMotion
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array, IntArray

__all__ = ["DELAYS", "ESTIMATE", "STATES", "State", "allocate", "restart", "state_at"]

#: columns of ``estimate``
ESTIMATE: dict[str, Any] = {
    "p": slice(0, 3),
    "q": slice(3, 7),
    "v": slice(7, 10),
    "w": slice(10, 13),
    "seen": 13,
    "last_seen": 14,
    "region": 15,
    "radius": 16,
}
#: handoffs of one target whose outcome is still open, at most; delays that are kept of one environment
PENDING, DELAYS = 8, 128
# columns of ``clock`` (E, 4): control periods, decisions, next plan (s), return so far
COUNT, CYCLE, NEXT_PLAN, RETURN = 0, 1, 2, 3
# columns of ``track`` (E, M, 10): what `HandoffTracker` remembers of a target
WAS_SEEN, REGION, LAST_REGION, LOST_S, FIRST_REGION, LAP, OPEN = 0, 1, 2, 3, 4, 5, 6
# columns of ``count`` (E, 24): see `camnet.batch.book`
SEEN, SENSES, EFFORT, NEAREST, EXITS, COLLISIONS, ATTEMPTED, COMPLETED, DELAYED = range(9)
ERRORS = (
    9  # three groups (seen, unseen from the third lap, unseen on the first) of count and two sums of squares
)
TRACKING = 18  # largest reference error, sum of its squares
SLIP = 20  # largest squared difference of motion and command, linear and angular
INSIDE, ENTRIES = 22, 23  # targets that a camera could see at the ends of decisions, entries into regions
COUNTS = 24


class State(NamedTuple):
    """State of E environments; N agents, C cameras, M targets.

    Attributes
    ----------
    bodies, memory : (E, N, 13), (E, N, 19) as in `camnet.batch.body`
    motion : (E, N, 13) references, as in `camnet.batch.reference`
    setpoint : (E, N, 5) admissible goal (3) and gaze (2)
    gust : (E, N, 3) gusts, m/s
    cameras : (E, C, 13) p, q, v (world), w (camera)
    wind : (E, 3) mean wind, m/s
    target, inner : (E, M, 13), (E, M, 8) as in `camnet.batch.motion`
    plans : (E, M, PLAN) what planned targets do, as in `camnet.batch.target_planned`
    streams : (E * (2 + M), 4) random streams of sensors, air and targets
    working : (E, C) whether a camera works; one that does not sees nothing
    visible : (E, C, M) whether a camera sees a target
    measured : (E, M, 8) measured pose (7) of the last sensing, and the camera (-1: none)
    estimate : (E, M, 17) see ``ESTIMATE``
    entries : (E, M, C, 9) predicted: 1 direct, 0.5 touching, 0 none; time; point; velocity; radius
    track, pending : (E, M, 7), (E, M, PENDING, 3) handoff in progress; unpaid ones: entered, seen (NaN), live
    delays : (E, DELAYS) delays of the episode's handoffs, s
    outside, touching : (E, N), (E, N, N + 1 + M) what was so at the last control period
    clock, count : (E, 4), (E, 22) counters
    lanes : workspaces (`camnet.batch.lane_layout`) of whichever environments fly
    chase : scratch of `camnet.batch.target_lanes`
    own_x, own_cov, own_errors, own_truth, own_turn, own_m, own_streams : see `camnet.batch.own_pose`
    """

    bodies: Array
    memory: Array
    motion: Array
    setpoint: Array
    gust: Array
    wind: Array
    cameras: Array
    target: Array
    inner: Array
    plans: Array
    streams: Streams
    working: IntArray
    visible: IntArray
    measured: Array
    estimate: Array
    entries: Array
    region: IntArray
    track: Array
    pending: Array
    delays: Array
    outside: IntArray
    touching: IntArray
    clock: Array
    count: Array  # type: ignore[assignment] # hides the tuple's method, which nobody asks for
    lanes: Array
    chase: Array
    own_x: Array
    own_cov: Array
    own_errors: Array
    own_truth: Array
    own_turn: Array
    own_m: Array
    own_streams: Streams


#: states at addresses
STATES = Pins(State)
#: the state at an address, in compiled code
state_at = STATES.of


def allocate(model: Model, environments: int) -> State:
    """Room for so many environments, not started."""
    e, n, m = environments, len(model.start_p), len(model.speeds)
    c, a = n + len(model.fixed), len(model.own_numbers)
    return State(
        bodies=np.zeros((e, n, 13)),
        memory=np.zeros((e, n, 19)),
        motion=np.zeros((e, n, 13)),
        setpoint=np.zeros((e, n, 5)),
        gust=np.zeros((e, n, 3)),
        wind=np.zeros((e, 3)),
        cameras=np.zeros((e, c, 13)),
        target=np.zeros((e, m, 13)),
        inner=np.zeros((e, m, 8)),
        plans=np.zeros((e, m, PLAN)),
        streams=np.zeros((e * (2 + m), 4), dtype=np.uint64),
        working=np.ones((e, c), dtype=np.int64),
        visible=np.zeros((e, c, m), dtype=np.int64),
        measured=np.zeros((e, m, 8)),
        estimate=np.zeros((e, m, 17)),
        entries=np.zeros((e, m, c, 9)),
        region=np.zeros((e, m), dtype=np.int64),
        track=np.zeros((e, m, 7)),
        pending=np.zeros((e, m, PENDING, 3)),
        delays=np.zeros((e, DELAYS)),
        outside=np.zeros((e, n), dtype=np.int64),
        touching=np.zeros((e, n, n + 1 + m), dtype=np.int64),
        clock=np.zeros((e, 4)),
        count=np.zeros((e, COUNTS)),
        lanes=build_lanes(n, model.yaw, model.half_yaw, model.flight, model.discs, model.wind),
        chase=on_cache_lines(np.zeros(ROWS * LANES)),
        own_x=np.zeros((e, a, 9)),
        own_cov=np.zeros((e, a, 9, 9)),
        own_errors=np.zeros((e, a, 2)),
        own_truth=np.zeros((e, a, 4)),
        own_turn=np.zeros((e, a)),
        own_m=np.zeros((e, m)),
        own_streams=np.zeros((e, 4), dtype=np.uint64),
    )


def restart(
    model: Model,
    motions: Sequence[TargetMotion],
    state: State,
    e: int,
    seed: int,
    wind_mps: Array | None = None,
    sources: Sequence[PoseSource] = (),
) -> None:
    """Put environment ``e`` at the start of the episode ``seed``: that of `NetworkSimulation.reset`.

    Everything is drawn from the same generators in the same order as there. ``motions`` are the network's, or others
    of the same laws that begin and plan differently; ``wind_mps`` (3,) is another mean wind than the network's;
    ``sources`` are those of the agents that may lose their poses, in their order.
    """
    children = np.random.SeedSequence(seed).spawn(3)
    world_rng, sensor_rng, own_rng = (np.random.default_rng(c) for c in children)
    air_rng, *target_rngs = world_rng.spawn(1 + len(motions))
    for m, (motion, rng) in enumerate(zip(motions, target_rngs, strict=True)):
        s = motion.reset(rng)
        state.target[e, m] = np.concatenate([s.p_world, s.q_world, s.v_world, s.w_body])
        state.inner[e, m] = 0.0
        state.inner[e, m, PACE] = 1.0
        state.inner[e, m, : len(s.internal)] = s.internal
        state.plans[e, m] = pack_plan(motion)
    state.wind[e] = model.wind if wind_mps is None else wind_mps
    state.gust[e] = (
        air_rng.normal(scale=model.gust_std, size=state.gust[e].shape) if model.gust_std > 0 else 0.0
    )
    first = e * (2 + len(motions))
    for k, rng in enumerate((sensor_rng, air_rng, *target_rngs)):
        state.streams[first + k] = stream_of(rng)
    _start_agents(model, state, e)
    if sources:
        start_poses(sources, _poses(model, state, e), model.dt_s, state, e, own_rng)
    _start_books(state, e)
    state.working[e] = 1 if model.cameras_on else 0


def _start_agents(model: Model, state: State, e: int) -> None:
    """At rest in hover, trimmed to the mean wind, references at the cameras, looking straight down."""
    n, c = len(model.start_p), model.constants
    state.bodies[e] = 0.0
    state.bodies[e, :, :3] = model.start_p
    state.bodies[e, :, 5], state.bodies[e, :, 6] = model.half_yaw[:, 1], model.half_yaw[:, 0]
    state.memory[e] = 0.0
    state.memory[e, :, 15] = 1.0
    state.memory[e, :, :4] = math.sqrt(c[1] * c[13] / 4.0 / c[6])
    if n and state.wind[e].any():
        q, state.memory[e] = trimmed(c, model.yaw, state.wind[e])
        state.bodies[e, :, 3:7] = q[:, [1, 2, 3, 0]]
        level = np.column_stack([model.half_yaw[:, 0], np.zeros((n, 2)), model.half_yaw[:, 1]])
        offset = np.broadcast_to(model.offset, (n, 3))
        state.bodies[e, :, :3] += rotate(level, offset) - rotate(q, offset)
    state.cameras[e] = 0.0
    state.cameras[e, n:, :7] = model.fixed
    state.motion[e] = 0.0
    state.setpoint[e] = 0.0


def _poses(model: Model, state: State, e: int) -> Array:
    """Return true x and y of the cameras and headings (A,3) of the agents that may lose their poses."""
    chosen = np.flatnonzero(model.own_index >= 0)
    q = state.bodies[e, chosen][:, [6, 3, 4, 5]]
    p = state.bodies[e, chosen, :3] + rotate(q, np.broadcast_to(model.offset, (len(chosen), 3)))
    w, x, y, z = q.T
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.column_stack([p[:, :2], heading])


def _start_books(state: State, e: int) -> None:
    state.working[e] = 1
    state.visible[e] = 0
    state.measured[e] = 0.0
    state.measured[e, :, 7] = -1.0
    state.estimate[e] = 0.0
    state.estimate[e, :, 0:3] = np.nan
    state.estimate[e, :, 3] = 1.0
    state.estimate[e, :, ESTIMATE["last_seen"]] = -np.inf
    state.estimate[e, :, ESTIMATE["region"]] = -1.0
    state.estimate[e, :, ESTIMATE["radius"]] = np.inf
    state.entries[e] = 0.0
    state.region[e] = -1
    state.track[e] = 0.0
    state.track[e, :, [REGION, LAST_REGION, FIRST_REGION]] = -1.0
    state.track[e, :, LOST_S] = np.nan
    state.track[e, :, LAP], state.track[e, :, OPEN] = 1.0, -1.0
    state.pending[e] = 0.0
    state.delays[e] = np.nan
    state.outside[e], state.touching[e] = 0, 0
    state.clock[e] = 0.0
    state.clock[e, NEXT_PLAN] = -np.inf
    state.count[e] = 0.0
    state.count[e, NEAREST] = np.inf

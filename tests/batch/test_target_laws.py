"""Targets of the batch back end move as their laws say, planned ones too, one by one and in lanes."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from camnet.batch.motion import pack_targets, step_target
from camnet.batch.random import stream_of
from camnet.batch.target_field import PACE, step_field
from camnet.batch.target_lanes import ROWS, in_lanes, step_loops
from camnet.batch.target_planned import pack_plan
from camnet.config.load import load_scenario
from camnet.errors import ConfigError
from camnet.geometry.borrow import lend
from camnet.geometry.settings import Road
from camnet.motion.factory import build_motion
from camnet.motion.planned import DrivePlan, PlannedField, PlannedRoad
from camnet.motion.road import RoadMotion
from camnet.motion.settings import TargetSettings
from camnet.motion.track import Track
from camnet.motion.vector_field import VectorFieldMotion
from camnet.simulation.network import build_network

LOOP = Road(name="loop", points_m=((4, 0), (1, 3), (-3, 2), (-3, -2), (1, -3)), closed=True)
CROSSING = [
    Road(name="a", points_m=((0, 0), (8, 0))),
    Road(name="b", points_m=((8, 0), (8, 8), (0, 8))),
    Road(name="c", points_m=((8, 0), (16, 0))),
    Road(name="d", points_m=((0, 8), (0, 0))),
]


def _targets():
    field = {"kind": "vector_field", "speed_mps": 0.4}
    track = Track(
        "t",
        np.array([0.0, 2.0, 5.0, 6.0]),
        np.array([[0, 0, 0], [1, 0.4, 0], [1, 2, 0.1], [1.1, 2, 0.1]], float),
    )
    turned = Track("t", track.t_s, track.p_world, np.array([0.0, 1.0, 3.0, -3.0]))
    cases = [
        ({**field, "field": "loop", "road": "loop"}, [LOOP], None),
        ({**field, "field": "loop", "road": "loop", "motor_lag_s": 0.3}, [LOOP], None),
        ({**field, "field": "wave", "scale_m": 3.0}, [], None),
        ({"kind": "road", "road": "a", "speed_mps": (0.8, 1.4), "lateral_std_m": 0.2}, CROSSING, None),
        ({"kind": "track", "file": "x.csv", "start_s": 0.5}, [], track),
        ({"kind": "track", "file": "x.csv"}, [], turned),
    ]
    for motion, roads, record in cases:
        settings = TargetSettings(name="t", motion=motion, v_max_mps=3.0, w_max_radps=2.5)
        motion = build_motion(settings, roads, record)
        yield motion
        plan = DrivePlan(0.3, False, -0.6, (0.1, 0.7, 0.4), (0.0, 1.0, 0.6), 4.0, 9.0, 3.0, 1.2)
        if isinstance(motion, RoadMotion):
            yield PlannedRoad(motion, plan, 0.4)
        elif isinstance(motion, VectorFieldMotion):
            yield PlannedField(motion, plan, 0.2)


@njit
def _moved(laws, m, now, inner, t_s, dt, streams, plan):
    step_target(lend(laws), m, now, inner, 0, t_s, dt, streams, m, plan)


def test_targets_move_as_their_laws_say():
    motions = list(_targets())
    laws, n, dt = pack_targets(motions), len(motions), 1 / 60
    rngs = np.random.default_rng(8).spawn(n)
    states = [motion.reset(rng) for motion, rng in zip(motions, rngs, strict=True)]
    rows = [np.concatenate([s.p_world, s.q_world, s.v_world, s.w_body]) for s in states]
    now, inner = np.array(rows)[None], np.zeros((1, n, 8))
    inner[..., PACE] = 1.0
    plans = np.array([pack_plan(motion) for motion in motions])
    for m, s in enumerate(states):
        inner[0, m, : len(s.internal)] = s.internal
    streams = np.array([stream_of(rng) for rng in rngs])
    for k in range(1800):
        for m in range(n):
            states[m] = motions[m].step(states[m], k * dt, dt, rngs[m])
            _moved(laws, m, now, inner, k * dt, dt, streams, plans[m])
        if k % 300 == 299:
            rows = [np.concatenate([s.p_world, s.q_world, s.v_world, s.w_body]) for s in states]
            np.testing.assert_allclose(now[0], rows, rtol=0, atol=1e-9)


@njit
def _step_in_lanes(laws, now, inner, block, dt, work):
    for first in range(0, block.shape[0], 4):
        step_loops(lend(laws), 0, now, inner, block, first, dt, work)


@njit
def _in_lanes(laws):
    return in_lanes(lend(laws), 0)


@njit
def _step_alone(laws, now, inner, e, dt):
    step_field(lend(laws), 0, now, inner, e, dt)


def test_targets_on_loops_move_in_lanes_as_they_do_alone():
    """Six of eight environments, the last lanes repeated; two start far off the loop or against its direction."""
    motion = build_network(load_scenario("quickstart")).description.targets[0].motion
    laws, dt = pack_targets([motion]), 1 / 60
    assert _in_lanes(laws)
    rng, block = np.random.default_rng(3), np.array([0, 2, 3, 5, 6, 7])
    now, inner = np.zeros((8, 1, 13)), np.zeros((8, 1, 8))
    inner[..., PACE] = 1.0
    for e in block:
        s = motion.reset(rng)
        now[e, 0] = np.concatenate([s.p_world, s.q_world, s.v_world, s.w_body])
        inner[e, 0, : len(s.internal)] = s.internal
    now[2, 0, :2] += 1.1
    inner[5, 0, 0] += 2.5
    lanes, alone = (now.copy(), inner.copy()), (now, inner)
    work = np.zeros(ROWS * 4)
    for _ in range(6000):  # more than a lap
        _step_in_lanes(laws, *lanes, block, dt, work)
        for e in block:
            _step_alone(laws, *alone, e, dt)
    assert not now[[1, 4]].any()
    np.testing.assert_allclose(lanes[0], alone[0], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(
        lanes[1][:, :, [0, 1, 2, 3, 5]], alone[1][:, :, [0, 1, 2, 3, 5]], rtol=0.0, atol=1e-8
    )


def test_targets_on_different_roads_are_refused():
    road = {"kind": "road", "road": "a", "speed_mps": (0.8, 1.4)}
    settings = TargetSettings(name="t", motion=road, v_max_mps=3.0)
    motions = [build_motion(settings, roads) for roads in (CROSSING, CROSSING[:1])]
    with pytest.raises(ConfigError, match="share one road network"):
        pack_targets(motions)

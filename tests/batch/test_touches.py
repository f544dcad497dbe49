"""Touches: as PyBullet finds them; nothing is missed by looking at near bodies only."""

from __future__ import annotations

import numpy as np
import pybullet
import pytest
from numba import njit

from camnet.batch import flight, lane_layout, lane_touches, touch
from camnet.batch.network import MODELS, network_at
from camnet.batch.state import COLLISIONS, STATES, state_at
from camnet.env.batch_handoff import BatchHandoff


@njit
def _look(model_place, state_place):
    """Whether anything may touch in environment 0, as if nothing had before; then note what does."""
    model, state = network_at(model_place), state_at(state_place)
    flight.load(state, state.lanes[0], 0)
    state.lanes[0, 0, lane_layout.NEAR * lane_layout.LANES] = 0.0
    lane_touches.note_places(state.lanes, 1)
    near = lane_touches.may_touch(model, state, 0, 0)
    touch.note_touches(model, state, 0)
    return near


def _scatter(state, rng):
    """Put agents about the first target, some of them too near, all of them tilted."""
    n = state.bodies.shape[1]
    around = rng.uniform(0.25, 4.0) * rng.standard_normal((n, 3))
    state.bodies[0, :, :3] = state.target[0, 0, :3] + around + [0.0, 0.0, rng.uniform(0.0, 6.0)]
    q = rng.standard_normal((n, 4))
    state.bodies[0, :, 3:7] = q / np.linalg.norm(q, axis=1, keepdims=True)
    for m in range(state.target.shape[1]):
        q = rng.standard_normal(4)
        state.target[0, m, 3:7] = q / np.linalg.norm(q)


def _near(model, state):
    """Whether any two are near enough to touch whatever way they are turned, by all distances."""
    p, t = state.bodies[0, :, :3], state.target[0, :, :3]
    radius, height = model.body
    apart = np.linalg.norm(p[:, None] - p, axis=-1) + np.where(np.eye(len(p)) > 0, np.inf, 0.0)
    reach = 0.5 * model.sizes[:, 0] + 0.5 * model.sizes[:, 1] + model.sizes[:, 2] + radius + height
    return bool(
        (apart <= np.hypot(2 * radius, height)).any()
        or (p[:, 2] <= radius + height).any()
        or (np.linalg.norm(p[:, None] - t, axis=-1) <= reach).any()
    )


@pytest.mark.parametrize("world", ["quickstart", "pursuit", "loop_8"])
def test_nothing_touches_where_nothing_may(world):
    """Four agents in one workspace, six in two of which one is half empty, eight in two."""
    env = BatchHandoff(world, 1, filter_name="ekf")
    env.reset(seed=1)
    group, rng = env.simulation.groups[0], np.random.default_rng(2)
    pins = MODELS.pin(group.model), STATES.pin(group.state)
    counts = {"far": 0, "near": 0, "touching": 0}
    for _ in range(3000):
        _scatter(group.state, rng)
        group.state.touching[:] = 0
        near = _look(pins[0].at, pins[1].at)
        assert near == _near(group.model, group.state)
        touching = bool(group.state.touching.any())
        assert near or not touching
        counts["touching" if touching else ("near" if near else "far")] += 1
    assert min(counts.values()) > 100
    env.close()


class _Bullet:
    """Two agents, a target and the ground in PyBullet."""

    def __init__(self, radius, height, size):
        self.half, self.client = 0.5 * size, pybullet.connect(pybullet.DIRECT)
        cylinder = self._shape(pybullet.GEOM_CYLINDER, radius=radius, height=height)
        box = self._shape(pybullet.GEOM_BOX, halfExtents=self.half)
        self.bodies = [
            pybullet.createMultiBody(1.0, shape, physicsClientId=self.client)
            for shape in (cylinder, cylinder, box)
        ]
        self.ground = pybullet.createMultiBody(
            0.0, self._shape(pybullet.GEOM_PLANE), physicsClientId=self.client
        )

    def _shape(self, kind, **size):
        return pybullet.createCollisionShape(kind, physicsClientId=self.client, **size)

    def gaps(self, agents, target):
        """Gaps from agent 0 to agent 1, the target and the ground, m, negative inside; rows as in `State`."""
        middle = pybullet.multiplyTransforms(
            target[:3], np.roll(target[3:7], -1), (0, 0, self.half[2]), (0, 0, 0, 1)
        )
        poses = [(agents[0, :3], agents[0, 3:7]), (agents[1, :3], agents[1, 3:7]), middle]
        for body, (p, q) in zip(self.bodies, poses, strict=True):
            pybullet.resetBasePositionAndOrientation(body, p, q, physicsClientId=self.client)
        first, *others = self.bodies
        return [
            min(point[8] for point in pybullet.getClosestPoints(first, k, 9.0, physicsClientId=self.client))
            for k in (*others, self.ground)
        ]


def test_touches_are_those_of_pybullet():
    """Who touches there does so here. The axes tried here do not separate all bodies that are a little apart."""
    env = BatchHandoff("quickstart", 1, filter_name="ekf")
    env.reset(seed=1)
    group, rng = env.simulation.groups[0], np.random.default_rng(7)
    state, places = group.state, (MODELS.pin(group.model), STATES.pin(group.state))
    bullet, gaps, here = _Bullet(*group.model.body, group.model.sizes[0]), [], []
    for _ in range(1000):
        _scatter(state, rng)
        way = rng.standard_normal((2, 3))
        way *= rng.uniform(0.0, 0.5, (2, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
        state.bodies[0, 0, :3] = state.target[0, 0, :3] + way[0] + [0.0, 0.0, 0.15]
        state.bodies[0, 1, :3] = state.bodies[0, 0, :3] + way[1]
        state.touching[:] = 0
        _note(places[0].at, places[1].at, 0)
        gaps += bullet.gaps(state.bodies[0], state.target[0, 0])
        here += [state.touching[0, 1, 0], state.touching[0, 0, 5], state.touching[0, 0, 4]]
    pybullet.disconnect(bullet.client)
    env.close()
    gap, touching = np.array(gaps), np.array(here) > 0
    assert 0.2 < touching.mean() < 0.8
    assert gap[~touching].min() > -1e-3
    assert gap[touching].max() < 0.04
    assert (gap[touching] > 0.0).mean() < 0.03


#: where agents are put, m, and how fast: two fly into each other, one into the robot, one to the ground
PLACES = np.array([[0.0, 0.0, 3.0], [0.6, 0.0, 3.0], [0.0, 0.0, 0.6], [0.0, 9.0, 0.2]])
SPEEDS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])


def test_collisions_are_counted_as_if_all_were_looked_at_always():
    """Decisions as long as a control period, so that every instant can be looked at."""
    once_a_period = {
        "overrides": ["run.decision_hz=60"],
        "max_cycles": 10**6,
        "threads": 1,
        "terminate_on_collision": False,
    }
    env = BatchHandoff("quickstart", 3, filter_name="ekf", **once_a_period)
    env.reset(seed=4)
    group, rng = env.simulation.groups[0], np.random.default_rng(5)
    state = group.state
    other = state._replace(touching=state.touching.copy(), count=state.count.copy())
    model, beside = MODELS.pin(group.model), STATES.pin(other)
    for k in range(240):
        if k % 60 == 0:
            state.bodies[:, :, :3] = rng.uniform(-0.3, 0.3, (3, 4, 3)) + PLACES
            state.bodies[:, 2, :3] += state.target[:, 0, :3]
            state.bodies[:, :, 7:10] = rng.uniform(-1, 1, (3, 4, 3)) + SPEEDS
        env.step(np.zeros((3, 4, 5), dtype=np.float32))
        for e in range(3):
            _note(model.at, beside.at, e)
        np.testing.assert_array_equal(state.touching, other.touching)
        np.testing.assert_array_equal(state.count[:, COLLISIONS], other.count[:, COLLISIONS])
    assert state.count[:, COLLISIONS].min() >= 2
    env.close()


@njit
def _note(model_place, state_place, e):
    touch.note_touches(network_at(model_place), state_at(state_place), e)

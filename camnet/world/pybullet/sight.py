"""Sight lines: which of many straight lines from cameras to feature points nothing blocks."""

from __future__ import annotations

import numpy as np
import pybullet as pb

from camnet.geometry.rotations import conjugate, rotate
from camnet.types import Array, BoolArray
from camnet.world.pybullet.engine import GROUND_MASK, Engine

__all__ = ["rays_clear"]

#: features lie on surfaces: a sight line ends this much before its point, m
_SHORT_OF_POINT_M = 2e-3
#: a point this close to a target's box belongs to that target, m
_ON_TARGET_M = 0.02
_MASK = ~GROUND_MASK
_BATCH = 16000


def _leave_own_body(origins: Array, directions: Array, agent_p: Array, radius: float) -> Array:
    """Length (K,) of each line inside the ball around the agent that holds its origin (0 elsewhere)."""
    start = np.zeros(len(origins))
    for p in agent_p:
        offset = origins - p
        along = np.einsum("ki,ki->k", offset, directions)
        inside = radius**2 - np.einsum("ki,ki->k", offset, offset)
        exit_length = -along + np.sqrt(np.maximum(along**2 + inside, 0.0))
        start = np.where(inside > 0.0, np.maximum(start, exit_length), start)
    return start


def _belongs(points: Array, p_world: Array, q_world: Array, size_m: tuple[float, float, float]) -> BoolArray:
    """Tell which points (K,3) lie in or on the box of one target."""
    local = rotate(conjugate(q_world), points - p_world)
    half = np.array([0.5 * size_m[0], 0.5 * size_m[1], 0.5 * size_m[2]])
    away = np.abs(local - np.array([0.0, 0.0, half[2]])) - half
    return np.asarray((away <= _ON_TARGET_M).all(axis=1))


def _first_hits(engine: Engine, starts: Array, ends: Array) -> list[int]:
    hits: list[int] = []
    for k in range(0, len(starts), _BATCH):
        found = pb.rayTestBatch(
            starts[k : k + _BATCH].tolist(),
            ends[k : k + _BATCH].tolist(),
            numThreads=1,
            collisionFilterMask=_MASK,
            physicsClientId=engine.client,
        )
        hits += [hit[0] for hit in found]
    return hits


def rays_clear(
    engine: Engine,
    origins: Array,
    points: Array,
    agent_p: Array,
    agent_radius: float,
    targets: dict[int, tuple[Array, Array, tuple[float, float, float]]],
) -> BoolArray:
    """See `camnet.world.protocol.World.rays_clear`; ``targets`` maps body numbers to pose and size.

    A line whose first hit is the target that its point belongs to is clear: targets are convex, so what lies
    between that hit and the point is the target itself.
    """
    origins, points = np.asarray(origins, dtype=float), np.asarray(points, dtype=float)
    if len(origins) == 0:
        return np.zeros(0, dtype=bool)
    lines = points - origins
    length = np.sqrt(np.einsum("ki,ki->k", lines, lines))
    directions = lines / np.maximum(length, 1e-12)[:, None]
    start = _leave_own_body(origins, directions, agent_p, agent_radius)
    end = length - _SHORT_OF_POINT_M
    near, far = origins + start[:, None] * directions, origins + end[:, None] * directions
    hits = np.array(_first_hits(engine, near, far))
    clear = (hits < 0) | (start >= end)
    for number, (p_world, q_world, size_m) in targets.items():
        own = hits == number
        if own.any():
            clear |= own & _belongs(points, p_world, q_world, size_m)
    return np.asarray(clear)

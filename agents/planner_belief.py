"""What the team of `camnet.agents.planner` expects: where targets will be, and which handoffs are still open.

An observation says where a target is believed to be, how fast it goes, and where and when it will enter the region.
Beside that one estimate stand particles on the roads (`camnet.agents.planner_roads`) for targets that nobody sees. How
much the estimate is trusted is counted: how often, when a target came into view again, it was where the estimate said.

| ``columns`` (M, 12) | field of a target in the observation |
| --- | --- |
| 0-4 | known, seen_by_me, seen, inside, coming |
| 5, 6 | position, velocity (first of three) |
| 7-9 | radius, entry_time, entry_radius |
| 10, 11 | entry_position, entry_velocity (first of three) |

| ``memory`` (M, 9) | meaning |
| --- | --- |
| 0 | 1 once the target was seen |
| 1 | 1 if a camera sees it now |
| 2, 3, 4, 5 | latest estimate: x, y, m, and its velocity, m/s |
| 6 | agent that saw it last, -1 where no agent has |
| 7 | time since it was seen, s |
| 8 | time since the estimate entered the region in which it is, s |
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.agents.planner_kernel import AHEAD_S, axis, expected_view, inside
from camnet.agents.planner_roads import (
    RoadMap,
    Seeds,
    advance,
    nearest_heading,
    place,
    scatter,
    thin_out,
    uniform,
)
from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray, IntArray

__all__ = ["FIELDS", "MEMORY", "expect", "futures", "remember"]

FIELDS = (
    "known",
    "seen_by_me",
    "seen",
    "inside",
    "coming",
    "position",
    "velocity",
    "radius",
    "entry_time",
    "entry_radius",
    "entry_position",
    "entry_velocity",
)
_KNOWN, _MINE, _SEEN, _INSIDE, _COMING, _P, _V, _RADIUS, _T_IN, _R_IN, _P_IN, _V_IN = range(12)
#: numbers of a target's memory
MEMORY = 9
#: spread of a known position, m, its growth with time ahead, m/s, and the spread of a particle, m
_LEAST_SPREAD_M, _GROWTH_MPS, _PARTICLE_M = 0.06, 0.10, 0.3
#: gaps shorter than this say nothing of an estimate; one this far off was wrong
_GAP_S, _WRONG_M = 1.0, 1.0
#: an unseen particle that the camera would see loses this share of its weight
_LOOKED = 0.9


@cached_njit
def _watch(
    shown: NDArray[np.float32],
    alive: BoolArray,
    columns: IntArray,
    speeds: Array,
    facts: Array,
    dt_s: float,
    memory: Array,
    trust: Array,
) -> None:
    """Take down who sees what, and whether estimates proved right."""
    for m in range(columns.shape[0]):
        c, now, source, watcher = columns[m], False, -1, -1
        for n in range(shown.shape[0]):
            if alive[n] and shown[n, c[_KNOWN]] > 0:
                source = n if source < 0 else source
                now = now or shown[n, c[_SEEN]] > 0
                if shown[n, c[_MINE]] > 0:
                    source, watcher = n, n
        if source < 0:
            memory[m, 0], memory[m, 1], memory[m, 6] = 0.0, 0.0, -1.0
            continue
        p, v = c[_P], c[_V]
        x = facts[source, 0] + shown[source, p] * facts[source, 3]
        y = facts[source, 1] + shown[source, p + 1] * facts[source, 4]
        if now and memory[m, 0] > 0 and memory[m, 7] > _GAP_S:
            off = math.sqrt((x - memory[m, 2]) ** 2 + (y - memory[m, 3]) ** 2)
            trust[0 if off < _WRONG_M else 1] += 1.0
        memory[m, 0], memory[m, 1] = 1.0, 1.0 if now else 0.0
        memory[m, 2], memory[m, 3] = x, y
        memory[m, 4], memory[m, 5] = shown[source, v] * speeds[m], shown[source, v + 1] * speeds[m]
        memory[m, 7] = 0.0 if now else memory[m, 7] + dt_s
        if watcher >= 0:
            memory[m, 6] = watcher
        held = False
        for n in range(facts.shape[0]):
            held = held or inside(x, y, 1e-3, facts[n]) > 0.5
        memory[m, 8] = memory[m, 8] + dt_s if held else 0.0


@cached_njit
def remember(
    shown: NDArray[np.float32],
    alive: BoolArray,
    columns: IntArray,
    speeds: Array,
    facts: Array,
    poses: Array,
    dt_s: float,
    roads: RoadMap,
    memory: Array,
    trust: Array,
    particles: Array,
    seeds: Seeds,
    e: int,
) -> None:
    """Carry the team's memory on to the observations (N, D); ``poses`` (N, 5): positions, tangents of the gaze."""
    before = memory.copy()
    _watch(shown, alive, columns, speeds, facts, dt_s, memory, trust)
    if roads.points.shape[0] == 0:
        return
    for m in range(columns.shape[0]):
        if memory[m, 1] > 0:
            particles[m, 0, 3] = -1.0  # drawn anew once it is out of view
            continue
        if memory[m, 0] == 0.0 and particles[m, 0, 3] <= 0.0:
            scatter(roads, speeds[m], particles[m], seeds, e)
        elif particles[m, 0, 3] < 0.0:
            _depart(roads, before[m], particles[m], seeds, e)
        _go_on(facts, alive, poses, dt_s, roads, particles[m], seeds, e)
        thin_out(roads, speeds[m], particles[m], seeds, e)


@cached_njit
def _depart(roads: RoadMap, last: Array, particles: Array, seeds: Seeds, e: int) -> None:
    """Put all particles where the target was last seen."""
    heading, arc = nearest_heading(roads, last[2], last[3], last[4], last[5])
    speed, count = math.sqrt(last[4] ** 2 + last[5] ** 2), particles.shape[0]
    for p in range(count):
        particles[p, 0], particles[p, 1] = heading, arc
        particles[p, 2] = speed * (0.85 + 0.3 * uniform(seeds, e))
        particles[p, 3], particles[p, 4] = 1.0 / count, 10.0


@cached_njit
def _go_on(
    facts: Array,
    alive: BoolArray,
    poses: Array,
    dt_s: float,
    roads: RoadMap,
    particles: Array,
    seeds: Seeds,
    e: int,
) -> None:
    """Move the particles of one target, and weigh down those that a camera should see."""
    for p in range(particles.shape[0]):
        heading, arc = advance(roads, int(particles[p, 0]), particles[p, 1], particles[p, 2] * dt_s, seeds, e)
        particles[p, 0], particles[p, 1] = heading, arc
        x, y = place(roads, heading, arc)
        held = False
        for n in range(facts.shape[0]):
            if inside(x, y, 1e-3, facts[n]) > 0.5:
                held = True
                if alive[n]:
                    q = poses[n]
                    d = axis(q[3], q[4])
                    seen = expected_view(x - q[0], y - q[1], -q[2], d, 0.1, facts[n])
                    particles[p, 3] *= 1.0 - _LOOKED * seen
        particles[p, 4] = (particles[p, 4] + dt_s if particles[p, 4] >= 0.0 else 0.0) if held else -1.0


@cached_njit
def futures(roads: RoadMap, memory: Array, particles: Array, seeds: Seeds, e: int) -> Array:
    """Return where each particle will be (M, P, T, 2), m, at the instants ahead; junctions by lot."""
    m_targets, count = particles.shape[:2]
    out = np.zeros((m_targets, count, len(AHEAD_S), 2))
    for m in range(m_targets):
        if memory[m, 1] > 0 or roads.points.shape[0] == 0:
            continue
        for p in range(count):
            heading, arc, before = int(particles[m, p, 0]), particles[m, p, 1], 0.0
            for i in range(len(AHEAD_S)):
                step = (AHEAD_S[i] - before) * particles[m, p, 2]
                heading, arc = advance(roads, heading, arc, step, seeds, e)
                before = AHEAD_S[i]
                out[m, p, i, 0], out[m, p, i, 1] = place(roads, heading, arc)
    return out


@cached_njit
def _estimate(
    o: NDArray[np.float32],
    c: IntArray,
    m: int,
    n: int,
    speed: float,
    share: float,
    memory: Array,
    f: Array,
    places: Array,
    spreads: Array,
    chances: Array,
    k: int,
) -> bool:
    """Write the estimate of target ``m`` as hypothesis ``k`` of weight ``share``; whether it matters to agent ``n``."""
    steps, here = spreads.shape[0], o[c[_INSIDE]] > 0
    enters = not here and o[c[_COMING]] > 0
    radius = np.float64(o[c[_R_IN]] if enters else o[c[_RADIUS]]) * f[27]
    start, way = (c[_P_IN], c[_V_IN]) if enters else (c[_P], c[_V])
    begin, most = (np.float64(o[c[_T_IN]]) * f[28] if enters else 0.0), 0.0
    for i in range(steps):
        after = AHEAD_S[i] - begin
        for j in range(3):
            v = np.float64(o[way + j]) * speed if j < 2 else 0.0
            places[i, k, j] = f[j] + np.float64(o[start + j]) * f[3 + j] + after * v
        spreads[i, k] = _LEAST_SPREAD_M + 0.5 * radius + _GROWTH_MPS * AHEAD_S[i]
        chances[i, k] = share * inside(places[i, k, 0], places[i, k, 1], spreads[i, k], f)
        most = max(most, chances[i, k])
    chances[steps, k], chances[steps + 1, k] = 0.0, 0.0
    if memory[m, 1] == 0.0 and memory[m, 6] != n and (here or enters):
        left = (begin if enters else -memory[m, 8]) + f[33]
        if left + radius / max(speed, 1e-3) > 0.0:
            chances[steps, k], chances[steps + 1, k] = f[35] + f[36], max(left, 0.3)
    return most > 0.01


@cached_njit
def _particle(
    ahead: Array,
    particle: Array,
    share: float,
    worth: float,
    f: Array,
    places: Array,
    spreads: Array,
    chances: Array,
    k: int,
) -> bool:
    """Write a particle as hypothesis ``k``; whether it comes into the region at all."""
    steps, most, enters = spreads.shape[0], 0.0, -1.0
    for i in range(steps):
        places[i, k, 0], places[i, k, 1], places[i, k, 2] = ahead[i, 0], ahead[i, 1], 0.0
        spreads[i, k] = _PARTICLE_M
        held = inside(ahead[i, 0], ahead[i, 1], 0.1, f) > 0.5
        chances[i, k] = share if held else 0.0
        most = max(most, chances[i, k])
        if held and enters < 0.0:
            enters = AHEAD_S[i]
    since = particle[4] if particle[4] >= 0.0 and enters == AHEAD_S[0] else -enters
    left = f[33] - since
    chances[steps, k], chances[steps + 1, k] = (worth, left) if left > 0.0 else (0.0, 0.0)
    return most > 0.0


@cached_njit
def expect(
    o: NDArray[np.float32],
    n: int,
    columns: IntArray,
    speeds: Array,
    memory: Array,
    trust: Array,
    particles: Array,
    ahead: Array,
    f: Array,
    places: Array,
    spreads: Array,
    chances: Array,
) -> tuple[int, int]:
    """Write the hypotheses that matter to agent ``n``; how many are estimates, and how many there are.

    ``places`` (T, K, 3), ``spreads`` (T, K), ``chances`` (T + 2, K): see `camnet.agents.planner_kernel`.
    """
    k, right = 0, (trust[0] + 2.0) / (trust[0] + trust[1] + 2.5)
    has_roads = ahead.shape[2] > 0 and particles.shape[1] > 0
    for m in range(columns.shape[0]):
        if memory[m, 0] > 0 and o[columns[m, _KNOWN]] > 0:
            share = right if has_roads and memory[m, 1] == 0.0 else 1.0
            k += _estimate(o, columns[m], m, n, speeds[m], share, memory, f, places, spreads, chances, k)
    estimates = k
    if not has_roads:
        return estimates, k
    for m in range(columns.shape[0]):
        if memory[m, 1] > 0:
            continue
        share = 1.0 - right if memory[m, 0] > 0 else 1.0
        worth = f[35] + f[36] if memory[m, 0] > 0 and memory[m, 6] != n else 0.0
        for p in range(particles.shape[1]):
            weight = share * particles[m, p, 3]
            if weight > 1e-3:
                k += _particle(ahead[m, p], particles[m, p], weight, worth, f, places, spreads, chances, k)
    return estimates, k

"""Whether anything may touch, four agents at a time: only then is `camnet.batch.touch` asked.

What is asked here of all pairs is what is asked there of each first, with the same numbers: where no two bodies are
near enough to touch whatever way they are turned, nothing touches. What is no number counts as near.
"""

from __future__ import annotations

from camnet.batch.compiled import inner
from camnet.batch.lane_layout import ASIDE, LANES, NEAR, PLACES, ROWS, P, get, lanes_of
from camnet.batch.network import Model
from camnet.batch.state import State
from camnet.batch.touch import agents_reach, ground_reach, target_reach
from camnet.geometry.triples import Triple
from camnet.types import Array

__all__ = ["may_touch"]


@inner
def _note_places(x: Array) -> None:
    """Write the agents' places twice over, so that reading them from another one on goes round and round."""
    for i in range(lanes_of(x, ROWS)):
        p, k = get(x, P, i), PLACES * LANES + i
        x[k] = x[k + LANES] = p[0] + x[ASIDE * LANES + i]
        x[k + 2 * LANES] = x[k + 3 * LANES] = p[1]
        x[k + 4 * LANES] = x[k + 5 * LANES] = p[2]


@inner
def _near_pairs(x: Array, y: Array, shift: int, reach: float) -> int:
    """How many lanes of ``x`` are near the lane of ``y`` that is ``shift`` farther, round and round."""
    near = 0
    for i in range(lanes_of(x, ROWS)):
        k = PLACES * LANES + i
        j = k + shift
        dx, dy, dz = x[k] - y[j], x[k + 2 * LANES] - y[j + 2 * LANES], x[k + 4 * LANES] - y[j + 4 * LANES]
        near += 0 if dx * dx + dy * dy + dz * dz > reach else 1
    return near


@inner
def _near_ground(x: Array, reach: float) -> int:
    """How many lanes are near the ground."""
    near = 0
    for i in range(lanes_of(x, ROWS)):
        near += 0 if x[(P + 2) * LANES + i] > reach else 1
    return near


@inner
def _near_place(x: Array, p: Triple, reach: float) -> int:
    """How many lanes are near a place."""
    near = 0
    for i in range(lanes_of(x, ROWS)):
        here = get(x, P, i)
        dx, dy, dz = here[0] - p[0], here[1] - p[1], here[2] - p[2]
        near += 0 if dx * dx + dy * dy + dz * dz > reach else 1
    return near


@inner
def _near_others(model: Model, lanes: Array, b: int) -> int:
    """How many pairs are near each other, one of them in workspace ``b`` and the other there or in one before."""
    reach = agents_reach(model)
    near = _near_pairs(lanes[b], lanes[b], 1, reach) + _near_pairs(lanes[b], lanes[b], 2, reach)
    for c in range(b):
        for shift in range(LANES):
            near += _near_pairs(lanes[b], lanes[c], shift, reach)
    return near


@inner
def may_touch(model: Model, state: State, k: int, e: int) -> bool:
    """Whether anything may touch in the block's ``k``-th environment ``e``, or might when this was last asked."""
    lanes, near = state.lanes[k], 0
    for b in range(lanes.shape[0]):
        _note_places(lanes[b])
        near += _near_ground(lanes[b], ground_reach(model)) + _near_others(model, lanes, b)
        for m in range(state.target.shape[1]):
            p = (state.target[e, m, 0], state.target[e, m, 1], state.target[e, m, 2])
            near += _near_place(lanes[b], p, target_reach(model, m))
    before = lanes[0, NEAR * LANES]
    lanes[0, NEAR * LANES] = float(near)
    return near > 0 or before > 0.0

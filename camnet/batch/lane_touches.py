"""Whether anything may touch, four agents at a time: only then is `camnet.batch.touch` asked.

What is asked here of all pairs is what is asked there of each first, with the same numbers: where no two bodies are
near enough to touch whatever way they are turned, nothing touches. What is no number counts as near.
"""

from __future__ import annotations

from camnet.batch.compiled import inlined, inner
from camnet.batch.lane_layout import ASIDE, LANES, NEAR, PLACES, ROWS, P, get, lanes_of
from camnet.batch.network import Model
from camnet.batch.state import State
from camnet.batch.touch import agents_reach, ground_reach, target_reach
from camnet.geometry.triples import Triple
from camnet.types import Array

__all__ = ["may_touch", "note_places"]


@inlined
def _note_places(x: Array) -> None:
    for i in range(LANES):
        p, k = get(x, P, i), PLACES * LANES + i
        x[k] = x[k + LANES] = p[0] + x[ASIDE * LANES + i]
        x[k + 2 * LANES] = x[k + 3 * LANES] = p[1]
        x[k + 4 * LANES] = x[k + 5 * LANES] = p[2]


@inner
def note_places(lanes: Array, count: int) -> None:
    """Write the agents' places twice over, so that reading them from another one on goes round and round.

    ``lanes`` (count or more, B, 4 ROWS) are the workspaces of ``count`` environments. All are written before any is
    read: what reads at once what two writes have just made waits for both.
    """
    for k in range(count):
        for b in range(lanes.shape[1]):
            _note_places(lanes[k, b])


@inlined
def _apart(x: Array, y: Array, i: int, shift: int, reach: float) -> bool:
    """Whether lane ``i`` of ``x`` is far from the lane of ``y`` that is ``shift`` farther, round and round."""
    k = PLACES * LANES + i
    j = k + shift
    dx, dy, dz = x[k] - y[j], x[k + 2 * LANES] - y[j + 2 * LANES], x[k + 4 * LANES] - y[j + 4 * LANES]
    return dx * dx + dy * dy + dz * dz > reach


@inner
def _near_within(x: Array, reach: float, ground: float) -> int:
    """How many lanes are near the ground, the next lane or the next but one."""
    near = 0
    for i in range(lanes_of(x, ROWS)):
        apart = (x[(P + 2) * LANES + i] > ground) & _apart(x, x, i, 1, reach) & _apart(x, x, i, 2, reach)
        near += 0 if apart else 1
    return near


@inner
def _near_between(x: Array, y: Array, reach: float) -> int:
    """How many lanes of ``x`` are near one of ``y``."""
    near = 0
    for i in range(lanes_of(x, ROWS)):
        apart = _apart(x, y, i, 0, reach) & _apart(x, y, i, 1, reach)
        near += 0 if apart & _apart(x, y, i, 2, reach) & _apart(x, y, i, 3, reach) else 1
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
def may_touch(model: Model, state: State, k: int, e: int) -> bool:
    """Whether anything may touch in the block's ``k``-th environment ``e``, or might when this was last asked.

    The places have been noted.
    """
    lanes, near, reach = state.lanes[k], 0, agents_reach(model)
    for b in range(lanes.shape[0]):
        near += _near_within(lanes[b], reach, ground_reach(model))
        for a in range(b):
            near += _near_between(lanes[b], lanes[a], reach)
        for m in range(state.target.shape[1]):
            p = (state.target[e, m, 0], state.target[e, m, 1], state.target[e, m, 2])
            near += _near_place(lanes[b], p, target_reach(model, m))
    before = lanes[0, NEAR * LANES]
    lanes[0, NEAR * LANES] = float(near)
    return near > 0 or before > 0.0

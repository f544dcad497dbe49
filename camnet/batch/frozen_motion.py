"""Motion of a target by a learned model that is held: twist from a table, the prior where the model has no answer.

The equations are those of `camnet.estimation.propagate`: harris2020 (3-15), by the midpoint rule.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camnet.batch.compiled import inlined
from camnet.batch.triples import cosine_and_sine
from camnet.estimation.projection import axis_factor
from camnet.estimation.propagate import POSE_LAYER_M
from camnet.estimation.road_prior import RoadMap, turning_rate
from camnet.geometry.pinned import Pins
from camnet.geometry.triples import Triple
from camnet.types import Array, IntArray

__all__ = ["FROZEN", "Frozen", "blended", "frozen_at", "learned", "midpoint"]

_Twist = tuple[float, float, float, float, float, float, float]


class Frozen(NamedTuple):
    """Tables, settings and state; see the module's text. K models, R regions.

    Attributes
    ----------
    table : (K, rows, columns, 8) velocity, angular velocity and support over places
    model_of : (M, R) model of a target in a region
    grid : (3,) x, y of the table's first place and the reciprocal of its spacing
    low, high : (3,) bounds of the tracking space
    k1, k2, switching, layer : feedback
    prior, turn_memory_s, handover_s : remedies of the gap
    period : sensing period, s, and what comes of it in `camnet.batch.frozen`: fading, handover and feedback
    strides : instants of a roll-out that are integrated over at once, and in how many steps
    samples, reset_on_sighting : poses in a fit; whether a new sighting restarts the pose
    roads : that the prior follows
    """

    table: Array
    model_of: IntArray
    grid: Array
    low: Array
    high: Array
    k1: float
    k2: float
    switching: int
    layer: float
    prior: int
    turn_memory_s: float
    handover_s: float
    period: tuple[float, float, float, float]
    strides: tuple[int, int]
    samples: int
    reset_on_sighting: bool
    roads: RoadMap
    pose: Array
    history: Array
    fitted: Array
    held: IntArray
    square: Array
    rates: Array


#: estimators at addresses
FROZEN = Pins(Frozen)
#: estimators at an address, in compiled code
frozen_at = FROZEN.of


@inlined
def learned(f: Frozen, k: int, x: float, y: float) -> _Twist:
    """Velocity (world), angular velocity (body) and support that model ``k`` has learned at a place."""
    u, v = (x - f.grid[0]) * f.grid[2], (y - f.grid[1]) * f.grid[2]
    rows, columns = f.table.shape[1], f.table.shape[2]
    if not (0.0 <= u < columns - 1 and 0.0 <= v < rows - 1):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    low_v, low_u = np.floor(v), np.floor(u)
    i, j, b, a = int(low_v), int(low_u), v - low_v, u - low_u
    c00, c01, c10, c11 = (1.0 - b) * (1.0 - a), (1.0 - b) * a, b * (1.0 - a), b * a
    t = f.table
    return (
        (c00 * t[k, i, j, 0] + c01 * t[k, i, j + 1, 0])
        + (c10 * t[k, i + 1, j, 0] + c11 * t[k, i + 1, j + 1, 0]),
        (c00 * t[k, i, j, 1] + c01 * t[k, i, j + 1, 1])
        + (c10 * t[k, i + 1, j, 1] + c11 * t[k, i + 1, j + 1, 1]),
        (c00 * t[k, i, j, 2] + c01 * t[k, i, j + 1, 2])
        + (c10 * t[k, i + 1, j, 2] + c11 * t[k, i + 1, j + 1, 2]),
        (c00 * t[k, i, j, 3] + c01 * t[k, i, j + 1, 3])
        + (c10 * t[k, i + 1, j, 3] + c11 * t[k, i + 1, j + 1, 3]),
        (c00 * t[k, i, j, 4] + c01 * t[k, i, j + 1, 4])
        + (c10 * t[k, i + 1, j, 4] + c11 * t[k, i + 1, j + 1, 4]),
        (c00 * t[k, i, j, 5] + c01 * t[k, i, j + 1, 5])
        + (c10 * t[k, i + 1, j, 5] + c11 * t[k, i + 1, j + 1, 5]),
        (c00 * t[k, i, j, 6] + c01 * t[k, i, j + 1, 6])
        + (c10 * t[k, i + 1, j, 6] + c11 * t[k, i + 1, j + 1, 6]),
    )


@inlined
def blended(model: _Twist, v: Triple, w: Triple, use_prior: bool) -> tuple[Triple, Triple, float]:
    """Twist with the prior mean where the model does not answer, and the support u in [0, 1]."""
    support = min(1.0, max(0.0, model[6]))
    rest = 1.0 - support if use_prior else 0.0
    return (
        (model[0] + rest * v[0], model[1] + rest * v[1], model[2] + rest * v[2]),
        (model[3] + rest * w[0], model[4] + rest * w[1], model[5] + rest * w[2]),
        support,
    )


@inlined
def _moved(f: Frozen, p: Triple, v: Triple, dt: float) -> Triple:
    """Position after ``dt``, projected onto the tracking bounds."""
    low, high = f.low, f.high
    if low[0] <= p[0] <= high[0] and low[1] <= p[1] <= high[1] and low[2] <= p[2] <= high[2]:
        return p[0] + dt * v[0], p[1] + dt * v[1], p[2] + dt * v[2]
    return (
        p[0] + dt * v[0] * axis_factor(p[0], v[0], f.low[0], f.high[0], POSE_LAYER_M),
        p[1] + dt * v[1] * axis_factor(p[1], v[1], f.low[1], f.high[1], POSE_LAYER_M),
        p[2] + dt * v[2] * axis_factor(p[2], v[2], f.low[2], f.high[2], POSE_LAYER_M),
    )


@inlined
def _turned(v: Triple, angle: float) -> Triple:
    """Velocity turned about the vertical."""
    c, s = cosine_and_sine(angle)
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


@inlined
def _nearer(x: Triple, share: float, goal: Triple) -> Triple:
    """Come from ``x`` the ``share`` of the way to the goal."""
    return (
        x[0] + share * (goal[0] - x[0]),
        x[1] + share * (goal[1] - x[1]),
        x[2] + share * (goal[2] - x[2]),
    )


@inlined
def midpoint(
    f: Frozen, k: int, p: Triple, pv: Triple, pw: Triple, dt: float, fade: float, share: float, offset: float
) -> tuple[Triple, Triple, Triple, Triple, Triple]:
    """One midpoint step: position, twist (v, w) on the way, prior (v, w) after it.

    ``fade`` is what is left of the prior's turn after half of ``dt``, ``share`` how far the prior follows the learned
    motion, ``offset`` the way along a road. The prior turns and fades by half, follows the learned motion, then does
    the other half (Strang 1968), so that it is of second order as the position is. Up to the middle it turns at the
    rate it came with, from which a road's rate differs by a step's change.
    """
    v, w, support = blended(learned(f, k, p[0], p[1]), pv, pw, f.prior > 0)
    middle, b, turns = _moved(f, p, v, 0.5 * dt), 0.5 * support * share, f.prior == 2
    left, half = (fade, 0.5 * dt) if turns else (1.0, 0.0)
    mw = _nearer((left * pw[0], left * pw[1], left * pw[2]), b, w)
    mv = _nearer(_turned(pv, half * pw[2]), b, v)
    on_road, rate = turning_rate(middle[0], middle[1], mv[0], mv[1], offset, f.roads)
    if on_road:
        mw = pw = (0.0, 0.0, rate)
    v, w, support = blended(learned(f, k, middle[0], middle[1]), mv, mw, f.prior > 0)
    b = support * share * (1.0 + 0.5 * (1.0 - support) * share)  # 1 - (1 - share)^support
    pv = _turned(_nearer(_turned(pv, half * mw[2]), b, v), half * mw[2])
    pw = _nearer((left * pw[0], left * pw[1], left * pw[2]), b, w)
    return _moved(f, p, v, dt), v, w, pv, (left * pw[0], left * pw[1], left * pw[2])

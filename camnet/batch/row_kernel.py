"""One instant of sensing in one compiled call: who sees whom, what is measured, what the estimators make of it.

    truth -> visibility -> noise -> nearest measurement of each target, in the world -> correct or predict -> estimate

The parts are those of `camnet.sensing.survey`, `camnet.sensing.pose_sensor` and `camnet.batch.estimator`; in
`camnet.simulation.loop` they stand one after the other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from camnet.batch.compiled import inner
from camnet.batch.estimator import (
    EstimatorSetup,
    EstimatorState,
    correct_lent,
    estimate_lent,
    predict_lent,
    reset_lent,
    rollout_lent,
)
from camnet.batch.estimator_columns import REGION, TWIST, P, T
from camnet.geometry.pinned import Pins
from camnet.geometry.triples import borrowing, multiply, quaternion, rotate
from camnet.sensing.pose_sensor import frame_at, measure_frame
from camnet.sensing.survey import facts_at, survey_truth
from camnet.types import Array, BoolArray, IntArray

__all__ = [
    "BANK",
    "CAMERA",
    "ERROR",
    "MISS",
    "OFFERED",
    "TURN",
    "Bank",
    "advance_row",
    "perceive",
    "rollout_row",
]

#: columns of ``found``: camera that measured (-1: none), whether a window was offered to a stack, distance from the
#: prediction to the truth before, error of the estimate, m, and of its orientation, rad, after
CAMERA, OFFERED, MISS, ERROR, TURN = range(5)
#: column of ``out`` behind an estimate's: region last seen in
REGION_COLUMN = 16


class Bank(NamedTuple):
    """Estimators of M targets, one row each, and what they are fed with.

    | field | shape | what |
    | --- | --- | --- |
    | ``seers`` | (2,) | addresses for `survey_truth` and for `measure_frame` |
    | ``world`` | (M,7) | measured poses in the world: p, m, and q, body to world |
    | ``found`` | (M,5) | columns CAMERA ... TURN |
    | ``out`` | (M,17) | estimates (m, rad, s; world frame) as in `camnet.batch.estimator.ESTIMATE`, and the region |
    """

    setup: EstimatorSetup
    rows: EstimatorState
    seers: IntArray
    world: Array
    found: Array
    out: Array


BANK = Pins(Bank)
_bank = BANK.of


@inner
def _take(x: Bank, m: int, count: int, camera_p: Array, camera_q: Array) -> None:
    """Bring the nearest of the measurements of target ``m`` into the world."""
    frame = frame_at(x.seers[1])
    pairs, poses, best, least = frame.pairs, frame.out, -1, math.inf
    for i in range(count):
        if pairs[i, 1] == m:
            square = poses[i, 0] ** 2 + poses[i, 1] ** 2 + poses[i, 2] ** 2
            if square < least:
                best, least = i, square
    x.found[m, CAMERA] = -1.0
    if best < 0:
        return
    c = pairs[best, 0]
    x.found[m, CAMERA] = c
    q = quaternion(camera_q, c, 0)
    p = rotate(q, (poses[best, 0], poses[best, 1], poses[best, 2]))
    full = multiply(q, quaternion(poses, best, 3))
    norm = 1.0 / math.sqrt(full[0] ** 2 + full[1] ** 2 + full[2] ** 2 + full[3] ** 2)
    for i in range(3):
        x.world[m, i] = camera_p[c, i] + p[i]
    for i in range(4):
        x.world[m, 3 + i] = norm * full[i]


@inner
def _advance(x: Bank, m: int, t_s: float) -> None:
    """Advance row ``m`` to ``t_s``, with the measurement of the camera that ``found`` names."""
    camera, offered = int(x.found[m, CAMERA]), False
    if camera < 0:
        predict_lent(x.setup, x.rows, m, t_s)
    else:
        offered = correct_lent(x.setup, x.rows, m, t_s, x.world[m, 0:3], x.world[m, 3:7], camera)
    x.found[m, OFFERED] = 1.0 if offered else 0.0
    x.out[m, REGION_COLUMN] = float(estimate_lent(x.setup, x.rows, m, x.out[m]))


@inner
def _miss(x: Bank, m: int, t_s: float, target_p: Array) -> float:
    """Distance of the truth from what was believed, carried to now along its velocity, m."""
    pose, square = x.rows.pose[m], 0.0
    for i in range(3):
        predicted = pose[P + i] + (t_s - pose[T]) * pose[TWIST + i]
        square += (predicted - target_p[m, i]) ** 2
    return math.sqrt(square)


@inner
def _compare(x: Bank, m: int, target_p: Array, target_q: Array) -> None:
    """Note the errors of the estimate."""
    square = 0.0
    for i in range(3):
        square += (x.out[m, i] - target_p[m, i]) ** 2
    a, b = quaternion(x.out, m, 3), quaternion(target_q, m, 0)
    off = multiply((a[0], -a[1], -a[2], -a[3]), b)
    x.found[m, ERROR] = math.sqrt(square)
    sine = math.sqrt(off[1] * off[1] + off[2] * off[2] + off[3] * off[3])
    x.found[m, TURN] = 2.0 * math.atan2(sine, abs(off[0]))


@borrowing
def perceive(
    at: int,
    t_s: float,
    agent_p: Array,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    exceptions: BoolArray,
    working: BoolArray,
) -> float:
    """Look at the truth at ``t_s``, measure, and advance all estimators; the least distance between two agents, m."""
    x = _bank(at)
    spacing = survey_truth(x.seers[0], agent_p, camera_p, camera_q, target_p, target_q, exceptions, working)
    count = measure_frame(x.seers[1], facts_at(x.seers[0]).visible, camera_p, camera_q, target_p, target_q)
    for m in range(target_p.shape[0]):
        _take(x, m, count, camera_p, camera_q)
        x.found[m, MISS] = _miss(x, m, t_s, target_p) if x.found[m, CAMERA] >= 0.0 else 0.0
        _advance(x, m, t_s)
        _compare(x, m, target_p, target_q)
    return spacing


@borrowing
def advance_row(at: int, m: int, t_s: float) -> None:
    """Advance row ``m`` alone, with the measurement in ``world`` if ``found`` names a camera."""
    _advance(_bank(at), m, t_s)


@borrowing
def reset_row(at: int, m: int) -> None:
    """Make row ``m`` as new."""
    x = _bank(at)
    reset_lent(x.setup, x.rows, m)
    x.found[m, CAMERA] = -1.0
    _advance(x, m, -math.inf)


@borrowing
def rollout_row(at: int, m: int, dt_s: float, out: Array) -> bool:
    """Write the future of row ``m`` to ``out``, as `camnet.batch.estimator.rollout` does; whether it was ever seen."""
    x = _bank(at)
    rollout_lent(x.setup, x.rows, m, dt_s, out)
    return bool(x.rows.flags[m, REGION] >= 0)

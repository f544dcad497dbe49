"""Flight of four agents at a time: `camnet.batch.body.fly` with a lane of a vector register for each.

Every stage of a period is a loop over the lanes of a workspace (`camnet.batch.lane_layout`) without a branch, which the
compiler turns into vector instructions. What is constant is a tuple: an array could be the workspace itself, for all
the compiler knows, and would have to be read again after every store.

Turns of more than `SMALL` in half a physics step, and gimbals as fast as that, have no place here: where an agent
might come to turn so, `fly_lanes` leaves its workspace as it is, and the agents in it fly one by one.
"""

from __future__ import annotations

import math

from camnet.batch.body import aim_thrust, lag_rotor, push, shifted, spun, spun_up
from camnet.batch.compiled import inlined, inner
from camnet.batch.gimbal import Constants, between, camera_at, gimbal_goals, joint, turned
from camnet.batch.lane_layout import (
    AFTER,
    AXIS,
    AXIS_RATE,
    BEFORE,
    CAMERA,
    CIRCLES,
    GAIN,
    GOALS,
    HEADING,
    INTEGRAL,
    JOINTS,
    LANES,
    LOOK,
    RATES,
    ROTORS,
    ROWS,
    SQUARES,
    TORQUE,
    WILD,
    WIND,
    A,
    P,
    Q,
    U,
    V,
    W,
    get,
    get_four,
    get_pair,
    lanes_of,
    orientation,
    put,
    put_four,
)
from camnet.batch.triples import SMALL, circle, small_circle, small_turn
from camnet.geometry.triples import Triple, rotate, rotate_inverse
from camnet.types import Array

__all__ = ["calm_rate", "carry_cameras", "fly_lanes", "note_joints"]

#: physics steps of the rotors that are done together
_STEPS = 4


@inlined
def _constants(c: Array) -> Constants:
    first = (c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12], c[13])
    return (*first, c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21], c[22], c[23], c[24], c[25], c[26])


@inlined
def _aim(x: Array, c: Constants) -> None:
    """Ask the rotors for the speeds that make thrust and torque; note the joints' places."""
    for i in range(LANES):
        heading = get_pair(x, HEADING, i)
        goals, rate, integral, axis, axis_rate = aim_thrust(
            orientation(x, i),
            get(x, V, i),
            get(x, W, i),
            get(x, U, i),
            get(x, A, i),
            heading,
            get(x, INTEGRAL, i),
            get(x, AXIS, i),
            get(x, AXIS_RATE, i),
            c,
        )
        put_four(x, GOALS, i, goals)
        put_four(x, SQUARES, i, (0.0, 0.0, 0.0, 0.0))
        put(x, BEFORE, i, rate)
        put(x, AFTER, i, rate)
        put(x, INTEGRAL, i, integral)
        put(x, AXIS, i, axis)
        put(x, AXIS_RATE, i, axis_rate)


@inner
def note_joints(x: Array) -> None:
    """Work out cosines and sines of the joints, of agents that have just been loaded."""
    for i in range(LANES):
        angles = get(x, JOINTS, i)
        a, b, d = circle(angles[0]), circle(angles[1]), circle(angles[2])
        put(x, CIRCLES, i, (a[0], b[0], d[0]))
        put(x, CIRCLES + 3, i, (a[1], b[1], d[1]))


@inlined
def _spin_rotor(x: Array, k: int, lane: int, steps: int, c: Constants) -> None:
    """One rotor for so many physics steps, four at most."""
    goal, speed = x[(GOALS + k) * LANES + lane], x[(ROTORS + k) * LANES + lane]
    total = x[(SQUARES + k) * LANES + lane]
    for j in range(_STEPS):
        after = lag_rotor(goal, speed, c)
        speed = after if j < steps else speed
        total += after * after if j < steps else 0.0
    x[(ROTORS + k) * LANES + lane], x[(SQUARES + k) * LANES + lane] = speed, total


@inlined
def _spin_rotors(x: Array, steps: int, c: Constants) -> None:
    """All rotors for so many physics steps, four at most."""
    for i in range(LANES):
        _spin_rotor(x, 0, i, steps, c)
        _spin_rotor(x, 1, i, steps, c)
        _spin_rotor(x, 2, i, steps, c)
        _spin_rotor(x, 3, i, steps, c)


@inlined
def _push(x: Array, c: Constants) -> None:
    """Gains of velocity in a physics step, and torques on the bodies."""
    for i in range(LANES):
        gain, torque = push(orientation(x, i), get(x, V, i), get(x, WIND, i), get_four(x, SQUARES, i), c)
        put(x, GAIN, i, gain)
        put(x, TORQUE, i, torque)


@inlined
def _move(x: Array, dt: float, c: Constants) -> None:
    """One physics step of the bodies."""
    for i in range(LANES):
        p, v = shifted(get(x, P, i), get(x, V, i), get(x, GAIN, i), dt)
        torque = get(x, TORQUE, i)
        w = spun_up(get(x, AFTER, i), torque, dt, c)
        by = small_turn(dt * w[0], dt * w[1], dt * w[2])
        q = spun(orientation(x, i), by)
        put(x, P, i, p)
        put_four(x, Q, i, (q[1], q[2], q[3], q[0]))
        put(x, V, i, v)
        put(x, AFTER, i, w)
        put(x, TORQUE, i, rotate_inverse(by, torque))


@inlined
def _note_rates(x: Array) -> None:
    """Angular velocities of the bodies in the world after the period."""
    for i in range(lanes_of(x, ROWS)):
        put(x, W, i, rotate(orientation(x, i), get(x, AFTER, i)))


@inlined
def _turn_gimbals(x: Array, share: float, c: Constants) -> None:
    """Move the gimbals for a physics step, ``share`` of the period gone by."""
    for i in range(LANES):
        w = between(get(x, BEFORE, i), get(x, AFTER, i), share)
        cosines, sines = get(x, CIRCLES, i), get(x, CIRCLES + 3, i)
        yaw, pan, tilt = (cosines[0], sines[0]), (cosines[1], sines[1]), (cosines[2], sines[2])
        goals = gimbal_goals(yaw, pan, tilt, get(x, LOOK, i), w)
        old, rates = get(x, JOINTS, i), get(x, RATES, i)
        a, a_rate = joint(old[0], rates[0], goals[0], c)
        b, b_rate = joint(old[1], rates[1], goals[1], c)
        d, d_rate = joint(old[2], rates[2], goals[2], c)
        b_rate = 0.0 if abs(b) > c[22] else b_rate
        b = min(max(b, -c[22]), c[22])
        yaw = turned(yaw, small_circle(a - old[0]))
        pan = turned(pan, small_circle(b - old[1]))
        tilt = turned(tilt, small_circle(d - old[2]))
        put(x, JOINTS, i, (a, b, d))
        put(x, RATES, i, (a_rate, b_rate, d_rate))
        put(x, CIRCLES, i, (yaw[0], pan[0], tilt[0]))
        put(x, CIRCLES + 3, i, (yaw[1], pan[1], tilt[1]))


@inlined
def _carry_cameras(x: Array, offset: Triple) -> None:
    """Put the cameras where the bodies and gimbals are."""
    for i in range(LANES):
        p, q, v, w = camera_at(
            get(x, P, i),
            orientation(x, i),
            get(x, V, i),
            get(x, W, i),
            get(x, JOINTS, i),
            get(x, RATES, i),
            offset,
        )
        put(x, CAMERA, i, p)
        put_four(x, CAMERA + 3, i, q)
        put(x, CAMERA + 7, i, v)
        put(x, CAMERA + 10, i, w)


@inner
def carry_cameras(lanes: Array, count: int, offset: Array) -> None:
    """Put the cameras, ``offset`` (3,) from the bodies' middles, where bodies and gimbals are."""
    arm = (offset[0], offset[1], offset[2])
    for k in range(count):
        for b in range(lanes.shape[1]):
            _carry_cameras(lanes[k, b], arm)


@inlined
def calm_rate(duration: float, dt: float, c: Constants) -> float:
    """Angular velocity, rad/s, up to which no turn can come to be too fast within ``duration``.

    Whatever the rotors do and whatever way the torque turns in the body: as long as the size w of the angular velocity
    is at most w_most = 2 SMALL / dt,

        dw/dt <= |tau| / min(J) + |J^-1 (w x J w)| <= |tau|_most / min(J) + |(dJ / J)| w_most^2 / 2

    where dJ / J are the differences of two moments of inertia over the third (Euler's equations). ``duration`` and the
    physics step ``dt`` in s, ``c`` as in `camnet.batch.body`. Negative if there is no such rate.
    """
    jx, jy, jz, speeds, most = c[2], c[3], c[4], 2.0 * c[8] * c[8], 2.0 * SMALL / dt
    lever, yaw = c[5] * c[6] * speeds, c[7] * speeds
    x, y, z = (jz - jy) / jx, (jx - jz) / jy, (jy - jx) / jz
    push = math.sqrt(2.0 * lever * lever + yaw * yaw) / min(jx, jy, jz)
    return most - duration * (push + 0.5 * most * most * math.sqrt(x * x + y * y + z * z))


@inlined
def _wild(x: Array, calm: float) -> int:
    """How many lanes turn faster than ``calm`` allows, the square of an angular velocity; what is no number does."""
    wild = 0
    for i in range(lanes_of(x, ROWS)):
        w = get(x, W, i)
        wild += 0 if w[0] * w[0] + w[1] * w[1] + w[2] * w[2] <= calm else 1
    return wild


@inner
def fly_lanes(lanes: Array, count: int, periods: int, constants: Array) -> int:
    """Fly the first ``count`` environments' workspaces for so many periods of the inner loop.

    The workspaces ``lanes`` (count or more, B, 4 ROWS) change in place; what is commanded is in them. Together they are
    flown in one loop, before which what depends on ``constants`` alone is worked out.

    Returns
    -------
    int
        How many were left as they were because one of their agents might turn too fast: those with ``WILD`` 1.
    """
    c, wild = _constants(constants), 0
    substeps = int(c[26])
    dt = c[0] / substeps
    calm = calm_rate(periods * c[0], dt, c)
    calm = calm * calm if calm > 0.0 and dt * c[20] <= SMALL else -1.0
    for k in range(count):
        for b in range(lanes.shape[1]):
            x = lanes[k, b]
            if _wild(x, calm) == 0:
                x[WILD * LANES] = 0.0
                for _ in range(periods):
                    _fly_period(x, substeps, dt, c)
            else:
                x[WILD * LANES] = 1.0
                wild += 1
    return wild


@inlined
def _fly_period(x: Array, substeps: int, dt: float, c: Constants) -> None:
    _aim(x, c)
    for k in range(0, substeps, _STEPS):
        _spin_rotors(x, substeps - k, c)
    _push(x, c)
    for _ in range(substeps):
        _move(x, dt, c)
    _note_rates(x)
    for k in range(substeps):
        _turn_gimbals(x, (k + 0.5) / substeps, c)

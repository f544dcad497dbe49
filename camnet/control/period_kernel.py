"""A control period of all agents between two calls of the physics engine, compiled into one call.

What stands in a row here are compiled functions with oracles of their own; `camnet.simulation.loop` does the same one
object at a time. The arrays stay the same from period to period and are pinned (`camnet.geometry.pinned`).
"""

from __future__ import annotations

from typing import NamedTuple

from camnet.control.flight_kernel import begin_period, end_period
from camnet.control.monitor_kernel import record_end, record_start
from camnet.control.reference_kernel import move_all
from camnet.control.sliding_mode_kernel import command_all
from camnet.geometry.pinned import Pins
from camnet.geometry.triples import borrowing
from camnet.types import Array, IntArray

__all__ = ["COCKPIT", "Cockpit", "begin_flight", "continue_flight"]


class Cockpit(NamedTuple):
    """What N agents fly with.

    | array | row | as in |
    | --- | --- | --- |
    | ``rows`` (N,20) | reference: p, v, a, gaze and its rate, orientation, angular velocity | `reference_kernel` |
    | ``bodies``, ``memory``, ``held``, ``constants`` | rigid body, rotors and gimbal, command | `quadrotor_kernel` |
    | ``before`` | as the engine got ``bodies`` for the last run of the inner loop | `flight_kernel.end_period` |
    | ``motion`` (N+C,13) | p, q, v, w of the bodies, of their cameras, of the fixed ones | `flight_kernel.end_period` |
    | ``truth``, ``command``, ``error``, ``reference`` (K,N,.) | periods for the monitor | `monitor_kernel` |
    | ``asked`` (4,N,3), written | command and errors | `sliding_mode_kernel.command_all` |
    | ``balls`` (M,5), ``radius``, ``reach`` | what else moves | `camera_kernel.may_touch` |
    | ``wind`` (N,3) | of the period, m/s | `quadrotor_kernel.hold_command` |
    """

    rows: Array
    goals: Array
    looks: Array
    planes: Array
    plane_ends: IntArray
    discs: Array
    polygons: Array
    polygon_ends: IntArray
    margin: float
    limits: Array
    gaze_limits: Array
    dt_s: float
    yaw: Array
    gains: Array
    code: int
    truth: Array
    command: Array
    error: Array
    reference: Array
    bodies: Array
    before: Array
    memory: Array
    held: Array
    constants: Array
    wrench: Array
    asked: Array
    motion: Array
    balls: Array
    wind: Array
    radius: float
    reach: float
    offset_body: Array
    fixed: Array
    start_p: Array
    range_m: float
    speed_mps: float


COCKPIT = Pins(Cockpit)
_cockpit = COCKPIT.of


@borrowing
def begin_flight(at: int, k: int, targets: Array) -> int:
    """Command the period from the cameras' motion, run the inner loop for its first time, move the references on.

    ``k`` is the monitor's period, ``targets`` (M,13) are p, q, v, w of the targets now. Returns 1: something may touch,
    0: not, -1: the command is not finite.
    """
    x = _cockpit(at)
    command_all(x.motion, x.rows.shape[0], x.rows, x.gains, x.code, x.asked)
    record_start(k, x.truth, x.command, x.error, x.reference, x.motion, x.asked, x.rows)
    for m in range(x.balls.shape[0]):
        for i in range(3):
            x.balls[m, i] = targets[m, i]
    found = begin_period(
        x.bodies,
        x.memory,
        x.held,
        x.constants,
        x.asked[0],
        x.asked[1],
        x.rows[:, 6:9],
        x.wind,
        x.wrench,
        x.radius,
        x.balls,
        x.reach,
        x.dt_s,
    )
    move_all(
        x.rows,
        x.goals,
        x.looks,
        x.planes,
        x.plane_ends,
        x.discs,
        x.polygons,
        x.polygon_ends,
        x.margin,
        x.limits,
        x.gaze_limits,
        x.dt_s,
        x.yaw,
    )
    return found


@borrowing
def continue_flight(at: int, k: int) -> tuple[int, float]:
    """End the period; first unsound body (-1: none) and the sum of the bodies' squared speeds, m^2/s^2.

    ``bodies`` are as the engine left them.
    """
    x = _cockpit(at)
    unsound = end_period(
        x.before,
        x.bodies,
        x.memory,
        x.held,
        x.constants,
        x.offset_body,
        x.fixed,
        x.start_p,
        x.range_m,
        x.speed_mps,
        x.motion,
    )
    record_end(k, x.truth, x.motion)
    square = 0.0
    for i in range(x.bodies.shape[0]):
        for j in range(7, 10):
            square += x.motion[i, j] * x.motion[i, j]
    return unsound, square

"""A control period of all agents between two calls of the physics engine, compiled into one call.

What stands in a row here are compiled functions with oracles of their own; `camnet.simulation.loop` does the same one
object at a time. Rows of N agents:

| array | row | as in |
| --- | --- | --- |
| ``rows`` (N,20) | reference: p, v, a, gaze and its rate, orientation, angular velocity | `reference_kernel.move_all` |
| ``bodies``, ``memory``, ``held``, ``constants`` | rigid body, rotors and gimbal, command | `quadrotor_kernel` |
| ``motion`` (N+C,13) | p, q, v, w of the bodies, of their cameras, of the fixed ones | `flight_kernel.end_period` |
| ``truth``, ``command``, ``error``, ``reference`` (K,N,.) | periods for the monitor | `monitor_kernel.run_periods` |
| ``asked`` (4,N,3), written | command and errors | `sliding_mode_kernel.command_all` |
| ``balls`` (M,5) | what else moves | `camera_kernel.may_touch` |
"""

from __future__ import annotations

from camnet.control.flight_kernel import begin_period, end_period
from camnet.control.monitor_kernel import record_end, record_start
from camnet.control.reference_kernel import move_all
from camnet.control.sliding_mode_kernel import command_all
from camnet.geometry.triples import borrowing
from camnet.types import Array, IntArray

__all__ = ["begin_flight", "continue_flight"]


@borrowing
def begin_flight(
    k: int,
    rows: Array,
    goals: Array,
    looks: Array,
    planes: Array,
    plane_ends: IntArray,
    discs: Array,
    polygons: Array,
    polygon_ends: IntArray,
    margin: float,
    limits: Array,
    gaze_limits: Array,
    dt: float,
    yaw: Array,
    gains: Array,
    code: int,
    truth: Array,
    command: Array,
    error: Array,
    reference: Array,
    bodies: Array,
    memory: Array,
    held: Array,
    constants: Array,
    wrench: Array,
    asked: Array,
    motion: Array,
    balls: Array,
    targets: Array,
    wind: Array,
    radius: float,
    reach: float,
) -> int:
    """Command the period from the cameras' motion, run the inner loop for its first time, move the references on.

    ``k`` is the monitor's period, ``targets`` (M,13) are p, q, v, w of the targets now, ``wind`` (N,3) holds for the
    period. Returns 1: something may touch, 0: not, -1: the command is not finite.
    """
    command_all(motion, rows.shape[0], rows, gains, code, asked)
    record_start(k, truth, command, error, reference, motion, asked, rows)
    for m in range(balls.shape[0]):
        balls[m, 0], balls[m, 1], balls[m, 2] = targets[m, 0], targets[m, 1], targets[m, 2]
    found = begin_period(
        bodies,
        memory,
        held,
        constants,
        asked[0],
        asked[1],
        rows[:, 6:9],
        wind,
        wrench,
        radius,
        balls,
        reach,
        dt,
    )
    move_all(
        rows,
        goals,
        looks,
        planes,
        plane_ends,
        discs,
        polygons,
        polygon_ends,
        margin,
        limits,
        gaze_limits,
        dt,
        yaw,
    )
    return found


@borrowing
def continue_flight(
    k: int,
    truth: Array,
    bodies: Array,
    before: Array,
    memory: Array,
    held: Array,
    constants: Array,
    motion: Array,
    offset_body: Array,
    fixed: Array,
    start_p: Array,
    range_m: float,
    speed_mps: float,
) -> tuple[int, float]:
    """End the period; first unsound body (-1: none) and the sum of the bodies' squared speeds, m^2/s^2.

    ``bodies`` are as the engine left them, ``before`` as it got them for the last run of the inner loop.
    """
    n = bodies.shape[0]
    unsound = end_period(
        before, bodies, memory, held, constants, offset_body, fixed, start_p, range_m, speed_mps, motion
    )
    record_end(k, truth, motion)
    square = 0.0
    for i in range(n):
        for j in range(7, 10):
            square += motion[i, j] * motion[i, j]
    return unsound, square

"""What a control period of all quadrotors needs before and after the engine, each in one compiled call.

Arrays are packed as in `camnet.control.quadrotor_kernel`. The parts are compiled functions with oracles of their own:
here they only stand in a row, because a call from Python costs more than most of them do.
"""

from __future__ import annotations

from camnet.control.camera_kernel import first_unsound, may_touch, write_bodies, write_cameras
from camnet.control.quadrotor_kernel import hold_command, step_packed, turn_gimbals
from camnet.geometry.triples import borrowing
from camnet.types import Array

__all__ = ["INVALID", "begin_period", "end_period"]

#: `begin_period` was given a command that is not finite
INVALID = -1


@borrowing
def begin_period(
    bodies: Array,
    memory: Array,
    held: Array,
    constants: Array,
    v_world: Array,
    w_cam: Array,
    a_world: Array,
    wind: Array,
    wrench: Array,
    radius: float,
    balls: Array,
    reach: float,
    control_dt: float,
) -> int:
    """Hold a command and run the inner loop for its first time; 1: something may touch, 0: not, -1: `INVALID`.

    ``radius``, ``balls`` (M,5), ``reach``: see `camnet.control.camera_kernel.may_touch`.
    """
    if not hold_command(held, v_world, w_cam, a_world, wind):
        return INVALID
    touching = may_touch(bodies, radius, balls, reach, control_dt)
    step_packed(bodies, memory, held, constants, wrench)
    return 1 if touching else 0


@borrowing
def end_period(
    before: Array,
    bodies: Array,
    memory: Array,
    held: Array,
    constants: Array,
    offset_body: Array,
    fixed: Array,
    start_p: Array,
    range_m: float,
    speed_mps: float,
    out: Array,
) -> int:
    """Turn the gimbals after the last run of the inner loop; first unsound body (-1: none).

    ``out`` (N+C,13) receives N bodies as in `write_bodies`, their N cameras as in `write_cameras`, ``fixed`` (C-N,13).
    """
    n = bodies.shape[0]
    turn_gimbals(before, bodies, memory, held, constants)
    write_bodies(bodies, out)
    write_cameras(bodies, memory, offset_body, out, n)
    for row in range(fixed.shape[0]):
        for i in range(13):
            out[2 * n + row, i] = fixed[row, i]
    return first_unsound(bodies, start_p, range_m, speed_mps)

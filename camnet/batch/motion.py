"""Targets of many environments: the motions of `camnet.motion`, one step of one target at a time, in arrays.

Every kind of motion is packed into `Targets`; `step_target` is what `TargetMotion.step` is there. A target at rest in
an array is pose and velocity ``now`` (13,): p, q, v (world frame), w (body frame), and ``inner`` (8,): what the class
calls ``internal``.
"""

from __future__ import annotations

from camnet.batch.compiled import outer
from camnet.batch.random import Streams
from camnet.batch.target_field import step_field
from camnet.batch.target_laws import PLANNED_ROAD, ROAD, TRACK, WAVE, Targets, pack_targets
from camnet.batch.target_planned import step_planned_field, step_planned_road
from camnet.batch.target_road import step_road
from camnet.batch.target_track import step_track
from camnet.types import Array

__all__ = ["Targets", "pack_targets", "step_target"]


@outer
def step_target(
    t: Targets,
    m: int,
    now: Array,
    inner: Array,
    e: int,
    t_s: float,
    dt: float,
    streams: Streams,
    row: int,
    plan: Array,
) -> None:
    """Advance target ``m`` of environment ``e`` from ``t_s`` by ``dt``, in place.

    It draws from one stream, or does what its ``plan`` (`camnet.batch.target_planned`) says.
    """
    kind = t.kind[m]
    if kind <= WAVE:
        step_field(t, m, now, inner, e, dt)
    elif kind == ROAD:
        step_road(t, m, now, inner, e, dt, streams, row)
    elif kind == TRACK:
        step_track(t, m, now, inner, e, t_s, dt)
    elif kind == PLANNED_ROAD:
        step_planned_road(t, m, now, inner, e, t_s, dt, plan)
    else:
        step_planned_field(t, m, now, inner, e, t_s, dt, plan)

"""Compiled twin of `camnet.agents.learned.Learned.readable` (its test oracle), for regions that are boxes or cylinders.

| symbol | meaning | ``facts`` |
| --- | --- | --- |
| c, h | region: centre and half-size, m | 0-2, 3-5 |
| a | how far from c a setpoint may lie along each axis, m | 6-8 |
| lo, hi | the region's box less the margin, m | 9-11, 12-14 |
| x, y, r | disc of a cylinder less the margin, m (r = 0: none) | 15-17 |
| sin psi | of ``image_fill`` of the half-angle | 18 |
| | least height, near, far, extent of the target, m | 19-22 |
| k_p | gain of the references' position, 1/s | 23 |
| v_ref | half their top speed, m/s | 24 |
| | largest gaze of the controller, gaze of an action of 1, rad | 25, 26 |
| | width that error radii are divided by, m; look-ahead, s | 27, 28 |
| | where the agent loiters, m | 29-31 |
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.agents.policy import AgentContext
from camnet.compiled import cached_njit
from camnet.control.setpoints import (
    CLIMB_MPS,
    LEAD_S,
    LEAST_SPEED_MPS,
    PUNCTUAL,
    REPOSE_S,
    half_angle,
    loiter,
)
from camnet.geometry.regions import BoxRegion, CylinderRegion
from camnet.types import Array, IntArray

__all__ = ["FIELDS", "act", "pack_facts"]

#: fields of one target that the rule reads, in the layout's names; the columns of ``first`` (M, 11) are theirs
FIELDS = (
    "seen_by_me",
    "seen",
    "inside",
    "radius",
    "coming",
    "entry_radius",
    "entry_time",
    "position",
    "velocity",
    "entry_position",
    "entry_velocity",
)
_MINE, _SEEN, _INSIDE, _RADIUS, _COMING, _ENTRY_RADIUS, _ENTRY_TIME, _P, _V, _ENTRY_P, _ENTRY_V = range(11)

Triple = tuple[float, float, float]


def pack_facts(context: AgentContext) -> Array | None:
    """Return ``facts`` (32,) of an agent; None where the compiled rule cannot stand in for the readable one."""
    region, camera, s = context.region, context.camera, context.controller
    if context.viewpoints is not None or not isinstance(region, BoxRegion | CylinderRegion):
        return None
    margin, (low, high) = s.region_margin_m, region.bounds
    round_ = isinstance(region, CylinderRegion)
    disc = [*region.center[:2], region.radius_m - margin] if isinstance(region, CylinderRegion) else [0.0] * 3
    reach = np.maximum(context.half_size - margin, 1e-6)
    edge = np.array([math.inf, math.inf, 0.0]) if round_ else np.zeros(3)
    facts = [*context.center, *context.half_size, *reach]
    facts += [*(low + margin - edge), *(high - margin + edge), *disc]
    facts += [math.sin(max(s.image_fill, 1e-3) * half_angle(camera)), s.min_height_m, camera.near_m]
    facts += [camera.far_m, s.target_extent_m, s.reference_position_gain_per_s, 0.5 * s.reference_v_max_mps]
    facts += [s.gaze_max_rad, context.gaze_max_rad, context.width_m, context.lookahead_s]
    return np.array([*facts, *loiter(region, camera, s).p_world])


@cached_njit
def _world(o: NDArray[np.float32], i: int, f: Array) -> Triple:
    return (
        f[0] + np.float64(o[i]) * f[3],
        f[1] + np.float64(o[i + 1]) * f[4],
        f[2] + np.float64(o[i + 2]) * f[5],
    )


@cached_njit
def _above(p: Triple, height: float, f: Array) -> Triple:
    """Nearest admissible point to one ``height`` above ``p``."""
    x, y, z = p[0], p[1], p[2] + height
    if f[17] > 0.0:
        dx, dy = x - f[15], y - f[16]
        d = math.sqrt(dx * dx + dy * dy)
        if d > f[17]:
            x, y = f[15] + f[17] * dx / d, f[16] + f[17] * dy / d
    return min(max(x, f[9]), f[12]), min(max(y, f[10]), f[13]), min(max(z, f[11]), f[14])


@cached_njit
def _height(radius: float, f: Array) -> float:
    highest = max(f[21] - radius, f[19])
    return float(min(max(radius / f[18], f[19], f[20] + radius), highest))


@cached_njit
def _look(p: Triple, at: Triple, f: Array) -> tuple[float, float]:
    down = max(-(at[2] - p[2]), 0.0)
    pan, tilt = math.atan2(at[0] - p[0], down), math.atan2(at[1] - p[1], down)
    return min(max(pan, -f[25]), f[25]), min(max(tilt, -f[25]), f[25])


@cached_njit
def _ease(goal: Triple, own: Triple, within_s: float, f: Array) -> Triple:
    """Return a position on the way; see `camnet.control.setpoints.at_ease`."""
    x, y, z = goal[0] - own[0], goal[1] - own[1], goal[2] - own[2]
    distance = math.sqrt(x * x + y * y + z * z)
    allowed = PUNCTUAL * within_s if math.isfinite(within_s) else REPOSE_S
    speed = max(distance / max(allowed, 1e-3), LEAST_SPEED_MPS)
    step = speed / f[23]
    if step >= distance or speed >= f[24]:
        return goal
    share = step / distance
    return own[0] + x * share, own[1] + y * share, own[2] + z * share


@cached_njit
def _track(
    o: NDArray[np.float32], i: IntArray, speed: float, own: Triple, f: Array
) -> tuple[Triple, float, float]:
    """Hover above the target whose fields begin at ``i``: position and gaze."""
    p, v, radius = _world(o, i[_P], f), i[_V], np.float64(o[i[_RADIUS]]) * f[27]
    ahead = (
        p[0] + LEAD_S * (np.float64(o[v]) * speed),
        p[1] + LEAD_S * (np.float64(o[v + 1]) * speed),
        p[2] + LEAD_S * (np.float64(o[v + 2]) * speed),
    )
    x, y, z = _above(ahead, _height(f[22] + radius, f), f)
    if o[i[_SEEN]] > 0:
        step = CLIMB_MPS / f[23]
        z = own[2] + min(max(z - own[2], -step), step)
    pan, tilt = _look(own, p, f)
    return (x, y, z), pan, tilt


@cached_njit
def _meet(o: NDArray[np.float32], i: IntArray, own: Triple, f: Array) -> tuple[Triple, float, float]:
    """Wait at the predicted entry of the target whose fields begin at ``i``: position and gaze."""
    entry = _world(o, i[_ENTRY_P], f)
    goal = _above(entry, _height(f[22] + np.float64(o[i[_ENTRY_RADIUS]]) * f[27], f), f)
    pan, tilt = _look(goal, entry, f)
    return _ease(goal, own, np.float64(o[i[_ENTRY_TIME]]) * f[28], f), pan, tilt


@cached_njit
def _held(o: NDArray[np.float32], first: IntArray) -> int:
    """Target in the region, one in view before one believed to be there, then the one best known; -1: none."""
    best, mine, radius = -1, 0.0, math.inf
    for m in range(first.shape[0]):
        i = first[m]
        here = o[i[_MINE]] > 0 or (o[i[_INSIDE]] > 0 and o[i[_RADIUS]] <= 1)
        better = o[i[_MINE]] > mine or (o[i[_MINE]] == mine and o[i[_RADIUS]] < radius)
        if here and (best < 0 or better):
            best, mine, radius = m, o[i[_MINE]], o[i[_RADIUS]]
    return best


@cached_njit
def _soon(o: NDArray[np.float32], first: IntArray) -> int:
    """Target that comes next, one that surely comes before one that may; -1: none."""
    best, coming, time = -1, 0.0, math.inf
    for m in range(first.shape[0]):
        i = first[m]
        here = o[i[_COMING]] > 0 and o[i[_ENTRY_RADIUS]] <= 1
        better = o[i[_COMING]] > coming or (o[i[_COMING]] == coming and o[i[_ENTRY_TIME]] < time)
        if here and (best < 0 or better):
            best, coming, time = m, o[i[_COMING]], o[i[_ENTRY_TIME]]
    return best


@cached_njit
def act(o: NDArray[np.float32], first: IntArray, speeds: Array, f: Array) -> NDArray[np.float32]:
    """Return the action (5,) for an observation (D,) of M targets with top ``speeds`` (M,); ``first``: see `FIELDS`."""
    own = _world(o, 0, f)
    held, soon = _held(o, first), _soon(o, first)
    if held >= 0:
        p, pan, tilt = _track(o, first[held], speeds[held], own, f)
    elif soon >= 0:
        p, pan, tilt = _meet(o, first[soon], own, f)
    else:
        p, pan, tilt = _ease((f[29], f[30], f[31]), own, math.inf, f), 0.0, 0.0
    out = np.empty(5, dtype=np.float32)
    for k in range(3):
        out[k] = min(max((p[k] - f[k]) / f[6 + k], -1.0), 1.0)
    out[3], out[4] = min(max(pan / f[26], -1.0), 1.0), min(max(tilt / f[26], -1.0), 1.0)
    return out

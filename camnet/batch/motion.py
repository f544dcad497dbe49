"""Targets of many environments: the motions of `camnet.motion`, one step of one target at a time, in arrays.

Every kind of motion is packed into `Targets`; `step_target` is what `TargetMotion.step` is there. A target at rest in
an array is pose and velocity ``now`` (13,): p, q, v (world frame), w (body frame), and ``inner`` (8,): what the class
calls ``internal``.

The nearest point of a loop is found among the samples that can be nearest anywhere in a cell of a grid, which gives
the same sample as a search through all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.batch.compiled import inner, outer
from camnet.batch.random import Streams, normal, uniform
from camnet.batch.triples import circle
from camnet.errors import ConfigError
from camnet.motion.curve import ClosedCurve
from camnet.motion.fields import LEAST_STRETCH, SPEED_WAVES, LoopField, WaveField, wave_guide
from camnet.motion.protocol import TargetMotion
from camnet.motion.replay import ReplayMotion
from camnet.motion.road import RoadMotion
from camnet.motion.road_network import RoadNetwork
from camnet.motion.vector_field import VectorFieldMotion
from camnet.types import Array, IntArray

__all__ = ["Targets", "pack_targets", "step_target"]

_LOOP, _WAVE, _ROAD, _TRACK = 0, 1, 2, 3
_CELL_M, _AROUND_M = 0.25, 1.5
_TWO_PI = 2.0 * math.pi
#: as in `camnet.motion.road`
_WANDER_S, _LEASH_STEPS = 10.0, 4
#: at most so many steps to the nearest point of a loop
_NEWTON_STEPS = 4


class Targets(NamedTuple):
    """All targets' laws. Rows of one target lie between ``first[m]`` and ``first[m + 1]`` of the arrays beside it.

    Attributes
    ----------
    kind : (M,) which law
    shape : (M, 12) its numbers: see ``_numbers``
    knot_first, knots, pieces : loops: spline knots and coefficients (n, 2, 4), one row a knot
    sample_first, samples, sample_u : loops: points along the curve
    grid_first, grid, cells : loops: x, y of the corner, count of columns and rows; first sample and count in a cell
    line_first, lines : roads: rows x, y, arc; ``ends`` (K, 3): closed, junction at the start, at the end
    exit_first, exits : roads: at each junction (road, whether along its arc length)
    track_first, track_t, track_c, track_heading : tracks: times, coefficients (n, 4, 3), headings (NaN: none)
    """

    kind: IntArray
    shape: Array
    knot_first: IntArray
    knots: Array
    pieces: Array
    sample_first: IntArray
    samples: Array
    sample_u: Array
    grid_first: IntArray
    grid: Array
    cells: IntArray
    line_first: IntArray
    lines: Array
    ends: IntArray
    exit_first: IntArray
    exits: IntArray
    track_first: IntArray
    track_t: Array
    track_c: Array
    track_heading: Array


def pack_targets(motions: list[TargetMotion]) -> Targets:
    """Pack the laws of M targets.

    Raises
    ------
    ConfigError
        A motion is of a kind that has no compiled form here.
    """
    packed = [_packed(motion) for motion in motions]
    networks = [m.network for m in motions if isinstance(m, RoadMotion)]
    if any(network != networks[0] for network in networks):
        raise ConfigError("batch back end: all targets on roads must share one road network")
    line_first, lines, ends, exit_first, exits = _roads(networks[0] if networks else None)
    loops = [m.field.curve if _is_loop(m) else None for m in motions]  # type: ignore[attr-defined]
    knots = [(c.knots, _one_more(c.coefficients)) if c is not None else _NO_KNOTS for c in loops]
    samples = [(c.samples, c.sample_u) if c is not None else _NO_SAMPLES for c in loops]
    grids = [_grid(c) if c is not None else (np.zeros(4), np.zeros((0, 2), np.int64)) for c in loops]
    tracks = [_track(m) for m in motions]
    return Targets(
        kind=np.array([kind for kind, _ in packed], dtype=np.int64),
        shape=np.array([row for _, row in packed]).reshape(len(motions), 12),
        knot_first=_starts([k for k, _ in knots]),
        knots=_joined([k for k, _ in knots]),
        pieces=_joined([c for _, c in knots]),
        sample_first=_starts([s for s, _ in samples]),
        samples=_joined([s for s, _ in samples]),
        sample_u=_joined([u for _, u in samples]),
        grid_first=_starts([cells for _, cells in grids]),
        grid=np.array([corner for corner, _ in grids]).reshape(len(motions), 4),
        cells=np.concatenate([np.zeros((0, 2), np.int64), *(cells for _, cells in grids)]),
        line_first=line_first,
        lines=lines,
        ends=ends,
        exit_first=exit_first,
        exits=exits,
        track_first=_starts([t for t, _, _ in tracks]),
        track_t=_joined([t for t, _, _ in tracks]),
        track_c=_joined([c for _, c, _ in tracks]),
        track_heading=_joined([h for _, _, h in tracks]),
    )


_NO_KNOTS = (np.zeros(0), np.zeros((0, 2, 4)))
_NO_SAMPLES = (np.zeros((0, 2)), np.zeros(0))


def _is_loop(motion: TargetMotion) -> bool:
    return isinstance(motion, VectorFieldMotion) and isinstance(motion.field, LoopField)


def _starts(blocks: list[Array] | list[IntArray]) -> IntArray:
    return np.concatenate([[0], np.cumsum([len(b) for b in blocks])]).astype(np.int64)


def _joined(blocks: list[Array]) -> Array:
    return np.ascontiguousarray(np.concatenate(blocks)) if blocks else np.zeros(0)


def _one_more(coefficients: Array) -> Array:
    """As many pieces as knots, so that both have the same first row."""
    return np.concatenate([coefficients, coefficients[-1:]])


def _packed(motion: TargetMotion) -> tuple[int, list[float]]:
    """Code and numbers of a law: (0..4) of its field or range, then v_max, w_max and what its kind needs."""
    if isinstance(motion, VectorFieldMotion):
        d, field = motion.drive, motion.field
        drive = [
            d.v_max_mps,
            d.w_max_radps,
            d.wheel_base_m,
            d.wheel_max_mps,
            d.lag_s,
            motion.heading_gain_per_s,
        ]
        if isinstance(field, LoopField):
            return _LOOP, [field.attraction_per_m, field.speed_mps, field.modulation, 0.0, 0.0, *drive, 0.0]
        if isinstance(field, WaveField):
            return _WAVE, [field.scale_m, field.speed_mps, field.modulation, *field.center_m, *drive, 0.0]
    if isinstance(motion, RoadMotion):
        slow, fast = motion.speed_mps
        limits = [motion.v_max_mps, motion.w_max_radps, motion.leash_m, motion.lateral_std_m]
        return _ROAD, [slow, fast, 0.0, 0.0, 0.0, *limits, 0.0, 0.0, 0.0]
    if isinstance(motion, ReplayMotion):
        begin = [motion.begin_s, motion.min_speed_mps, 0.0, 0.0, 0.0]
        return _TRACK, [*begin, motion.v_max_mps, motion.w_max_radps, *motion.path.still.tolist(), 0.0, 0.0]
    raise ConfigError(f"batch back end: a target's motion {type(motion).__name__} has no compiled form")


def _grid(curve: ClosedCurve) -> tuple[Array, IntArray]:
    """Corner and size of a grid about the curve, and for each cell the samples that can be nearest in it."""
    low, high = curve.samples.min(axis=0) - _AROUND_M, curve.samples.max(axis=0) + _AROUND_M
    columns, rows = np.ceil((high - low) / _CELL_M).astype(int)
    cells = np.empty((columns * rows, 2), dtype=np.int64)
    n, reach = len(curve.samples), _CELL_M * math.sqrt(2.0)
    for k in range(columns * rows):
        middle = low + _CELL_M * (np.array([k % columns, k // columns]) + 0.5)
        away = np.sqrt(((curve.samples - middle) ** 2).sum(axis=1))
        cells[k] = _covering(np.flatnonzero(away <= away.min() + reach + 1e-9), n)
    return np.array([*low, columns, rows]), cells


def _covering(chosen: IntArray, n: int) -> tuple[int, int]:
    """Shortest run around a ring of ``n`` that holds all of ``chosen`` (rising): its first and its length."""
    gaps = np.diff(np.append(chosen, chosen[0] + n))
    widest = int(np.argmax(gaps))
    first = int(chosen[(widest + 1) % len(chosen)])
    return first, n - int(gaps[widest]) + 1


def _roads(network: RoadNetwork | None) -> tuple[IntArray, Array, IntArray, IntArray, IntArray]:
    if network is None:
        none = np.zeros(1, np.int64)
        return none, np.zeros((0, 3)), np.zeros((0, 3), np.int64), none, np.zeros((0, 2), np.int64)
    blocks = [np.column_stack([line.x, line.y, line.arc]) for line in network.lines]
    ends = np.array([[line.closed, line.start, line.end] for line in network.lines], dtype=np.int64)
    exits = [np.array(ways, dtype=np.int64).reshape(-1, 2) for ways in network.exits]
    return _starts(blocks), _joined(blocks), ends, _starts(exits), np.concatenate(exits)


def _track(motion: TargetMotion) -> tuple[Array, Array, Array]:
    if not isinstance(motion, ReplayMotion):
        return np.zeros(0), np.zeros((0, 4, 3)), np.zeros(0)
    path = motion.path
    t = np.array(path.knots_s)
    pieces = np.concatenate([path.coefficients, np.zeros((1, 4, 3))])
    return t, pieces, np.full(len(t), np.nan) if path.headings is None else path.headings


@inner
def _wrapped(angle: float) -> float:
    """Angle in [-pi, pi]."""
    return angle - _TWO_PI * np.rint(angle / _TWO_PI)


@inner
def _set_planar(
    now: Array, e: int, m: int, x: float, y: float, z: float, heading: float, v: float, w: float
) -> None:
    half = 0.5 * heading
    now[e, m, 0], now[e, m, 1], now[e, m, 2] = x, y, z
    now[e, m, 3], now[e, m, 4], now[e, m, 5], now[e, m, 6] = math.cos(half), 0.0, 0.0, math.sin(half)
    now[e, m, 7], now[e, m, 8], now[e, m, 9] = v * math.cos(heading), v * math.sin(heading), 0.0
    now[e, m, 10], now[e, m, 11], now[e, m, 12] = 0.0, 0.0, w


@inner
def _nearest_sample(t: Targets, m: int, x: float, y: float) -> int:
    """Return the number of the loop's sample nearest to (x, y)."""
    begin, n = t.sample_first[m], t.sample_first[m + 1] - t.sample_first[m]
    first, count = 0, n
    column = math.floor((x - t.grid[m, 0]) / _CELL_M)
    row = math.floor((y - t.grid[m, 1]) / _CELL_M)
    if 0 <= column < t.grid[m, 2] and 0 <= row < t.grid[m, 3]:
        cell = t.grid_first[m] + row * int(t.grid[m, 2]) + column
        first, count = t.cells[cell, 0], t.cells[cell, 1]
    best, least = first, math.inf
    for k in range(first, first + count):
        i = begin + (k if k < n else k - n)
        dx, dy = t.samples[i, 0] - x, t.samples[i, 1] - y
        square = dx * dx + dy * dy
        if square < least:
            best, least = i, square
    return best


@inner
def _on_curve(
    t: Targets, first: int, piece: int, u: float
) -> tuple[float, float, float, float, float, float]:
    """x, y of a loop and their first and second derivatives by u, in one of its pieces."""
    k = first + piece
    h, c = u - t.knots[k], t.pieces
    ax, bx, cx, dx = c[k, 0, 0], c[k, 0, 1], c[k, 0, 2], c[k, 0, 3]
    ay, by, cy, dy = c[k, 1, 0], c[k, 1, 1], c[k, 1, 2], c[k, 1, 3]
    return (
        ax + h * (bx + h * (cx + h * dx)),
        ay + h * (by + h * (cy + h * dy)),
        bx + h * (2.0 * cx + 3.0 * h * dx),
        by + h * (2.0 * cy + 3.0 * h * dy),
        2.0 * cx + 6.0 * h * dx,
        2.0 * cy + 6.0 * h * dy,
    )


@inner
def _loop(t: Targets, m: int, x: float, y: float) -> tuple[float, float, float, float]:
    """Return what a loop wants at a point: `LoopField`, with the piece of the curve kept in hand."""
    first, pieces = t.knot_first[m], t.knot_first[m + 1] - t.knot_first[m] - 1
    sample = _nearest_sample(t, m, x, y)
    u, period = t.sample_u[sample], t.knots[first + pieces]
    piece = (sample - t.sample_first[m]) * pieces // (t.sample_first[m + 1] - t.sample_first[m])
    px, py, dx, dy, ddx, ddy = _on_curve(t, first, piece, u)
    for _ in range(_NEWTON_STEPS):
        slope = dx * dx + dy * dy + (px - x) * ddx + (py - y) * ddy
        if slope <= 0.0:  # beyond the centre of curvature: the sample is as near as it gets
            break
        step = ((px - x) * dx + (py - y) * dy) / slope
        u -= step
        if u < 0.0 or u >= period:
            u -= period * math.floor(u / period)
        while u < t.knots[first + piece] or u >= t.knots[first + piece + 1]:
            ahead = u >= t.knots[first + piece + 1] if u - t.knots[first + piece] < 0.5 * period else False
            piece = (piece + (1 if ahead else pieces - 1)) % pieces
        px, py, dx, dy, ddx, ddy = _on_curve(t, first, piece, u)
        if abs(step) < 1e-8:  # the next one would be its square
            break
    speed = math.sqrt(dx * dx + dy * dy)
    tx, ty, kappa = dx / speed, dy / speed, (dx * ddy - dy * ddx) / (speed * speed * speed)
    g, d = t.shape[m, 0], tx * (y - py) - ty * (x - px)
    along, across = kappa / max(1.0 - kappa * d, LEAST_STRETCH), -g / (1.0 + (g * d) ** 2)
    wave = 1.0 + t.shape[m, 2] * circle(2.0 * math.pi * SPEED_WAVES * u / period)[1]
    return (
        math.atan2(dy - g * d * dx, dx + g * d * dy),  # the tangent's direction less atan(g d)
        along * tx - across * ty,
        along * ty + across * tx,
        t.shape[m, 1] * wave,
    )


@inner
def _guide(t: Targets, m: int, x: float, y: float) -> tuple[float, float, float, float]:
    """Direction, its gradient and speed that the target's field wants at a point."""
    if t.kind[m] == _LOOP:
        return _loop(t, m, x, y)
    s = t.shape
    return wave_guide((x - s[m, 3]) / s[m, 0], (y - s[m, 4]) / s[m, 0], s[m, 0], s[m, 1], s[m, 2])


@inner
def _drive(t: Targets, m: int, x: float, y: float, theta: float) -> tuple[float, float]:
    """Forward and turning speed that the robot runs at a pose: `VectorFieldMotion._command`."""
    psi, grad_x, grad_y, v = _guide(t, m, x, y)
    v_max, w_max, wheel_max = t.shape[m, 5], t.shape[m, 6], t.shape[m, 8]
    v = min(v, v_max)
    w = t.shape[m, 10] * _wrapped(psi - theta) + v * (grad_x * math.cos(theta) + grad_y * math.sin(theta))
    w = min(max(w, -w_max), w_max)
    fastest = abs(v) + abs(w) * 0.5 * t.shape[m, 7]
    if fastest > wheel_max:
        v, w = v * wheel_max / fastest, w * wheel_max / fastest
    return v, w


@inner
def _step_field(t: Targets, m: int, now: Array, inner: Array, e: int, dt: float) -> None:
    """`VectorFieldMotion.step`."""
    x, y = now[e, m, 0], now[e, m, 1]
    theta, v, w = inner[e, m, 0], inner[e, m, 1], inner[e, m, 2]
    lag = t.shape[m, 9]
    if lag > 0.0:
        v_goal, w_goal = _drive(t, m, x, y, theta)
        gain = -math.expm1(-dt / lag)
        v_next, w_next = v + gain * (v_goal - v), w + gain * (w_goal - w)
        v_mid, w_mid = 0.5 * (v + v_next), 0.5 * (w + w_next)
        theta_mid = theta + 0.25 * dt * (w + w_mid)
    else:
        half = 0.5 * dt
        theta_mid = theta + half * w
        v_mid, w_mid = _drive(t, m, x + half * v * math.cos(theta), y + half * v * math.sin(theta), theta_mid)
        v_next, w_next = v_mid, w_mid
    x += dt * v_mid * math.cos(theta_mid)
    y += dt * v_mid * math.sin(theta_mid)
    theta += dt * w_mid
    if lag <= 0.0:
        v_next, w_next = _drive(t, m, x, y, theta)
    _set_planar(now, e, m, x, y, 0.0, theta, v_next, w_next)
    inner[e, m, 0], inner[e, m, 1], inner[e, m, 2] = theta, v_next, w_next


@inner
def _wander(inner: Array, e: int, m: int, dt: float, streams: Streams, row: int) -> None:
    """Advance the four wander states of a vehicle: `camnet.motion.road._wandered`."""
    keep = math.exp(-dt / _WANDER_S)
    kick = math.sqrt(1.0 - keep * keep)
    for k in (4, 6):
        rough, smooth = inner[e, m, k], inner[e, m, k + 1]
        inner[e, m, k + 1] = smooth + (1.0 - keep) * (rough - smooth)
        inner[e, m, k] = keep * rough + kick * normal(streams, row)


@inner
def _on_road(t: Targets, road: int, forward: bool, arc: float, offset: float) -> tuple[float, float]:
    """Place on a road, ``offset`` to the left of the way along it."""
    begin, n = t.line_first[road], t.line_first[road + 1] - t.line_first[road]
    low, high = 0, n  # bisect_right
    while low < high:
        middle = (low + high) // 2
        if arc < t.lines[begin + middle, 2]:
            high = middle
        else:
            low = middle + 1
    k = begin + min(max(low - 1, 0), n - 2)
    f = (arc - t.lines[k, 2]) / (t.lines[k + 1, 2] - t.lines[k, 2])
    dx, dy = t.lines[k + 1, 0] - t.lines[k, 0], t.lines[k + 1, 1] - t.lines[k, 1]
    length = math.sqrt(dx * dx + dy * dy)
    side = (offset if forward else -offset) / length
    return t.lines[k, 0] + f * dx - side * dy, t.lines[k, 1] + f * dy + side * dx


@inner
def _way_on(t: Targets, road: int, forward: bool, draw: float) -> tuple[int, bool]:
    """Road and direction taken at the end of a road: `RoadNetwork.after`."""
    if t.ends[road, 0] == 1:
        return road, forward
    here = t.ends[road, 2] if forward else t.ends[road, 1]
    first, last = t.exit_first[here], t.exit_first[here + 1]
    ways = 0
    for k in range(first, last):
        if not (t.exits[k, 0] == road and (t.exits[k, 1] == 1) != forward):
            ways += 1
    if ways == 0:
        return road, not forward
    chosen = int(draw * ways)
    for k in range(first, last):
        if not (t.exits[k, 0] == road and (t.exits[k, 1] == 1) != forward):
            if chosen == 0:
                return t.exits[k, 0], t.exits[k, 1] == 1
            chosen -= 1
    return road, not forward


@inner
def _run_ahead(
    t: Targets, road: int, forward: bool, arc: float, distance: float, streams: Streams, row: int
) -> tuple[int, bool, float]:
    """Move the point ahead along the roads: `RoadMotion._advance`."""
    while True:
        length = t.lines[t.line_first[road + 1] - 1, 2]
        left = length - arc if forward else arc
        if distance < left:
            return road, forward, arc + distance if forward else arc - distance
        distance -= left
        road, forward = _way_on(t, road, forward, uniform(streams, row))
        arc = 0.0 if forward else t.lines[t.line_first[road + 1] - 1, 2]


@inner
def _step_road(
    t: Targets, m: int, now: Array, inner: Array, e: int, dt: float, streams: Streams, row: int
) -> None:
    """`RoadMotion.step`."""
    x, y, theta = now[e, m, 0], now[e, m, 1], inner[e, m, 0]
    road, forward, arc = int(inner[e, m, 1]), inner[e, m, 2] > 0.0, inner[e, m, 3]
    _wander(inner, e, m, dt, streams, row)
    slow, fast, leash = t.shape[m, 0], t.shape[m, 1], t.shape[m, 7]
    v = 0.5 * (slow + fast) + 0.5 * (fast - slow) * math.tanh(math.sqrt(2.0) * inner[e, m, 5])
    offset = t.shape[m, 8] * math.sqrt(2.0) * inner[e, m, 7]
    for _ in range(_LEASH_STEPS):
        goal_x, goal_y = _on_road(t, road, forward, arc, offset)
        slack = leash - math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
        if slack <= 1e-9:
            break
        road, forward, arc = _run_ahead(t, road, forward, arc, slack, streams, row)
    goal_x, goal_y = _on_road(t, road, forward, arc, offset)
    bearing = _wrapped(math.atan2(goal_y - y, goal_x - x) - theta)
    sharp = math.copysign(t.shape[m, 6], bearing)  # behind: turn as sharply as allowed
    w = sharp if abs(bearing) > 0.5 * math.pi else 2.0 * v * math.sin(bearing) / leash
    theta_mid = theta + 0.5 * dt * w
    theta += dt * w
    _set_planar(
        now, e, m, x + dt * v * math.cos(theta_mid), y + dt * v * math.sin(theta_mid), 0.0, theta, v, w
    )
    inner[e, m, 0], inner[e, m, 1], inner[e, m, 2], inner[e, m, 3] = theta, road, 1.0 if forward else 0.0, arc


@inner
def _knot_before(t: Targets, first: int, n: int, at: float) -> int:
    """Last of ``n`` knots of a track from ``first`` on that is not after ``at``; the last piece at most."""
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if t.track_t[first + middle] <= at:
            low = middle
        else:
            high = middle
    return int(first + low)


@inner
def _step_track(t: Targets, m: int, now: Array, inner: Array, e: int, t_s: float, dt: float) -> None:
    """`ReplayMotion.step`: the state at ``t_s + dt``."""
    first, n = t.track_first[m], t.track_first[m + 1] - t.track_first[m]
    at = t.shape[m, 0] + t_s + dt
    theta, w_max = inner[e, m, 0], t.shape[m, 6]
    px, py, pz, vx, vy, vz = t.shape[m, 7], t.shape[m, 8], t.shape[m, 9], 0.0, 0.0, 0.0
    goal = t.track_heading[first]
    if n > 1:
        clamped = min(max(at, t.track_t[first]), t.track_t[first + n - 1])
        k = _knot_before(t, first, n, clamped)
        h, c = clamped - t.track_t[k], t.track_c[k]
        px = ((c[0, 0] * h + c[1, 0]) * h + c[2, 0]) * h + c[3, 0]
        py = ((c[0, 1] * h + c[1, 1]) * h + c[2, 1]) * h + c[3, 1]
        pz = ((c[0, 2] * h + c[1, 2]) * h + c[2, 2]) * h + c[3, 2]
        if t.track_t[first] <= at < t.track_t[first + n - 1]:
            vx = (3.0 * c[0, 0] * h + 2.0 * c[1, 0]) * h + c[2, 0]
            vy = (3.0 * c[0, 1] * h + 2.0 * c[1, 1]) * h + c[2, 1]
            vz = (3.0 * c[0, 2] * h + 2.0 * c[1, 2]) * h + c[2, 2]
        share = h / (t.track_t[k + 1] - t.track_t[k])
        goal = t.track_heading[k] + share * (t.track_heading[k + 1] - t.track_heading[k])
    w = 0.0
    if math.isnan(goal) and math.sqrt(vx * vx + vy * vy) > t.shape[m, 1]:
        goal = math.atan2(vy, vx)
    if not math.isnan(goal):
        w = min(max(_wrapped(goal - theta) / dt, -w_max), w_max)
    theta += w * dt
    _set_planar(now, e, m, px, py, pz, theta, 0.0, w)
    now[e, m, 7], now[e, m, 8], now[e, m, 9] = vx, vy, vz
    inner[e, m, 0] = theta


@outer
def step_target(
    t: Targets, m: int, now: Array, inner: Array, e: int, t_s: float, dt: float, streams: Streams, row: int
) -> None:
    """Advance target ``m`` of environment ``e`` from ``t_s`` by ``dt``, in place; it draws from one stream."""
    kind = t.kind[m]
    if kind <= _WAVE:
        _step_field(t, m, now, inner, e, dt)
    elif kind == _ROAD:
        _step_road(t, m, now, inner, e, dt, streams, row)
    else:
        _step_track(t, m, now, inner, e, t_s, dt)

"""Laws of the targets' motions, packed into arrays: what `camnet.batch.motion` steps by.

The nearest point of a loop is found among the samples that can be nearest anywhere in a cell of a grid, which gives
the same sample as a search through all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.errors import ConfigError
from camnet.motion.curve import ClosedCurve
from camnet.motion.fields import LoopField, WaveField
from camnet.motion.planned import PlannedField, PlannedRoad
from camnet.motion.protocol import TargetMotion
from camnet.motion.replay import ReplayMotion
from camnet.motion.road import RoadMotion
from camnet.motion.road_network import RoadNetwork
from camnet.motion.vector_field import VectorFieldMotion
from camnet.types import Array, IntArray

__all__ = [
    "CELL_M",
    "LOOP",
    "PLANNED_FIELD",
    "PLANNED_ROAD",
    "ROAD",
    "SAFE",
    "TRACK",
    "WAVE",
    "Targets",
    "pack_targets",
]

#: kinds of law; a planned field is a loop or a wave with ``PLANNED_FIELD`` added
LOOP, WAVE, ROAD, TRACK = 0, 1, 2, 3
PLANNED_FIELD, PLANNED_ROAD = 4, 6
#: size of a cell; how far the grid reaches beyond the curve
CELL_M, _AROUND_M = 0.25, 1.5
#: column of ``shape`` with the square of a loop's safe distance: see ``_safe_distance``
SAFE = 11


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
    motions = [_unplanned(motion) for motion in motions]
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


def _unplanned(motion: TargetMotion) -> TargetMotion:
    """Return the motion that a planned one replaces; others are returned as they are."""
    if isinstance(motion, PlannedRoad):
        return motion.road
    return motion.field if isinstance(motion, PlannedField) else motion


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
    if isinstance(motion, PlannedRoad):
        return PLANNED_ROAD, _packed(motion.road)[1]
    if isinstance(motion, PlannedField):
        kind, numbers = _packed(motion.field)
        return PLANNED_FIELD + kind, numbers
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
            safe = _safe_distance(field.curve)
            return LOOP, [
                field.attraction_per_m,
                field.speed_mps,
                field.modulation,
                0.0,
                0.0,
                *drive,
                safe**2,
            ]
        if isinstance(field, WaveField):
            return WAVE, [field.scale_m, field.speed_mps, field.modulation, *field.center_m, *drive, 0.0]
    if isinstance(motion, RoadMotion):
        slow, fast = motion.speed_mps
        limits = [motion.v_max_mps, motion.w_max_radps, motion.leash_m, motion.lateral_std_m]
        return ROAD, [slow, fast, 0.0, 0.0, 0.0, *limits, 0.0, 0.0, 0.0]
    if isinstance(motion, ReplayMotion):
        begin = [motion.begin_s, motion.min_speed_mps, 0.0, 0.0, 0.0]
        return TRACK, [*begin, motion.v_max_mps, motion.w_max_radps, *motion.path.still.tolist(), 0.0, 0.0]
    raise ConfigError(f"batch back end: a target's motion {type(motion).__name__} has no compiled form")


def _safe_distance(curve: ClosedCurve) -> float:
    """Half the reach of a loop, m.

    A point nearer than the reach to a place of the loop, and square to the loop there, has no other place as near
    (H. Federer, "Curvature measures", Trans. AMS 93, 1959, theorem 4.8). The reach is the least of
    ``|b - a|^2 / (2 |n . (b - a)|)`` over pairs of places, n the normal at a (theorem 4.18); half of it is taken, as
    the samples are not all places.
    """
    ahead = np.roll(curve.samples, -1, axis=0) - np.roll(curve.samples, 1, axis=0)
    normals = np.column_stack([-ahead[:, 1], ahead[:, 0]]) / np.linalg.norm(ahead, axis=1)[:, None]
    least = math.inf
    for place, normal in zip(curve.samples, normals, strict=True):
        away = curve.samples - place
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = (away**2).sum(axis=1) / np.abs(2.0 * away @ normal)
        least = min(least, float(np.nanmin(ratio)))
    return 0.5 * least


def _grid(curve: ClosedCurve) -> tuple[Array, IntArray]:
    """Corner and size of a grid about the curve, and for each cell the samples that can be nearest in it."""
    low, high = curve.samples.min(axis=0) - _AROUND_M, curve.samples.max(axis=0) + _AROUND_M
    columns, rows = np.ceil((high - low) / CELL_M).astype(int)
    cells = np.empty((columns * rows, 2), dtype=np.int64)
    n, reach = len(curve.samples), CELL_M * math.sqrt(2.0)
    for k in range(columns * rows):
        middle = low + CELL_M * (np.array([k % columns, k // columns]) + 0.5)
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

"""Every way that a world's targets can take, as the simulator itself moves them.

| target | ways | span |
| --- | --- | --- |
| ``road`` | every walk over the roads that it can reach, as drawn, and as driven around bends | unlimited |
| ``vector_field``, ``field`` | its one path: on to where it closes, then repeated laps | unlimited, else stated |
| ``track`` | the recording is one of the ways of its class, which may go anywhere | the recording |

Road targets cut corners: a driven way is the motion's own from the middle of one road to the middle of the next, for
every turn. A driver who is not back on the centre line there counts by a wider cross-section.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.certification.road_arcs import RoadArcs, arcs_from_lanes, arcs_from_polylines, arcs_from_roads
from camnet.certification.ways import Ways, straight_ways
from camnet.errors import CertificateError
from camnet.motion.field_motion import FieldMotion
from camnet.motion.protocol import TargetMotion, TargetState, planar_state
from camnet.motion.road import RoadMotion
from camnet.motion.road_network import CenterLine, RoadNetwork
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray

__all__ = ["PathWays", "drawn_ways", "driven_ways", "path_ways", "road_arcs_of", "start_arcs", "wander_m"]

#: the share of a normal distribution beyond this many standard deviations (0.3 %) is left out of a cross-section
WANDER_SIGMAS = 3.0
#: distance between two steps of a driven way, m
_STEP_M = 0.04
#: a path has closed when it comes back this near (m), with this heading (rad)
_CLOSED_M, _CLOSED_RAD = 0.02, 0.02
#: columns of a pose (x, y, heading, z) that say where it is
_PLACE = [0, 1, 3]
#: offsets from the centre line below this (m) are none
_ON_LINE_M = 5e-3

_Heading = tuple[int, bool]


def wander_m(sigma_m: float) -> float:
    """Return the half-width of the cross-section that a target wanders over, m."""
    return WANDER_SIGMAS * sigma_m


def road_arcs_of(network: Network) -> RoadArcs:
    """Return both directions of the world's roads as arcs: road k forward is arc 2 k, backward 2 k + 1."""
    roads = network.scenario.roads
    return arcs_from_roads([np.array(r.points_m, dtype=float) for r in roads], [r.closed for r in roads])


def start_arcs(motions: Sequence[RoadMotion], n_arcs: int) -> BoolArray:
    """Return on which arcs (A,) of ``road_arcs_of`` targets with these motions may begin."""
    out = np.zeros(n_arcs, dtype=bool)
    for motion in motions:
        forward = _ways_of_start(motion)
        for ahead in forward:
            out[2 * motion.start_road + (0 if ahead else 1)] = True
    return out


def _ways_of_start(motion: RoadMotion) -> list[bool]:
    """Return the directions along its road in which a target may begin."""
    if motion.start_heading_rad is not None and motion.start_arc_m is not None:
        along = motion.network.lines[motion.start_road].at(motion.start_arc_m)[2]
        return [math.cos(motion.start_heading_rad - along) >= 0.0]
    return [True] if motion.start_arc_m is not None else [True, False]


def drawn_ways(network: Network, motions: Sequence[RoadMotion], v_lo_mps: float) -> Ways:
    """Return the ways along the roads as drawn."""
    roads = road_arcs_of(network)
    return straight_ways(
        roads, v_lo_mps, start_arcs(motions, roads.n_arcs), wander_m(motions[0].lateral_std_m)
    )


def driven_ways(motions: Sequence[RoadMotion], v_lo_mps: float) -> Ways:
    """Return the ways as driven: one arc for every turn, from the middle of one road to the middle of the next.

    Closed roads have one arc a direction, the lap that a driver settles on.
    """
    motion = motions[0]
    network = motion.network
    starts = {(m.start_road, ahead) for m in motions for ahead in _ways_of_start(m)}
    turns = _turns(network, starts)
    known: dict[tuple[object, ...], tuple[Array, float]] = {}
    lines, off_m = [], 0.0
    for first, then in turns:
        path, away = _driven(motion, first, then, known)
        lines.append(path)
        off_m = max(off_m, away)
    number = {turn: k for k, turn in enumerate(turns)}
    after: dict[_Heading, list[int]] = {}
    for (first, _), k in number.items():
        after.setdefault(first, []).append(k)
    roads = arcs_from_polylines([line[:, :2] for line in lines], [after.get(then, []) for _, then in turns])
    # from the middle of a road on; where it begins before that, the roads as drawn answer
    entries = np.array([first in starts for first, _ in turns])
    width = wander_m(motion.lateral_std_m) + (off_m if off_m > _ON_LINE_M else 0.0)
    return _sampled(lines, roads, v_lo_mps, entries, width)


def _sampled(lines: list[Array], roads: RoadArcs, v_lo_mps: float, entries: BoolArray, width: float) -> Ways:
    at = [np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1))] for line in lines]
    at_m, rows = np.concatenate(at), np.concatenate(lines)
    ptr = np.cumsum([0, *map(len, lines)]).astype(np.int64)
    return Ways(roads, ptr, at_m, rows[:, :2], rows[:, 2], at_m / v_lo_mps, entries, width)


def _turns(network: RoadNetwork, starts: set[_Heading]) -> list[tuple[_Heading, _Heading]]:
    """List every turn (heading, next heading) that can be reached from the starts."""
    out: list[tuple[_Heading, _Heading]] = []
    waiting, known = sorted(starts), set(starts)
    while waiting:
        heading = waiting.pop()
        for then in _successors(network, heading):
            out.append((heading, then))
            if then not in known:
                known.add(then)
                waiting.append(then)
    return out


def _successors(network: RoadNetwork, heading: _Heading) -> list[_Heading]:
    road, forward = heading
    line = network.lines[road]
    count = 1 if line.closed else len(network.exits[line.end if forward else line.start])
    draws = (np.arange(count) + 0.5) / count
    return list(dict.fromkeys(network.after(road, forward, float(d)) for d in draws))


@dataclass(frozen=True, slots=True)
class _Route:
    """Stands for a ``RoadNetwork`` of which one turn is taken."""

    lines: tuple[CenterLine, ...]
    first: _Heading
    then: _Heading

    def after(self, road: int, forward: bool, draw: float) -> _Heading:
        """Return the heading that follows."""
        return self.then if (road, forward) == self.first else (road, forward)


def _driven(
    motion: RoadMotion,
    first: _Heading,
    then: _Heading,
    known: dict[tuple[object, ...], tuple[Array, float]],
) -> tuple[Array, float]:
    """Return the way (n, 3) through a turn, x, y, heading, and how far from the centre line it ends, m."""
    line = _half_lines(motion.network, first, then)
    closed = motion.network.lines[first[0]].closed
    direction = line[1] - line[0]
    angle = math.atan2(direction[1], direction[0])
    c, s = math.cos(angle), math.sin(angle)
    local = (line - line[0]) @ np.array([[c, -s], [s, c]])
    if not closed and np.abs(local[:, 1]).max() < 1e-9 and (np.diff(local[:, 0]) > 0).all():
        return _straight(line), 0.0
    key = (closed, *np.round(local, 3).ravel().tolist())
    if key not in known:
        path, away = _roll_lap(motion, first) if closed else _roll_turn(motion, first, then)
        path = np.vstack([path[:-1:2], path[-1:]])  # 8 cm apart are enough to look from
        known[key] = (np.c_[(path[:, :2] - line[0]) @ np.array([[c, -s], [s, c]]), path[:, 2] - angle], away)
    path, away = known[key]
    back = path[:, :2] @ np.array([[c, s], [-s, c]]) + line[0]
    return np.asarray(np.c_[back, path[:, 2] + angle], dtype=np.float64), away


def _straight(line: Array) -> Array:
    along = np.diff(line, axis=0)
    length = float(np.linalg.norm(along, axis=1).sum())
    f = np.linspace(0.0, 1.0, max(2, math.ceil(length / 0.1) + 1))
    way = line[0] + f[:, None] * (line[-1] - line[0])
    heading = np.full(len(way), math.atan2(along[0, 1], along[0, 0]))
    return np.asarray(np.c_[way, heading], dtype=np.float64)


def _half_lines(network: RoadNetwork, first: _Heading, then: _Heading) -> Array:
    """Return the centre line (k, 2) from the middle of one road to the middle of the next."""
    whole = network.lines[first[0]].closed
    a = _part(network.lines[first[0]], first[1], 0.0 if whole else 0.5, 1.0)
    b = a[-1:] if whole else _part(network.lines[then[0]], then[1], 0.0, 0.5)
    points = np.concatenate([a, b])
    return points[np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9]]


def _part(line: CenterLine, forward: bool, low: float, high: float) -> Array:
    """Return the corners (k, 2) of a part of a road, between shares of its length in the direction of travel."""
    length = line.length_m
    a, b = (low * length, high * length) if forward else ((1.0 - high) * length, (1.0 - low) * length)
    inner = [s for s in line.arc if a + 1e-9 < s < b - 1e-9]
    points = np.array([line.at(s)[:2] for s in (a, *inner, b)])
    return np.asarray(points if forward else points[::-1])


def _begin(motion: RoadMotion, heading: _Heading, share: float) -> TargetState:
    """Return a driver on the centre line, at a share of the road's length in its direction."""
    line = motion.network.lines[heading[0]]
    arc = line.length_m * (share if heading[1] else 1.0 - share)
    x, y, along = line.at(arc)
    theta = along if heading[1] else along + math.pi
    internal = (theta, float(heading[0]), float(heading[1]), arc, 0.0, 0.0, 0.0, 0.0)
    return planar_state(x, y, 0.0, theta, motion.speed_mps[1], 0.0, internal)


def _steady(motion: RoadMotion, route: _Route | RoadNetwork) -> RoadMotion:
    """Return the same driver at its highest speed, in the middle of the road; its path does not depend on the speed."""
    fast = motion.speed_mps[1]
    return dataclasses.replace(motion, network=route, speed_mps=(fast, fast), lateral_std_m=0.0)  # type: ignore[arg-type]


def _roll_turn(motion: RoadMotion, first: _Heading, then: _Heading) -> tuple[Array, float]:
    lines = motion.network.lines
    driver = _steady(motion, _Route(lines, first, then))
    dt, rng = _STEP_M / driver.speed_mps[1], np.random.default_rng(0)
    x, y, along = lines[then[0]].at(0.5 * lines[then[0]].length_m)
    angle = along if then[1] else along + math.pi
    goal, ahead = np.array([x, y]), np.array([math.cos(angle), math.sin(angle)])
    state = _begin(motion, first, 0.5)
    rows = [[*state.p_world[:2].tolist(), float(state.internal[0])]]
    most = round(20.0 * (lines[first[0]].length_m + lines[then[0]].length_m + motion.leash_m) / _STEP_M)
    for _ in range(most):
        state = driver.step(state, 0.0, dt, rng)
        p = state.p_world[:2]
        rows.append([*p.tolist(), float(state.internal[0])])
        turned = (int(state.internal[1]), state.internal[2] > 0.0) == then
        facing = math.cos(float(state.internal[0]) - angle) > 0.0
        if (
            turned
            and facing
            and (p - goal) @ ahead >= 0.0
            and float(np.linalg.norm(p - goal)) < motion.leash_m
        ):
            break
    path = np.array(rows)
    away = abs(float((path[-1, :2] - goal) @ np.array([-ahead[1], ahead[0]])))
    if away > _ON_LINE_M:
        return path, away
    path[-1, :2] = goal  # joins the next way without a gap
    return path, 0.0


def _roll_lap(motion: RoadMotion, heading: _Heading) -> tuple[Array, float]:
    """Return the second lap of a closed road."""
    driver = _steady(motion, motion.network)
    dt, rng = _STEP_M / driver.speed_mps[1], np.random.default_rng(0)
    lap = round(1.2 * motion.network.lines[heading[0]].length_m / _STEP_M)
    state = _begin(motion, heading, 0.0)
    rows = []
    for _ in range(3 * lap):
        state = driver.step(state, 0.0, dt, rng)
        rows.append([*state.p_world[:2].tolist(), float(state.internal[0])])
    path = np.array(rows)
    begin = lap
    away = np.linalg.norm(path[begin + 20 :, :2] - path[begin, :2], axis=1)
    near = np.flatnonzero(away < 2.0 * _STEP_M)
    end = begin + 20 + int(near[np.argmin(away[near[near < near[0] + 5]])]) if len(near) else 2 * lap
    last = path[begin].copy()
    last[2] = path[end, 2]  # closes, a turn later
    return np.vstack([path[begin:end], last]), 0.0


@dataclass(frozen=True, eq=False)
class PathWays:
    """The one path of a target that a field moves.

    Attributes
    ----------
    ways : the way until it closes (arc 0) and the lap that follows (the last arc)
    closed : whether it came back to where it had been
    duration_s : how long it was followed
    rests : whether it stands still from then on
    """

    ways: Ways
    closed: bool
    duration_s: float
    rests: bool = False

    @property
    def span(self) -> str:
        """For how much of its way something is promised, in words."""
        if self.closed:
            return "from where it begins, for ever"
        if self.rests:
            return f"from where it begins until it stands still, {self.duration_s:.3g} s later"
        return f"in the first {self.duration_s:g} s of its way"


def path_ways(motion: TargetMotion, at_least_s: float, dt_s: float, half_width_m: float) -> PathWays:
    """Follow a target that moves by itself for ``at_least_s``, and find the lap that it settles on."""
    rng = np.random.default_rng(0)
    state = motion.reset(rng)
    rests_s = motion.rests_s if isinstance(motion, FieldMotion) else math.inf
    rests = rests_s < at_least_s
    poses, n = [_pose(state)], math.ceil(min(at_least_s, rests_s) / dt_s)
    for k in range(n):
        state = motion.step(state, k * dt_s, dt_s, rng)
        poses.append(_pose(state))
    rows = np.array(poses)
    rows[:, 2] = np.unwrap(rows[:, 2])
    moved = np.r_[True, _steps(rows) > 1e-9]
    if moved.sum() < 2:
        raise CertificateError("the target does not move: there is no way to be watched along")
    t = np.asarray(dt_s * np.arange(len(rows), dtype=np.float64)[moved])
    rows = rows[moved]
    begin, end = (-1, -1) if rests else _lap(rows)
    if begin < 0:
        graph = _path_graph([rows], [t], [[]], half_width_m)
        return PathWays(graph, False, min(rests_s, n * dt_s), rests)
    loop = rows[begin : end + 1].copy()
    loop[-1, _PLACE] = loop[0, _PLACE]  # closes, within the tolerance
    parts, times, after = [loop], [t[begin : end + 1]], [[0]]
    if begin > 0:
        parts, times, after = [rows[: begin + 1], loop], [t[: begin + 1], times[0]], [[1], [1]]
    return PathWays(_path_graph(parts, times, after, half_width_m), True, n * dt_s)


def _pose(state: TargetState) -> list[float]:
    w, x, y, z = state.q_world.tolist()
    px, py, pz = state.p_world.tolist()
    return [px, py, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), pz]


def _steps(rows: Array) -> Array:
    """Return the distances between poses (n, 4), x, y, heading, z; (n - 1,), m."""
    return np.asarray(np.linalg.norm(np.diff(rows[:, _PLACE], axis=0), axis=1))


def _lap(rows: Array) -> tuple[int, int]:
    """Return the first and last sample of the last lap of a path that closes; (-1, -1) if it does not."""
    last = rows[-1]
    near = np.linalg.norm(rows[:, _PLACE] - last[_PLACE], axis=1)
    turned = np.abs(np.remainder(rows[:, 2] - last[2] + math.pi, 2.0 * math.pi) - math.pi)
    step = float(_steps(rows).max())
    close = (near < max(_CLOSED_M, 0.6 * step)) & (turned < _CLOSED_RAD + 0.05)
    far = np.flatnonzero(~close)
    if len(far) == 0:
        return -1, -1
    earlier = np.flatnonzero(close[: far[-1]])
    if len(earlier) == 0:
        return -1, -1
    # the last visit before the present one: the nearest sample of its run
    run = earlier[earlier > earlier[-1] - 10]
    period = len(rows) - 1 - int(run[np.argmin(near[run])])
    # the way closes where everything that follows comes again a lap later
    apart = np.linalg.norm(rows[period:, _PLACE] - rows[:-period, _PLACE], axis=1)
    still = np.flatnonzero(apart > max(_CLOSED_M, 0.6 * step))
    begin = int(still[-1]) + 1 if len(still) else 0
    return begin, begin + period


def _path_graph(parts: list[Array], times: list[Array], after: list[list[int]], width: float) -> Ways:
    flies = any(p[:, 3].any() for p in parts)
    if flies:
        roads = arcs_from_lanes([[p[:, _PLACE]] for p in parts], after)
    else:
        roads = arcs_from_polylines([p[:, :2] for p in parts], after)
    at = [np.r_[0.0, np.cumsum(_steps(p))] for p in parts]
    entries = np.zeros(len(parts), dtype=bool)
    entries[0] = True
    rows = np.concatenate(parts)
    return Ways(
        roads,
        np.cumsum([0, *map(len, parts)]).astype(np.int64),
        np.concatenate(at),
        rows[:, :2],
        rows[:, 2],
        np.concatenate([t - t[0] for t in times]),
        entries,
        width,
        anywhere=False,
        height_m=rows[:, 3] if flies else None,
    )

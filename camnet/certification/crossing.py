r"""Verdict for one exit of one target: is it certain to be seen again, where, and by when.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| r(tau) | ``Reach.disc`` | m | disc that holds the target |
| depth(p) | ``PlanarView.depth`` | m | largest disc about p inside a view |
| R, v_agent, d_bar | ``MobileAgent`` | m, m/s, m/s | of a mobile camera, harris2020 (4-6) |

Stationary cameras: certified when the disc is inside one view at some tau <= Dt_off and stays there long enough for
Dt_on. Mobile cameras: the disc must fit the footprint about the meeting point and the agent must get there in time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from camnet.certification.planar_shapes import PolygonView
from camnet.certification.reachable import PlanarView, Reach
from camnet.types import Array

__all__ = ["Crossing", "MobileAgent", "RegionAgent", "certify_crossing", "certify_meeting", "meeting"]


@dataclass(frozen=True, slots=True)
class Crossing:
    """Verdict for one exit.

    Attributes
    ----------
    verdict : ``certified`` or ``not certified``
    view : number of the view (or agent) that sees the target again for certain; of the closest miss otherwise; -1: none
    time_s : time at which it is certainly seen, s (nan when not certified)
    margin_m : largest depth less radius over all times and views, m
    margin_s : Dt_off less the time, s (-inf when it is never certain)
    binding : the constraint that decides
    earliest_s : first time at which the target can be in any view, s (inf: not within the times looked at)
    """

    verdict: str
    view: int
    time_s: float
    margin_m: float
    margin_s: float
    binding: str
    earliest_s: float


@dataclass(frozen=True, eq=False)
class MobileAgent:
    """A mobile camera: position (2,) when the target is lost, top speed, disturbance bound, footprint radius R.

    ``ramp_s`` is added for gathering and losing speed.
    """

    position: Array
    speed_mps: float
    disturbance_mps: float
    footprint_m: float
    ramp_s: float = 0.0

    def ready_s(self, point: Array) -> float:
        """Return when the agent can be at a point for certain, s."""
        net = self.speed_mps - self.disturbance_mps
        away = float(np.linalg.norm(point - self.position))
        if away == 0.0:
            return 0.0
        return away / net + self.ramp_s if net > 0.0 else math.inf


@dataclass(frozen=True, eq=False)
class RegionAgent:
    """A mobile camera that may be anywhere in its region when the target is lost elsewhere.

    ``outline`` (K, 2) are the region's corners; the rest as in ``MobileAgent``. The extent of the target is taken
    off ``footprint_m`` already. In a region that is not convex the straight way to a point must be free from
    everywhere, which is so if it is free from every corner.
    """

    outline: Array
    speed_mps: float
    disturbance_mps: float
    footprint_m: float
    ramp_s: float = 0.0

    def reaches(self, point: Array) -> bool:
        """Whether the straight way to a point (2,) is inside the region from everywhere in it."""
        region = shapely.Polygon(self.outline)
        if region.convex_hull.area <= region.area * (1.0 + 1e-9):
            return True
        ways = shapely.linestrings([[corner, point] for corner in self.outline])
        return bool(shapely.covers(region.buffer(1e-9), ways).all())

    def farthest_from(self, point: Array) -> MobileAgent:
        """Return the agent at the corner of its region that is farthest from a point (2,)."""
        away = np.linalg.norm(self.outline - point, axis=1)
        corner = self.outline[int(np.argmax(away))]
        if not self.reaches(point):
            return MobileAgent(corner, 0.0, 0.0, self.footprint_m, self.ramp_s)
        return MobileAgent(corner, self.speed_mps, self.disturbance_mps, self.footprint_m, self.ramp_s)


def certify_crossing(
    reach: Reach,
    views: Sequence[PlanarView | PolygonView],
    times_s: Array,
    off_max_s: float,
    on_min_s: float,
    v_max_mps: float,
) -> Crossing:
    """Decide whether a target lost at one place is certain to be seen by some fixed camera.

    Parameters
    ----------
    reach : target class at the exit
    views : views of the other cameras, cut with the target's plane
    times_s : (n,) evenly spaced times to look at, from 0
    off_max_s, on_min_s : dwell times
    v_max_mps : bound of the target's speed, for what happens between the times
    """
    discs = [reach.disc(float(t)) for t in times_s]
    centres, radii = np.array([c for c, _ in discs]), np.array([r for _, r in discs])
    step = float(times_s[1] - times_s[0]) if len(times_s) > 1 else 0.0
    hold = 1 + math.ceil(on_min_s / step) if step > 0.0 else 1
    pad = 0.5 * v_max_mps * step if on_min_s > 0.0 else 0.0
    depth = np.array([view.depth(centres) for view in views]).reshape(len(views), len(times_s))
    spare = depth - radii - pad
    possible = np.flatnonzero((depth > -radii).any(axis=0)) if len(views) else np.array([], dtype=int)
    earliest = float(times_s[possible[0]]) if len(possible) else math.inf
    if len(views) == 0:
        return Crossing("not certified", -1, math.nan, -math.inf, -math.inf, "no view", earliest)
    held = _runs(spare >= 0.0, hold)
    return _decide(spare, held, times_s, off_max_s, earliest)


def _runs(good: Array, hold: int) -> Array:
    """Whether ``hold`` consecutive times starting at each are all good, (views, times)."""
    count = np.cumsum(np.pad(good, ((0, 0), (1, 0))), axis=1)
    out = np.zeros(good.shape, dtype=bool)
    if good.shape[1] >= hold:
        out[:, : good.shape[1] - hold + 1] = count[:, hold:] - count[:, :-hold] == hold
    return out


def _decide(spare: Array, held: Array, times_s: Array, off_max_s: float, earliest: float) -> Crossing:
    best = int(np.argmax(spare.max(axis=1)))
    margin = float(spare.max())
    sure = np.flatnonzero(held.any(axis=0))
    if len(sure) == 0:
        binding = "time in view" if margin >= 0.0 else "size of the ball"
        return Crossing("not certified", best, math.nan, margin, -math.inf, binding, earliest)
    k = int(sure[0])
    view, time = int(np.argmax(held[:, k])), float(times_s[k])
    verdict = "certified" if time <= off_max_s else "not certified"
    binding = "time out of view" if off_max_s - time < margin else "size of the ball"
    return Crossing(
        verdict,
        view,
        time if verdict == "certified" else math.nan,
        margin,
        off_max_s - time,
        binding,
        earliest,
    )


def certify_meeting(
    reach: Reach, agents: Sequence[MobileAgent], entry_s: float, off_max_s: float, extent_m: float
) -> Crossing:
    """Decide whether some mobile camera meets a target at the predicted entry of its region.

    Parameters
    ----------
    reach : target class at the exit; its disc at ``entry_s`` is where the agents wait
    agents : those whose regions hold the meeting point
    entry_s : predicted time of entry
    off_max_s : dwell time out of view
    extent_m : radius of the target's extent
    """
    centre, radius = reach.disc(entry_s)
    best = Crossing("not certified", -1, math.nan, -math.inf, -math.inf, "no agent", math.inf)
    for number, agent in enumerate(agents):
        room = agent.footprint_m - radius - extent_m
        spare = entry_s - agent.ready_s(centre)
        limits = {"size of the ball": room, "agent's speed": spare, "time out of view": off_max_s - entry_s}
        binding = min(limits, key=lambda name: limits[name])
        good = limits[binding] >= 0.0
        found = Crossing(
            "certified" if good else "not certified",
            number,
            entry_s if good else math.nan,
            room,
            min(spare, off_max_s - entry_s),
            binding,
            entry_s,
        )
        if (found.verdict == "certified", found.margin_m) > (best.verdict == "certified", best.margin_m):
            best = found
    return best


def meeting(reach: Reach, into: Crossing, agents: Sequence[RegionAgent | None], off_max_s: float) -> Crossing:
    """Add the agent's constraints to a crossing into a region: once the ball is wholly inside, it has to be there.

    Parameters
    ----------
    reach : target class at the exit
    into : verdict of ``certify_crossing`` with the regions as views
    agents : one for each region, their footprints less the target's extent; None: a fixed camera's view
    off_max_s : dwell time out of view
    """
    chosen = agents[into.view] if into.verdict == "certified" else None
    if chosen is None:
        return into
    place = reach.disc(into.time_s)[0]
    met = certify_meeting(reach, [chosen.farthest_from(place)], into.time_s, off_max_s, 0.0)
    if not chosen.reaches(place):
        met = replace(met, binding="straight way in a region that is not convex")
    binding = met.binding if met.margin_m < into.margin_m or met.margin_s < into.margin_s else into.binding
    return Crossing(
        met.verdict,
        into.view,
        met.time_s,
        min(into.margin_m, met.margin_m),
        min(into.margin_s, met.margin_s),
        binding,
        into.earliest_s,
    )

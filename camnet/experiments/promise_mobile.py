r"""The promise of a network with agents: what an agent can hold in view, where it can be in time, and how many targets.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| R | ``view_radius`` | m | largest disc on the ground, less the target's extent, that the camera holds at its height |
| t_agent | ``RegionAgent`` | s | time to the meeting point from the worst corner of its region |
| t_target | ``shortest_m / v_max`` | s | earliest time at which the target is there |

The handoff rule sends an agent to one target at a time, so it serves one, or as many as are always in view beside the
one that it follows. Where the next agent has to be is told by the estimate: without a ``learned`` certificate of a
transition nothing is promised behind it. Agents that expect nobody wait in the middle of their regions and look
straight down; only that, and fixed cameras, count on the way into the first view.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from camnet.certification.planar_shapes import cover_regions
from camnet.certification.promise import Promise, UnseenWay
from camnet.certification.transitions import TransitionTable
from camnet.certification.ways import Ways, join_coverage
from camnet.control.setpoints import half_angle, loiter, working_height
from camnet.experiments.certify_flow import region_agents
from camnet.experiments.promise_world import (
    Limit,
    Watched,
    fixed_views,
    seen_ways,
    solids_of,
    target_features,
    watch,
)
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import feature_extent, view_radius
from camnet.simulation.network import Network
from camnet.types import Array

if TYPE_CHECKING:
    from camnet.experiments.certify_road_world import RoadWorld

__all__ = [
    "apply_refusals",
    "capacity",
    "first_view",
    "mobile_promise",
    "mobile_road_promise",
    "standing_refusals",
]

_NO_MODEL = "where the next agent has to be rests on a prediction, and no motion model was given"
#: at most this many refusals of one kind are listed
_MOST = 6


def standing_refusals(network: Network, v_max_mps: float) -> list[str]:
    """Return what keeps agents from following any target of the class, in words."""
    control = network.scenario.controller
    net = control.reference_v_max_mps - control.d_bar_mps
    out = []
    if net < v_max_mps:
        out.append(
            f"an agent flies at {control.reference_v_max_mps:g} m/s less a disturbance of {control.d_bar_mps:g} m/s: "
            f"it cannot follow a target of {v_max_mps:g} m/s"
        )
    for j in range(network.n_agents):
        region = network.regions[j]
        outline = shapely.Polygon(region.footprint())
        inside = [
            occluder.name
            for occluder in network.occluders
            if shapely.Polygon(occluder.footprint()).intersects(outline)
            and occluder.height[0] < region.height[1]
        ]
        if inside:
            out.append(
                f"region {region.name}: {', '.join(inside)} may stand in the way and in the view of its agent, for "
                "which neither its time of arrival nor its sight is bounded"
            )
    return out


def capacity(network: Network, ways: Ways) -> int | None:
    """Return how many targets at once the agents serve, None for any number: the least over all regions.

    An agent that follows a target hovers at its working height; another target is in view too if it is within the
    disc that the camera holds from there, wherever both are on the ways in the region.
    """
    settings = network.scenario.controller
    extent = feature_extent(network)
    for j in range(network.n_agents):
        camera = network.cameras[j]
        inside = shapely.contains_xy(shapely.Polygon(network.regions[j].footprint()), *ways.xy.T)
        places = ways.xy[inside]
        if len(places) < 2:
            continue
        height = working_height(camera, settings.target_extent_m, settings)
        held = height * math.sin(half_angle(camera)) - extent
        hull = shapely.get_coordinates(shapely.multipoints(places).convex_hull)
        if float(np.linalg.norm(hull[:, None] - hull, axis=-1).max()) > held:
            return 1
    return None


def first_view(network: Network, ways: Ways) -> Watched:
    """Watch ways with the fixed cameras and with agents that wait: what is sure to see a target first."""
    settings, extent = network.scenario.controller, feature_extent(network)
    outlines = []
    for j in range(network.n_agents):
        camera, region = network.cameras[j], network.regions[j]
        rest = loiter(region, camera, settings).p_world
        top = float(max(t.features_m[:, 2].max() for t in network.description.targets))
        radius = max((float(rest[2]) - top) * math.tan(half_angle(camera)), 0.0)
        disc = (
            shapely.Point(rest[:2])
            .buffer(max(radius, 1e-6))
            .intersection(shapely.Polygon(region.footprint()))
        )
        outlines.append(np.asarray(shapely.get_parts(disc)[0].exterior.coords)[:-1])
    part = cover_regions(
        ways.roads, outlines, extent, [view_radius(network, j) for j in range(network.n_agents)]
    )
    views, _ = fixed_views(network)
    if views is not None:
        seen = seen_ways(network, ways, views, solids_of(network), target_features(network))
        part = join_coverage(part, seen, network.n_agents)
    return watch(ways, part)


def mobile_promise(
    network: Network,
    first: Watched,
    *,
    unseen: UnseenWay | None,
    refusals: Sequence[str],
    limit: Limit,
    target_class: str,
    targets: Sequence[str],
    at_once: int,
    served: int | None,
    span: str,
) -> Promise:
    """Return the promise of a network with agents; ``unseen`` is the longest unseen stretch between two views.

    Where something is refused nothing is promised, and the stretch is not bounded.
    """
    names = [region.name for region in network.regions]
    time, kind, _, after = first.in_s.into_first
    into = UnseenWay(
        kind, first.in_m.into_first[0], time, None, names[after] if after >= 0 else None, ", ".join(targets)
    )
    words = list(refusals)
    if not math.isfinite(time):
        words.append(
            "nobody is sure to see a target first: agents that expect nobody watch the middle of their regions, and a "
            "target can stay off it without end"
        )
    ways = [w for w in (unseen, into) if w is not None and w.length_m > 0.0]
    longest = max(ways, key=lambda w: (w.time_s, w.length_m), default=None)
    bounded = not words
    return Promise(
        target_class=target_class,
        unseen_max_m=max((w.length_m for w in ways), default=0.0) if bounded else math.inf,
        unseen_max_s=max((w.time_s for w in ways), default=0.0) if bounded else math.inf,
        longest=longest if bounded else None,
        into_first=into if time > 0.0 else None,
        targets=tuple(targets),
        at_once=at_once,
        served=served,
        cameras=len(network.description.cameras),
        agents=network.n_agents,
        limit_m=limit.off_m,
        limit_s=limit.off_s,
        limit_source=limit.source,
        span=span,
        nobody_sees=(),
        never_seen_m=first.in_m.never_seen if not first.in_m.some_seen else 0.0,
        refusals=tuple(words),
    )


def mobile_road_promise(
    case: RoadWorld,
    tables: dict[str, TransitionTable],
    limit: Limit,
    targets: Sequence[str],
    *,
    at_once: int,
    target_class: str,
) -> Promise:
    """Return the promise for road-bound targets: every transition's agent is there first, and knows where to be."""
    network, v_max = case.network, case.target.v_max_mps
    refusals = standing_refusals(network, v_max)
    refusals += _late(case, v_max) + _many_entries(case)
    learned = tables.get("learned")
    if learned is None:
        refusals.append(_NO_MODEL + " (--model-error)")
    else:
        bad: list[int] = np.flatnonzero(~learned.certified).tolist()
        if bad:
            refusals.append(
                f"the estimate does not survive {len(bad)} of {len(learned.certified)} ways between views: "
                f"{learned.binding[bad[0]]}"
            )
    found = case.watched
    time, kind, before, after = found.in_s.longest
    names = [g.name for g in case.ground]
    unseen = UnseenWay(
        kind,
        found.in_m.longest[0],
        time,
        names[before] if before >= 0 else None,
        names[after] if after >= 0 else None,
        ", ".join(targets),
    )
    if not math.isfinite(time):
        refusals.append("unseen roads lead in a circle: the target may stay on them for ever")
    return mobile_promise(
        network,
        first_view(network, found.ways),
        unseen=unseen if kind == "between views" else None,
        refusals=refusals,
        limit=limit,
        target_class=target_class,
        targets=targets,
        at_once=at_once,
        served=capacity(network, found.ways),
        span="from where it begins on its road, for ever",
    )


def _entries(case: RoadWorld) -> list[tuple[int, int, int, Array]]:
    """Return (transition, view left, view entered, place of entry) of all transitions into agents' regions."""
    seen, roads = case.gaps.stretches, case.watched.ways.roads
    out = []
    for k, (leave, into) in enumerate(
        zip(case.gaps.exit_stretch.tolist(), case.gaps.entry_stretch.tolist(), strict=True)
    ):
        camera = int(seen.entry_camera[into])
        if camera < case.network.n_agents:
            place = roads.position(int(seen.arc[into]), float(seen.start_m[into]))
            out.append((k, int(seen.exit_camera[leave]), camera, place))
    return out


def _late(case: RoadWorld, v_max_mps: float) -> list[str]:
    """List the transitions whose target can be at the entry before the agent."""
    agents = region_agents(case.network) or []
    worst: dict[tuple[int, int], tuple[float, float, float]] = {}
    for k, source, camera, place in _entries(case):
        agent = agents[camera]
        if agent is None:
            continue
        ready = agent.farthest_from(place).ready_s(place)
        comes = float(case.gaps.shortest_m[k]) / v_max_mps
        if ready > comes:
            known = worst.get((source, camera), (0.0, 0.0, 0.0))
            worst[source, camera] = max(known, (ready - comes, ready, comes))
    names = [g.name for g in case.ground]
    rows = sorted(worst.items(), key=lambda item: -item[1][0])
    out = [
        f"from {names[a]} to {names[b]}: from the worst corner of its region the agent needs {ready:.1f} s to the "
        f"entry, the target may be there after {comes:.1f} s"
        for (a, b), (_, ready, comes) in rows[:_MOST]
    ]
    return out + ([f"... and {len(rows) - _MOST} more transitions"] if len(rows) > _MOST else [])


def _many_entries(case: RoadWorld) -> list[str]:
    """List the exits behind which a target may enter one region at places too far apart for one footprint."""
    groups: dict[tuple[int, int], list[Array]] = {}
    for k, _, camera, place in _entries(case):
        groups.setdefault((int(case.gaps.exit_stretch[k]), camera), []).append(place)
    names = [g.name for g in case.ground]
    out: dict[tuple[int, int], str] = {}
    for (leave, camera), places in groups.items():
        spots = np.array(places)
        apart = float(np.linalg.norm(spots[:, None] - spots, axis=-1).max())
        radius = view_radius(case.network, camera)
        source = int(case.gaps.stretches.exit_camera[leave])
        if apart > 2.0 * radius:
            out[source, camera] = (
                f"from {names[source]} to {names[camera]}: the target may enter at places {apart:.1f} m apart, the "
                f"agent's footprint holds {2.0 * radius:.1f} m"
            )
    return list(out.values())[:_MOST]


def flow_refusals(network: Network, learned: dict[str, Any] | None) -> list[str]:
    """Return what keeps agents from meeting a target that follows a field, in words."""
    out = standing_refusals(network, network.scenario.targets[0].v_max_mps)
    if learned is None:
        return [*out, _NO_MODEL + " (--learn or --model)"]
    if learned["certificates"]["learned"]["verdict"] != "certified":
        bad = [t for t in learned["transitions"] if t["learned"]["verdict"] != "certified"]
        words = [f"from {t['from']} to {t['to']}: {t['learned']['binding']}" for t in bad[:_MOST]]
        out.append(
            "the estimate does not survive every transition"
            + (f" ({'; '.join(words)})" if words else f": {learned['certificates']['learned']['reason']}")
        )
    return out


def apply_refusals(report: dict[str, Any], lines: list[MapLine], promise: Promise) -> list[MapLine]:
    """Mark every transition of a network that is refused, in the report and on the map, and return the map's lines.

    A region is no view: what is refused of the agents holds for each gap between their regions.
    """
    if not promise.refusals:
        return lines
    for entry in report["transitions"]:
        own = [r for r in promise.refusals if r.startswith(f"from {entry['from']} to {entry['to']}: ")]
        if "unseen" in entry:
            words = (own or list(promise.refusals))[0]
            entry["unseen"] |= {
                "verdict": "not certified",
                "margin_m": None,
                "margin_s": None,
                "binding": words,
            }
    report["uncertified"] = [{"from": t["from"], "to": t["to"]} for t in report["transitions"]]
    words = "; ".join(promise.refusals[:3])
    return [
        replace(line, verdict="not certified", words=f"{line.words}; {words}")
        if line.verdict == "certified"
        else line
        for line in lines
    ]

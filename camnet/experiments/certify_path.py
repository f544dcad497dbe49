"""Certify a world whose target follows a velocity field: one path, which the simulator itself drives.

``unseen`` follows that path with the simulator's visibility. ``sound`` compares its gaps with the dwell times that the
estimator's analysis proves, ``learned`` follows tubes along the learned flow (``certify_flow``).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from camnet.certification.free_network import GroundView
from camnet.certification.model_error import ModelError
from camnet.certification.planar_shapes import cover_regions
from camnet.certification.promise import Promise, UnseenWay, with_claims
from camnet.certification.ways import join_coverage
from camnet.errors import CertificateError
from camnet.experiments.certified import Certified, dwell_times
from camnet.experiments.certify_flow import certify_learned, flow_case, ground_of
from camnet.experiments.learned_model import LearnedModel
from camnet.experiments.promise_mobile import (
    apply_refusals,
    capacity,
    first_view,
    flow_refusals,
    mobile_promise,
)
from camnet.experiments.promise_world import (
    Limit,
    Watched,
    blind_of,
    fixed_views,
    promise_of,
    seen_ways,
    solids_of,
    target_features,
    watch,
)
from camnet.experiments.published_world import published_on_ways
from camnet.experiments.world_ways import PathWays, path_ways
from camnet.motion.field_motion import FieldMotion
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import view_radius
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["best_verdict", "certify_on_path", "words_of"]

#: step of the path, s, and the least time that it is followed, s
_STEP_S, _LEAST_S = 0.05, 300.0


_IN_SPACE = {"verdict": "refused", "reason": "the target leaves the ground; views are measured on it"}


@dataclass(frozen=True, eq=False)
class PathGap:
    """One unseen stretch of the path: views before and after, length, duration, time in view after it, places."""

    source: int
    sink: int
    length_m: float
    time_s: float
    on_s: float
    points: Array


def certify_on_path(
    network: Network,
    model: LearnedModel | None,
    model_error_mps: ModelError,
    find_largest: bool,
    limit: Limit,
    *,
    on_min_s: float | None = None,
    at_once: int,
) -> Certified:
    """Certify a network for its one target, which follows a field; ``at_once`` such targets at the same time."""
    ground = ground_of(network)
    followed = follow(network)
    watched = _watched(network, followed)
    gaps = path_gaps(watched)
    off, on, source = dwell_times(network)
    wide = {(g.source, g.sink): g for g in path_gaps(_watched(_widened(network), followed))}
    entries = {
        (ground[g.source].name, ground[g.sink].name): {
            "from": ground[g.source].name,
            "to": ground[g.sink].name,
            "gap_m": g.length_m,
            "longest_m": g.length_m,
            "gap_s": g.time_s,
            "unseen": _unseen(g, limit, on_min_s),
            "sound": _sound(wide.get((g.source, g.sink), g), off, on),
        }
        for g in gaps
    }
    for (source_, sink), g in wide.items():  # views that overlap on the path alone
        pair = ground[source_].name, ground[sink].name
        entries.setdefault(
            pair, {"from": pair[0], "to": pair[1], "gap_m": g.length_m, "sound": _sound(g, off, on)}
        )
    v_max = network.scenario.targets[0].v_max_mps
    report: dict[str, Any] = {
        "network": {"cameras": len(ground), "regions": network.n_agents},
        "target_class": f"{_kind(network)}, at most {v_max:g} m/s",
        "certificates": {"sound": _verdict(list(entries.values()), "sound", off)},
        "constants": {
            "off_max_s": limit.off_s,
            "off_max_m": limit.off_m,
            "on_min_s": on_min_s or 0.0,
            "limit_source": limit.source,
            "dwell_off_max_s": off,
            "dwell_on_min_s": on,
            "dwell_source": source,
        },
    }
    learned = None
    if model is not None and followed.ways.height_m is not None:
        raise CertificateError(
            f"target {network.scenario.targets[0].name!r} leaves the ground, and 'learned' knows flows on it alone; "
            "leave --learn or --model out, 'unseen' needs neither"
        )
    if model is not None:
        learned = _learned(network, model, model_error_mps, find_largest, limit, report, entries, on_min_s)
    report["transitions"] = list(entries.values())
    report["uncertified"] = [
        {"from": t["from"], "to": t["to"]}
        for t in report["transitions"]
        if t.get("unseen", {}).get("verdict", "certified") != "certified"
    ]
    name = network.scenario.targets[0].name
    promise = _promise(
        network, followed, watched, learned, limit, ground, name, report["target_class"], at_once
    )
    if network.n_agents == 0:
        report["certificates"]["published"] = (
            published_on_ways(network, watched, ground) if followed.ways.height_m is None else dict(_IN_SPACE)
        )
    lines = [MapLine(_whole(watched), "seen", "in view")]
    lines += [
        MapLine(g.points, best_verdict(e), words_of(e))
        for g in gaps
        if (e := entries[ground[g.source].name, ground[g.sink].name])
    ]
    outlines = [ring for g in ground for ring in g.rings]
    lines = apply_refusals(report, lines, promise)
    return Certified(with_claims(report, promise), outlines, lines, promise)


def _kind(network: Network) -> str:
    motion = network.description.targets[0].motion
    if not isinstance(motion, FieldMotion) or motion.law is None:
        return "vector field"
    where = "in space" if motion.law.dimensions == 3 else "on the ground"
    slope = motion.lipschitz_per_s
    steep = "" if slope is None else f", slope at most {slope:g} 1/s"
    return f"stated law of motion {where}{steep}"


def follow(network: Network) -> PathWays:
    """Follow the network's first target for as long as a run, and at least until it can have gone round."""
    motion = network.description.targets[0].motion
    at_least = max(_LEAST_S, network.scenario.run.duration_s)
    return path_ways(motion, at_least, _STEP_S, network.scenario.certificate.corridor_m)


def _watched(network: Network, followed: PathWays) -> Watched:
    ways = followed.ways
    agents = range(network.n_agents)
    outlines = [network.regions[j].footprint() for j in agents]
    part = cover_regions(ways.roads, outlines, 0.0, [view_radius(network, j) for j in agents])
    views, _ = fixed_views(network)
    if views is not None:
        seen = seen_ways(network, ways, views, solids_of(network), target_features(network))
        part = join_coverage(part, seen, network.n_agents)
    return watch(ways, part)


def path_gaps(watched: Watched) -> list[PathGap]:
    """List the unseen stretches between views, the longest one for each pair of views; a closed path counts once."""
    ways, seen = watched.ways, watched.stretches
    arcs, starts, ends = seen.arc.tolist(), seen.start_m.tolist(), seen.end_m.tolist()
    if not arcs:
        return []
    loop = ways.roads.n_arcs - 1
    on_loop = [k for k, a in enumerate(arcs) if a == loop]
    order = list(range(len(arcs)))
    if on_loop and len(ways.roads.successor):
        order += on_loop  # one more lap, so that its last view has one after it
    best: dict[tuple[int, int], PathGap] = {}
    for k, j in itertools.pairwise(order):
        again = arcs[j] != arcs[k] or starts[j] < ends[k]
        parts = [(arcs[k], ends[k], starts[j])]
        if again:
            parts = [(arcs[k], ends[k], float(ways.roads.length_m[arcs[k]])), (arcs[j], 0.0, starts[j])]
        length = sum(b - a for _, a, b in parts)
        if length <= 1e-3:
            continue
        cuts = [_times(ways, part) for part in parts]
        spent = sum(cut[1] - cut[0] for cut in cuts)
        on = _times(ways, (arcs[j], starts[j], ends[j]))
        points = np.concatenate([_places(ways, part) for part in parts])
        gap = PathGap(
            int(seen.exit_camera[k]), int(seen.entry_camera[j]), length, spent, on[1] - on[0], points
        )
        key = gap.source, gap.sink
        if key not in best or best[key].time_s < gap.time_s:
            best[key] = gap
    return list(best.values())


def _times(ways: Any, part: tuple[int, float, float]) -> tuple[float, float]:  # noqa: ANN401 - Ways
    arc, a, b = part
    t = ways.time(np.array([arc, arc]), np.array([a, b]))
    return float(t[0]), float(t[1])


def _places(ways: Any, part: tuple[int, float, float]) -> Array:  # noqa: ANN401 - Ways
    arc, a, b = part
    n = max(2, math.ceil((b - a) / 0.1) + 1)
    xy: Array = ways.pose(np.full(n, arc), np.linspace(a, b, n))[0]
    return xy


def _whole(watched: Watched) -> Array:
    return watched.ways.xy[::2]


def _unseen(gap: PathGap, limit: Limit, on_min_s: float | None) -> dict[str, Any]:
    spare_s = math.inf if limit.off_s is None else limit.off_s - gap.time_s
    spare_m = math.inf if limit.off_m is None else limit.off_m - gap.length_m
    spare_on = gap.on_s - (on_min_s or 0.0)
    good = spare_s >= 0.0 and spare_m >= 0.0 and spare_on >= 0.0
    binding = "time in view" if spare_on < min(spare_s, spare_m, 0.0) else "time out of view"
    return {
        "verdict": "certified" if good else "not certified",
        "margin_m": spare_m if math.isfinite(spare_m) else None,
        "margin_s": spare_s if math.isfinite(spare_s) else None,
        "binding": binding,
    }


def _widened(network: Network) -> Network:
    """Return the network with a target as wide as its corridor: a place counts as seen where all of the tube is.

    Targets of the class drive within ``corridor_m`` of the path; the gap of ``sound`` is that of the least lucky.
    """
    first, *others = network.description.targets
    c = network.scenario.certificate.corridor_m
    shifts = np.array([[0.0, 0.0, 0.0], [0.0, c, 0.0], [0.0, -c, 0.0], [c, 0.0, 0.0], [-c, 0.0, 0.0]])
    features = (np.asarray(first.features_m)[:, None] + shifts).reshape(-1, 3)
    targets = (replace(first, features_m=features), *others)
    return replace(network, description=replace(network.description, targets=targets))


def _sound(gap: PathGap, off: float | None, on: float | None) -> dict[str, Any]:
    if off is None:
        words = "no dwell time exists: the floor of the error is above the level that the view allows"
        return {"verdict": "unsatisfiable", "margin_m": None, "margin_s": None, "binding": words}
    out_s, in_s = off - gap.time_s, gap.on_s - (on or 0.0)
    margin = min(out_s, in_s)
    speed = gap.length_m / gap.time_s if gap.time_s > 0.0 else 0.0
    return {
        "verdict": "certified" if margin >= 0.0 else "not certified",
        "margin_m": speed * margin if math.isfinite(margin) else None,
        "margin_s": margin if math.isfinite(margin) else None,
        "binding": "time out of view" if out_s <= in_s else "time in view",
        "trust_horizon_s": off,
    }


def _verdict(transitions: Sequence[dict[str, Any]], name: str, off: float | None) -> dict[str, Any]:
    verdicts = [t[name]["verdict"] for t in transitions if name in t]
    good = sum(v == "certified" for v in verdicts)
    whole = "certified" if good == len(verdicts) and off is not None else "not certified"
    if off is None:
        whole = "unsatisfiable"
    return {"verdict": whole, "reason": f"{good} of {len(verdicts)} transitions are certified"}


def _learned(
    network: Network,
    model: LearnedModel,
    model_error_mps: ModelError,
    find_largest: bool,
    limit: Limit,
    report: dict[str, Any],
    entries: dict[tuple[str, str], dict[str, Any]],
    on_min_s: float | None,
) -> dict[str, Any]:
    """Add the ``learned`` certificate to report and transitions, and return it."""
    case = flow_case(network, model, model_error_mps, limit.off_s, on_min_s)
    learned: dict[str, Any] = certify_learned(case, find_largest)
    report["target_class"] = learned["target_class"]
    report["certificates"]["learned"] = learned["certificates"]["learned"]
    report["constants"] |= learned["constants"] | {
        "model_error_mps": case.target.model_error_mps,
        "initial_error_m": case.target.e0_m,
        "corridor_m": case.target.spread_m,
        "learned_off_max_s": case.off_max_s,
        "learned_on_min_s": case.on_min_s,
    }
    for entry in learned["transitions"]:
        key = entry["from"], entry["to"]
        entries.setdefault(key, {k: entry[k] for k in ("from", "to", "gap_m")})["learned"] = entry["learned"]
    return learned


def _promise(
    network: Network,
    followed: PathWays,
    watched: Watched,
    learned: dict[str, Any] | None,
    limit: Limit,
    ground: Sequence[GroundView],
    name: str,
    target_class: str,
    at_once: int,
) -> Promise:
    span = followed.span
    names = [g.name for g in ground]
    if network.n_agents == 0:
        return promise_of(
            [watched],
            names,
            target_class=target_class,
            targets=[name],
            limit=limit,
            at_once=at_once,
            span=span,
            blind=blind_of(network, watched),
        )
    return mobile_promise(
        network,
        first_view(network, watched.ways),
        unseen=_met(watched, learned, name),
        refusals=flow_refusals(network, learned),
        limit=limit,
        target_class=target_class,
        targets=[name],
        at_once=at_once,
        served=capacity(network, watched.ways),
        span=span,
    )


def _met(watched: Watched, learned: dict[str, Any] | None, name: str) -> UnseenWay | None:
    """Return the longest time until an agent is certain to see the target again: its whole ball is in the region."""
    if learned is None or not learned["transitions"]:
        return None
    known = [t for t in learned["transitions"] if t["learned"].get("seen_again_s") is not None]
    if not known:
        return None
    worst = max(known, key=lambda t: float(t["learned"]["seen_again_s"]))
    seconds = float(worst["learned"]["seen_again_s"])
    speed = _top_speed(watched)
    return UnseenWay("between views", speed * seconds, seconds, worst["from"], worst["to"], name)


def _top_speed(watched: Watched) -> float:
    """Return the highest speed on the path, m/s; the last step of an arc closes it and is left out."""
    ways = watched.ways
    inner = np.ones(len(ways.at_m) - 1, dtype=bool)
    inner[ways.sample_ptr[1:-1] - 1] = False
    inner[ways.sample_ptr[1:] - 2] = False
    speed: Array = np.diff(ways.at_m)[inner] / np.diff(ways.time_s)[inner]
    return float(speed.max())


def best_verdict(entry: dict[str, Any]) -> str:
    """Return the colour of a transition on maps: that of ``unseen``, where it was asked."""
    return str(entry.get("unseen", entry.get("learned", {})).get("verdict", "not certified"))


def words_of(entry: dict[str, Any]) -> str:
    """Return what is shown over a line of the map."""
    parts = [f"{entry['from']} to {entry['to']}, {entry['gap_m']:.3g} m unseen"]
    for name in ("unseen", "sound", "learned"):
        if name in entry:
            v = entry[name]
            margin = "" if v["margin_m"] is None else f", margin {v['margin_m']:.3g} m"
            parts.append(f"{name}: {v['verdict']}{margin} ({v['binding']})")
    return "; ".join(parts)

"""Certify a world file: every transition of its network with every certificate, and what a map of it shows.

| target of the world | class | ``sound`` | ``learned`` |
| --- | --- | --- | --- |
| ``vector_field`` | vector field | time out of view on its path against the dwell time | tube along the learned flow |
| ``road`` | road-bound | longest unseen way / v_lo | ball on the road, error growth stated |
| ``track`` | free | never certain; trust horizon | trust horizon |

Dwell times are those of the estimator's Lyapunov analysis, unless the designer states one (``off_max_s``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.certification.free_network import FreeTargetClass, GroundView, certify_free
from camnet.config.models import Scenario
from camnet.experiments.certified import Certified, dwell_times
from camnet.experiments.certify_flow import certify_learned, flow_case, ground_of, learned_path
from camnet.experiments.certify_road_world import certify_on_roads
from camnet.experiments.learned_model import LearnedModel
from camnet.experiments.target_groups import Models, TargetGroup, join_targets, target_groups
from camnet.motion.settings import RoadTarget, VectorFieldTarget
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import feature_extent, network_report
from camnet.simulation.network import Network, build_network
from camnet.types import Array

__all__ = ["certify_world", "free_lines", "nominal_path"]

#: step of the nominal path, s
_STEP_S = 0.05


def certify_world(
    scenario: Scenario,
    model: Models = None,
    *,
    off_max_s: float | None = None,
    model_error_mps: float | None = None,
    find_largest: bool = True,
) -> Certified:
    """Certify the network of a world for every target.

    Parameters
    ----------
    scenario : the world; its ``certificate.off_max_s`` is a dwell time that the designer states
    model : learned motion model of the first target, or of several by their names, for ``learned`` along a flow
    off_max_s : stated dwell time, instead of the world's
    model_error_mps : stated e_v, instead of the one from the world's own motion
    find_largest : also find the largest tolerable e_v of each transition, which takes most of the time
    """
    if off_max_s is not None:
        certificate = scenario.certificate.model_copy(update={"off_max_s": off_max_s})
        scenario = scenario.model_copy(update={"certificate": certificate})
    parts = {
        group.name: _one_class(group, model_error_mps, find_largest)
        for group in target_groups(scenario, model)
    }
    network = build_network(scenario)
    return _complete(network, join_targets(parts) if len(parts) > 1 else next(iter(parts.values())))


def _one_class(group: TargetGroup, model_error_mps: float | None, find_largest: bool) -> Certified:
    network = build_network(group.scenario)
    motion = group.scenario.targets[0].motion
    if isinstance(motion, RoadTarget):
        return certify_on_roads(network, motion, model_error_mps)
    if isinstance(motion, VectorFieldTarget) or group.model is not None:
        return _along_flow(network, group.model, model_error_mps, find_largest)
    return _free(network)


def _complete(network: Network, part: Certified) -> Certified:
    """Add the dwell-time report of the estimator to the transitions."""
    dwell: dict[str, Any] = network_report(network)
    report, own = part.report, part.report["certificates"]
    certificates = {}
    for name in ("published", "sound"):
        verdict = own.get(name, {})
        certificates[name] = {**dwell[name], **verdict}
        if name == "sound":
            certificates[name]["dwell_times"] = dwell[name]["reason"]
    if network.n_agents == 0 and dwell["published"]["verdict"] == "unsatisfiable":
        certificates["published"] |= {k: dwell["published"][k] for k in ("verdict", "reason")}
    if "learned" in own:
        certificates["learned"] = own["learned"]
    content = {
        "network": {
            "name": network.scenario.name,
            "cameras": len(network.cameras),
            "regions": len(network.scenario.regions),
        },
        "target_class": report["target_class"],
        "certificates": certificates,
        "transitions": report["transitions"],
        "uncertified": report["uncertified"],
        "constants": {**report["constants"], "sound": dwell["sound"]["constants"]},
        "gaps": dwell["gaps"],
        "assumptions": [*dwell["assumptions"], *_assumptions_of_regions(network)],
    }
    return Certified(content, part.views, part.lines)


def _assumptions_of_regions(network: Network) -> list[str]:
    """Return what is taken for granted of the agents' views."""
    if network.n_agents == 0:
        return []
    words = ["an agent sees its whole footprint at the meeting point, wherever the target is in it"]
    if network.occluders:
        words.append(
            "occluders hide nothing from an agent, which is taken to look from where they are not in the way; they "
            "take their shadows from the views of fixed cameras only"
        )
    return words


def nominal_path(network: Network, laps_s: float = 300.0) -> tuple[Array, Array]:
    """Return times (n,), s, and the path (n, 2), m, of the first target as the world itself moves it."""
    motion = network.description.targets[0].motion
    rng = np.random.default_rng(0)
    state = motion.reset(rng)
    points = [state.p_world[:2]]
    for k in range(round(laps_s / _STEP_S)):
        state = motion.step(state, k * _STEP_S, _STEP_S, rng)
        points.append(state.p_world[:2])
    return _STEP_S * np.arange(len(points), dtype=float), np.array(points)


@dataclass(frozen=True, slots=True)
class _Gap:
    """One time out of view on a path: views before and after, rows of the path, time until it is seen again, s."""

    source: int
    sink: int
    first: int
    last: int
    off_s: float
    on_s: float


def _gaps_of(t_s: Array, path: Array, ground: list[GroundView]) -> list[_Gap]:
    """List the gaps of a path, for each pair of views the longest one."""
    inside = np.array([g.view.depth(path) >= 0.0 for g in ground])
    seen = np.asarray(inside.any(axis=0))
    out: dict[tuple[int, int], _Gap] = {}
    leave = np.flatnonzero(seen[:-1] & np.logical_not(seen[1:]))
    for k in leave.tolist():
        back = np.flatnonzero(seen[k + 1 :])
        if len(back) == 0:
            continue
        into = k + 1 + int(back[0])
        again = np.flatnonzero(~seen[into:])
        on = float(t_s[into + again[0]] - t_s[into]) if len(again) else math.inf
        gap = _Gap(
            int(np.argmax(inside[:, k])),
            int(np.argmax(inside[:, into])),
            k,
            into,
            float(t_s[into] - t_s[k]),
            on,
        )
        key = gap.source, gap.sink
        if key not in out or out[key].off_s < gap.off_s:
            out[key] = gap
    return list(out.values())


def _along_flow(
    network: Network, model: LearnedModel | None, model_error_mps: float | None, find_largest: bool
) -> Certified:
    ground = ground_of(network)
    t_s, path = nominal_path(network)
    off, on, source = dwell_times(network, may_state=False)  # a hostile target need not keep the path's times
    gaps = _gaps_of(t_s, path, ground)
    speed = float(np.linalg.norm(np.diff(path, axis=0), axis=1).min() / _STEP_S)
    entries: dict[str, dict[str, Any]] = {}
    for gap in gaps:
        name = ground[gap.source].name
        length = float(np.linalg.norm(np.diff(path[gap.first : gap.last + 1], axis=0), axis=1).sum())
        entries[name] = {
            "from": name,
            "to": ground[gap.sink].name,
            "gap_m": length,
            "gap_s": gap.off_s,
            "sound": _sound(gap, off, on, speed),
        }
    report: dict[str, Any] = {
        "target_class": f"vector field, at most {network.scenario.targets[0].v_max_mps:g} m/s",
        "certificates": {},
        "constants": {"off_max_s": off, "on_min_s": on, "dwell_source": source},
    }
    if model is not None:
        case = flow_case(network, model, model_error_mps)
        learned = certify_learned(case, find_largest)
        report["target_class"] = learned["target_class"]
        report["certificates"]["learned"] = learned["certificates"]["learned"]
        report["constants"] |= learned["constants"] | {
            "model_error_mps": case.target.model_error_mps,
            "initial_error_m": case.target.e0_m,
            "corridor_m": case.target.spread_m,
            "learned_off_max_s": case.off_max_s,
        }
        for entry in learned["transitions"]:
            both = entries.setdefault(entry["from"], {k: entry[k] for k in ("from", "to", "gap_m")})
            both["learned"] = entry["learned"]
    transitions = list(entries.values())
    report["certificates"]["sound"] = _verdict(transitions, "sound")
    report["transitions"] = transitions
    report["uncertified"] = [
        {"from": t["from"], "to": t["to"]}
        for t in transitions
        if not any(t.get(c, {}).get("verdict") == "certified" for c in ("sound", "learned"))
    ]
    lines = (
        _flow_lines(path, ground, gaps, entries) if model is None else _learned_lines(model, ground, entries)
    )
    return Certified(report, _outlines(ground), lines)


def _sound(gap: _Gap, off: float | None, on: float | None, speed_mps: float) -> dict[str, Any]:
    if off is None:
        words = "no dwell time exists: the floor of the error is above the level that the view allows"
        return {"verdict": "unsatisfiable", "margin_m": None, "margin_s": None, "binding": words}
    out_s, in_s = off - gap.off_s, gap.on_s - (on or 0.0)
    margin = min(out_s, in_s)
    return {
        "verdict": "certified" if margin >= 0.0 else "not certified",
        "margin_m": speed_mps * margin if math.isfinite(margin) else None,
        "margin_s": margin if math.isfinite(margin) else None,
        "binding": "time out of view" if out_s <= in_s else "time in view",
        "trust_horizon_s": off,
    }


def _verdict(transitions: list[dict[str, Any]], name: str) -> dict[str, str]:
    verdicts = [t[name]["verdict"] for t in transitions if name in t]
    good = sum(v == "certified" for v in verdicts)
    whole = "certified" if verdicts and good == len(verdicts) else "not certified"
    if verdicts and all(v == "unsatisfiable" for v in verdicts):
        whole = "unsatisfiable"
    return {"verdict": whole, "reason": f"{good} of {len(verdicts)} transitions are certified"}


def _best_verdict(entry: dict[str, Any]) -> str:
    verdicts = [entry[c]["verdict"] for c in ("sound", "learned") if c in entry]
    if "certified" in verdicts:
        return "certified"
    return "not certified" if "not certified" in verdicts else "unsatisfiable"


def _words(entry: dict[str, Any]) -> str:
    """Return what is shown over a line of the map."""
    parts = [f"{entry['from']} to {entry['to']}, gap {entry['gap_m']:.3g} m"]
    for name in ("sound", "learned"):
        if name in entry:
            v = entry[name]
            margin = "" if v["margin_m"] is None else f", margin {v['margin_m']:.3g} m"
            parts.append(f"{name}: {v['verdict']}{margin} ({v['binding']})")
    return "; ".join(parts)


def _flow_lines(
    path: Array, ground: list[GroundView], gaps: list[_Gap], entries: dict[str, dict[str, Any]]
) -> list[MapLine]:
    lines = [
        MapLine(path[gap.first : gap.last + 1], _best_verdict(e), _words(e))
        for gap in gaps
        if (e := entries[ground[gap.source].name])
    ]
    return [MapLine(path[::5], "seen", "in view"), *lines]


def _learned_lines(
    model: LearnedModel, ground: list[GroundView], entries: dict[str, dict[str, Any]]
) -> list[MapLine]:
    path, last = learned_path(model)
    lines = [MapLine(path, "seen", "in view")]
    hidden = ~np.any([g.view.depth(path) >= 0.0 for g in ground], axis=0)
    edges = np.flatnonzero(np.diff(np.r_[False, hidden, False].astype(int))).reshape(-1, 2)
    for a, b in edges.tolist():
        entry = entries.get(ground[int(last[a])].name)
        if entry is not None:
            lines.append(MapLine(path[max(a - 1, 0) : b + 1], _best_verdict(entry), _words(entry)))
    return lines


def _outlines(ground: list[GroundView]) -> list[tuple[str, Array]]:
    return [ring for g in ground for ring in g.rings]


def _free(network: Network) -> Certified:
    ground = ground_of(network)
    off, on, source = dwell_times(network)
    target = FreeTargetClass(network.scenario.targets[0].v_max_mps, feature_extent(network))
    e0 = network.scenario.certificate.initial_error_m
    report = certify_free(ground, target, off, on, 0.05 if e0 is None else e0)
    report["constants"] = {"off_max_s": off, "on_min_s": on, "dwell_source": source}
    return Certified(report, _outlines(ground), free_lines(report, ground))


def free_lines(report: dict[str, Any], ground: list[GroundView]) -> list[MapLine]:
    """Return for each view the line to its nearest neighbour, with the trust horizon."""
    centre = {g.name: np.asarray(g.outline.centroid.coords)[0] for g in ground if not g.outline.is_empty}
    nearest: dict[str, dict[str, Any]] = {}
    for entry in report["transitions"]:
        best = nearest.get(entry["from"])
        if best is None or entry["gap_m"] < best["gap_m"]:
            nearest[entry["from"]] = entry
    return [
        MapLine(np.array([centre[e["from"]], centre[e["to"]]]), _best_verdict(e), _words(e))
        for e in nearest.values()
    ]

"""Certify a world file: the promise for every target, every transition with every certificate, and a map of them.

| target of the world | class | ``unseen`` | ``sound`` | ``learned`` |
| --- | --- | --- | --- | --- |
| ``vector_field`` | vector field | its one path, as driven | gaps against Dt_off | tube along the learned flow |
| ``road`` | road-bound | every walk, as drawn and driven | l_max / v_lo against Dt_off | ball on the road |
| ``track`` | free | never bounded | never certain; trust horizon | trust horizon |

``sound`` rests on dwell times that the estimator's Lyapunov analysis proves; what a designer allows out of view decides
``unseen`` and proves nothing about the estimate.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from camnet.certification.detection import frames_needed, time_in_view_s
from camnet.certification.free_network import FreeTargetClass, GroundView, certify_free
from camnet.certification.model_error import ModelError
from camnet.certification.promise import Promise, join_promises, with_claims
from camnet.config.models import Scenario
from camnet.errors import CertificateError, ConfigError
from camnet.experiments.certified import Certified, dwell_times
from camnet.experiments.certify_flow import ground_of
from camnet.experiments.certify_path import best_verdict, certify_on_path, words_of
from camnet.experiments.certify_road_world import certify_on_roads
from camnet.experiments.certify_structure import structure_assumptions, structure_bounds, structure_report
from camnet.experiments.promise_world import Limit
from camnet.experiments.target_groups import Models, TargetGroup, join_targets, target_groups
from camnet.geometry.rotations import to_matrix
from camnet.motion.road import RoadMotion
from camnet.motion.settings import FieldTarget, VectorFieldTarget
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import feature_extent, network_report
from camnet.simulation.network import Network, build_network
from camnet.simulation.own_certificate import own_pose_assumptions, own_pose_report
from camnet.simulation.sound_settings import sampling_of
from camnet.types import Array

__all__ = ["alone", "certify_world", "free_lines", "limit_of", "nominal_path"]

#: step of the nominal path, s
_STEP_S = 0.05


def certify_world(
    scenario: Scenario,
    model: Models = None,
    *,
    off_max_s: float | None = None,
    off_max_m: float | None = None,
    on_min_s: float | None = None,
    model_error_mps: ModelError = None,
    find_largest: bool = True,
    at_once: int | None = None,
) -> Certified:
    """Certify the network of a world for every target.

    Parameters
    ----------
    scenario : the world; its ``certificate.off_max_s`` is what the designer allows out of view
    model : learned motion model of the first target, or of several by their names, for ``learned`` along a flow
    off_max_s, off_max_m : what is allowed out of view, instead of the world's
    on_min_s : least time in view that is asked for after each gap
    model_error_mps : stated e_v, or one calibrated on the model's gaps, instead of the one from the world's own motion
    find_largest : also find the largest tolerable e_v of each transition, which takes most of the time
    at_once : how many targets at the same time are asked for; None: as many as the world has

    Raises
    ------
    CertificateError
        The world has no targets, so that nothing can be promised about them.
    """
    if not scenario.targets:
        raise CertificateError(
            f"world {scenario.name!r} has no targets: a promise is about targets, add at least one"
        )
    if scenario.agents and scenario.certificate.detection is not None:
        raise ConfigError(
            "certificate.detection: is about fixed cameras; the world has agents, whose views move; leave it out"
        )
    network, limit = build_network(scenario), limit_of(scenario, off_max_s, off_max_m)
    asked = len(scenario.targets) if at_once is None else at_once
    parts = {
        group.name: _one_class(network, group, limit, on_min_s, model_error_mps, find_largest, asked)
        for group in target_groups(scenario, model)
    }
    return _complete(network, parts, limit)


def limit_of(scenario: Scenario, off_max_s: float | None, off_max_m: float | None) -> Limit:
    """Return what is allowed out of view: as asked for, as the world says, else what the estimator learns across."""
    if off_max_s is not None or off_max_m is not None:
        return Limit(off_max_m, off_max_s, "as asked for")
    stated = scenario.certificate.off_max_s
    if stated is not None:
        return Limit(None, stated, "certificate.off_max_s")
    return Limit(None, scenario.estimator.gap.max_gap_s, "default: estimator.gap.max_gap_s")


def _one_class(
    whole: Network,
    group: TargetGroup,
    limit: Limit,
    on_min_s: float | None,
    model_error_mps: ModelError,
    find_largest: bool,
    at_once: int,
) -> Certified:
    network = alone(whole, group)
    settings = group.scenario.targets[0].motion
    motions = [t.motion for t in whole.description.targets if t.name in group.members]
    roads = [m for m in motions if isinstance(m, RoadMotion)]
    if roads:
        return certify_on_roads(
            network, roads, group.members, model_error_mps, limit, on_min_s=on_min_s, at_once=at_once
        )
    if isinstance(settings, VectorFieldTarget | FieldTarget):
        return certify_on_path(
            network, group.model, model_error_mps, find_largest, limit, on_min_s=on_min_s, at_once=at_once
        )
    return _free(network, group, limit, at_once)


def alone(whole: Network, group: TargetGroup) -> Network:
    """Return the network with the group's first target alone; geometry and basis are those of the whole."""
    kept = tuple(t for t in whole.description.targets if t.name == group.members[0])
    description = replace(whole.description, targets=kept)
    return replace(whole, scenario=group.scenario, description=description)


def _complete(network: Network, parts: dict[str, Certified], limit: Limit) -> Certified:
    """Join the targets, and add the dwell-time report of the estimator."""
    joined = join_targets(parts) if len(parts) > 1 else next(iter(parts.values()))
    promises = [part.promise for part in parts.values() if part.promise is not None]
    promise = join_promises(promises)
    dwell: dict[str, Any] = network_report(network)
    report = joined.report
    estimate: dict[str, Any] = {name: dict(part) for name, part in report["certificates"].items()}
    for name in ("published", "sound"):
        estimate[name] = {**dwell[name], **estimate.get(name, {})}
        if not str(dwell[name]["reason"]).startswith("Theorem"):
            estimate[name]["dwell_times"] = dwell[name]["reason"]
    if network.n_agents > 0:  # Theorem 3.1 is about fixed cameras; for agents (4-31) speaks
        estimate["published"] = {**dwell["published"], "dwell_times": dwell["published"]["reason"]}
    if dwell["sound"]["verdict"] == "refused":
        estimate["sound"] |= {k: dwell["sound"][k] for k in ("verdict", "reason")}
    elif estimate["sound"]["verdict"] == "unsatisfiable":
        estimate["sound"]["reason"] = dwell["sound"]["reason"]
    if not promise.enough and "learned" in estimate:  # the meeting of agent and target is part of it
        reason = f"it holds for {promise.served} target at a time, {promise.at_once} at once were asked for; "
        estimate["learned"] |= {"verdict": "not certified", "reason": reason + estimate["learned"]["reason"]}
    order = {name: estimate[name] for name in ("published", "sound", "learned") if name in estimate}
    content = {
        "network": {
            "name": network.scenario.name,
            "cameras": len(network.cameras),
            "regions": len(network.scenario.regions),
        },
        "cameras": _cameras(network),
        "target_class": report["target_class"],
        "certificates": order,
        "transitions": report["transitions"],
        "uncertified": report["uncertified"],
        "constants": {**report["constants"], "sound": dwell["sound"]["constants"]},
        "gaps": dwell["gaps"],
        "assumptions": [*_assumptions(network), *(f"sound: {words}" for words in dwell["assumptions"])],
        "warnings": [f"camera {c.name} sees none of the ways: {c.reason}" for c in promise.blind],
    }
    if network.own_poses or network.exits:
        content["own_pose"] = own_pose_report(network)
        content["assumptions"] += own_pose_assumptions(network)
    if structure_bounds(network) is not None:
        content["structure"] = structure_report(network, limit.off_s)
        content["assumptions"] += structure_assumptions(network)
    solids = [(occluder.name, occluder.footprint()) for occluder in network.occluders]
    return Certified(with_claims(content, promise), joined.views, joined.lines, promise, solids)


def _cameras(network: Network) -> list[dict[str, Any]]:
    """List the fixed cameras: place, pan and tilt of the optical axis, and how much of the ground they see."""
    ground = {g.name: float(g.outline.area) for g in ground_of(network)}
    out = []
    for camera in network.description.cameras:
        x, y, z = to_matrix(camera.q_world)[:, 2].tolist()
        place = dict(zip(("x_m", "y_m", "z_m"), (float(v) for v in camera.p_world), strict=True))
        pan, tilt = math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y)))
        sees = ground.get(camera.name, 0.0)
        out.append({"name": camera.name, **place, "pan_deg": pan, "tilt_deg": tilt, "ground_m2": sees})
    return out


def _assumptions(network: Network) -> list[str]:
    """Return what the promise takes for granted."""
    words = [
        "targets keep to their class: roads or path, speeds and turn rates",
        "targets do not hide each other",
    ]
    words += _initial_error(network)
    words += _detections(network)
    if network.n_agents == 0:
        return words
    words += [
        "an agent sees its whole footprint at the meeting point, wherever the target is in it",
        "agents that expect nobody wait in the middle of their regions and look straight down",
        "every target that an agent is sent to is the only one that needs it until it is handed over",
    ]
    return words


def _detections(network: Network) -> list[str]:
    """Say what counts as seen where the world states a detector."""
    d = network.scenario.certificate.detection
    if d is None:
        return []
    return [
        f"seen means {d.count} detections with probability {d.confidence:g} at least: frames at {d.rate_hz:g} Hz, each "
        f"a detection with probability {d.probability:g} by itself, known {d.latency_s:g} s later: "
        f"{frames_needed(d)} frames, {time_in_view_s(d):.3g} s in view of one camera"
    ]


def _initial_error(network: Network) -> list[str]:
    """Say that e(0) of ``learned`` is taken for granted where a measurement may be off by more."""
    e0, noise_m = network.scenario.certificate.initial_error_m, sampling_of(network).position_noise_m
    if e0 is None or e0 >= noise_m:
        return []
    return [
        f"learned: the estimate is within certificate.initial_error_m = {e0:g} m when a target is lost, though one "
        f"measurement may be off by {noise_m:.3g} m"
    ]


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


def _free(network: Network, group: TargetGroup, limit: Limit, at_once: int) -> Certified:
    ground = ground_of(network)
    off, on, source = dwell_times(network)
    target = FreeTargetClass(network.scenario.targets[0].v_max_mps, feature_extent(network))
    e0 = network.scenario.certificate.initial_error_m
    report: dict[str, Any] = certify_free(ground, target, off, on, 0.05 if e0 is None else e0)
    report["constants"] = {
        "off_max_s": limit.off_s,
        "off_max_m": limit.off_m,
        "limit_source": limit.source,
        "dwell_off_max_s": off,
        "dwell_on_min_s": on,
        "dwell_source": source,
    }
    promise = free_promise(
        report["target_class"], group.members, len(ground), limit, at_once, network.n_agents
    )
    outlines = [ring for g in ground for ring in g.rings]
    return Certified(with_claims(report, promise), outlines, free_lines(report, ground), promise)


def free_promise(
    target_class: str,
    targets: tuple[str, ...],
    cameras: int,
    limit: Limit,
    at_once: int | None,
    agents: int = 0,
) -> Promise:
    """Return what can be promised of targets that may go anywhere: nothing."""
    return Promise(
        target_class=target_class,
        unseen_max_m=float("inf"),
        unseen_max_s=float("inf"),
        targets=targets,
        at_once=at_once,
        cameras=cameras - agents,
        agents=agents,
        limit_m=limit.off_m,
        limit_s=limit.off_s,
        limit_source=limit.source,
        refusals=("a target that may go anywhere can stay out of every view for ever",),
    )


def free_lines(report: dict[str, Any], ground: list[GroundView]) -> list[MapLine]:
    """Return for each view the line to its nearest neighbour, with the trust horizon."""
    centre = {g.name: np.asarray(g.outline.centroid.coords)[0] for g in ground if not g.outline.is_empty}
    nearest: dict[str, dict[str, Any]] = {}
    for entry in report["transitions"]:
        best = nearest.get(entry["from"])
        if best is None or entry["gap_m"] < best["gap_m"]:
            nearest[entry["from"]] = entry
    return [
        MapLine(np.array([centre[e["from"]], centre[e["to"]]]), best_verdict(e), words_of(e))
        for e in nearest.values()
    ]

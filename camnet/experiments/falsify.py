"""Try to break the certificates of a world by adversarial simulation.

| target of the world | ``unseen`` | ``sound`` | ``learned`` |
| --- | --- | --- | --- |
| ``vector_field`` | | error growth within the dwell time | hostile targets against the tubes (``falsify_flow``) |
| ``road`` | hostile drivers (``falsify_road``) | | predictions with the worst speed error |

Real estimator: the gaps of the run in which the model was learned, from the second lap on, are checked too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from camnet.certification.growth import error_tube
from camnet.certification.transitions import GrowthModel
from camnet.config.models import Scenario
from camnet.errors import CertificateError
from camnet.experiments.certified import lyapunov_off
from camnet.experiments.certify_flow import FlowCase, flow_case
from camnet.experiments.certify_road_world import road_world
from camnet.experiments.falsify_flow import Attack, attack_flow
from camnet.experiments.falsify_road import RoadCase, attack_roads
from camnet.experiments.learned_model import LearnedModel
from camnet.experiments.target_groups import Models, TargetGroup, target_groups
from camnet.motion.road import RoadMotion
from camnet.processes.crew import Crew
from camnet.simulation.certificates import network_certificates
from camnet.simulation.network import Network, build_network
from camnet.types import Array

__all__ = ["check_gaps", "falsify_world"]

Progress = Callable[[float], None]


def falsify_world(
    scenario: Scenario,
    trials: int,
    seed: int,
    model: Models = None,
    model_error_mps: float | None = None,
    progress: Progress | None = None,
    crew: Crew | None = None,
) -> dict[str, Any]:
    """Attack the certificates of a world with ``trials`` hostile targets each; ``crew`` shares the work.

    Returns
    -------
    dict
        ``trials``, ``violations`` and ``closest_fraction`` of both certificates (None: it claims nothing here);
        ``lost``: targets out of view for longer than the world allows, after exits that are not certified;
        ``exits``; and ``estimator``: the gaps of the real estimator.
    """
    rng = np.random.default_rng(seed)
    groups = target_groups(scenario, model)
    results = {}
    for k, group in enumerate(groups):
        share = trials // len(groups) + (k < trials % len(groups))
        results[group.name] = _attack_class(scenario, group, share, rng, model_error_mps, progress, crew)
    return next(iter(results.values())) if len(groups) == 1 else _joined(results)


def _attack_class(
    scenario: Scenario,
    group: TargetGroup,
    trials: int,
    rng: np.random.Generator,
    model_error_mps: float | None,
    progress: Progress | None,
    crew: Crew | None,
) -> dict[str, Any]:
    network = build_network(group.scenario)
    everybody = build_network(scenario).description.targets
    moving = [t.motion for t in everybody if t.name in group.members]
    motions = [motion for motion in moving if isinstance(motion, RoadMotion)]
    if motions:
        roads = _road_case(network, motions, model_error_mps)
        unseen, learned = attack_roads(roads, trials, rng, progress, crew)
        known = learned if model_error_mps is not None and learned.trials > 0 else None
        return _result(trials, {"unseen": unseen, "sound": None, "learned": known}, {})
    if group.model is None:
        raise CertificateError(
            f"world {group.scenario.name!r}: the certificate of target {group.name!r} rests on a learned model; add "
            "--learn or --model FILE"
        )
    case = flow_case(network, group.model, model_error_mps)
    learned = attack_flow(case, trials, rng, progress, crew)
    parts = {"sound": _attack_dwell(network, trials, rng), "learned": learned}
    extra = {"exits": learned.by_exit, "estimator": check_gaps(case, group.model)}
    return _result(trials, parts, extra)


def _joined(results: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Add up the attacks on several targets; the closest approach is that of any."""
    closest = {}
    names = list(dict.fromkeys(name for r in results.values() for name in r["violations"]))
    for name in names:
        known = [r["closest_fraction"].get(name) for r in results.values()]
        closest[name] = max((x for x in known if x is not None), default=None)
    return {
        "trials": sum(r["trials"] for r in results.values()),
        "violations": {n: sum(r["violations"].get(n, 0) for r in results.values()) for n in names},
        "closest_fraction": closest,
        "lost": sum(r["lost"] for r in results.values()),
        "exits": [{**e, "target": n} for n, r in results.items() for e in r.get("exits", [])],
        "targets": results,
    }


def _result(trials: int, parts: dict[str, Attack | None], extra: dict[str, Any]) -> dict[str, Any]:
    learned = parts.get("learned")
    return {
        "trials": trials,
        "violations": {k: 0 if a is None else a.violations for k, a in parts.items()},
        "closest_fraction": {k: None if a is None else a.closest for k, a in parts.items()},
        "lost": 0 if learned is None else learned.lost,
        **extra,
    }


def _road_case(network: Network, motions: Sequence[RoadMotion], model_error_mps: float | None) -> RoadCase:
    case = road_world(network, motions)
    e0 = network.scenario.certificate.initial_error_m
    growth = None if model_error_mps is None else GrowthModel(0.05 if e0 is None else e0, model_error_mps)
    return RoadCase(case.watched.ways.roads, case.gaps, case.target, growth)


def _attack_dwell(network: Network, trials: int, rng: np.random.Generator) -> Attack | None:
    """Let target and prediction run apart for as long as ``sound`` allows; the error must stay below R.

    None where no dwell time exists: ``sound`` then claims nothing.
    """
    bounds, off = network_certificates(network).sound, lyapunov_off(network)
    if off is None or off <= 0.0:
        return None
    speed = network.scenario.targets[0].v_max_mps
    e0, limit = math.sqrt(2.0 * bounds.v_lo), math.sqrt(2.0 * bounds.v_hi)
    angles: Array = rng.uniform(0.0, 2.0 * math.pi, (trials, 16, 2))
    angles[::2] = np.array([0.0, math.pi])  # bang-bang: straight away from each other, along the first error
    steps = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    apart = speed * off / 16.0 * (steps[:, :, 0] - steps[:, :, 1])
    error = np.linalg.norm(np.array([e0, 0.0]) + np.cumsum(apart, axis=1), axis=-1).max(axis=1)
    return Attack(trials, int((error > limit).sum()), float(error.max() / limit))


def check_gaps(case: FlowCase, model: LearnedModel) -> dict[str, Any]:
    """Compare the real estimator's errors at re-sightings, after the first lap, with the tubes of the certificate."""
    gaps = model.gaps
    later = gaps[len(case.ground) :]
    shares = []
    tubes: dict[int, Any] = {}
    for source, _, lost_s, seen_s, error_m in later.tolist():
        j = int(source)
        if j not in tubes:
            k = int(np.argmin(np.abs(model.path[:, 0] - lost_s)))
            tubes[j] = error_tube(
                case.fields[j],
                model.path[k, 1:3],
                case.target.e0_m + case.target.spread_m,
                case.target.model_error_mps,
                case.target.v_max_mps,
                min(case.off_max_s, 1.5 * (seen_s - lost_s)),
                case.step_s,
                tolerance=1e-2,
                max_cells=600,
            )
        shares.append(error_m / float(np.interp(seen_s - lost_s, tubes[j].t_s, tubes[j].radius_m)))
    return {
        "gaps": len(shares),
        "violations": sum(s > 1.0 for s in shares),
        "closest_fraction": max(shares) if shares else None,
    }

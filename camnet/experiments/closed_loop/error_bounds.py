"""What ``learned`` claims of the estimate's error when a target is seen again, as bounds that a flight can break."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camnet.certification.growth import error_tube
from camnet.config.models import Scenario
from camnet.experiments.certify_flow import FlowCase, flow_case
from camnet.experiments.certify_road_world import ROAD_E0_M
from camnet.experiments.closed_loop.claims import Claims, ErrorBound
from camnet.experiments.learned_model import LearnedModel
from camnet.experiments.target_groups import target_groups
from camnet.motion.settings import RoadTarget
from camnet.simulation.network import build_network
from camnet.types import Array

__all__ = ["with_error_bounds"]

#: laps after which bounds of the error hold
_LAPS = 2


def with_error_bounds(
    claims: Claims,
    report: dict[str, Any],
    scenario: Scenario,
    model: Mapping[str, LearnedModel] | None,
    model_error_mps: float | None,
) -> Claims:
    """Return the promise with the error bounds of a certified ``learned``, deterministic or stated.

    They hold from the third lap on: by then every view has been passed twice, wherever the first lap began, and the
    model that the certificate speaks of is learned. On roads the bound is that of the growth law for the stated error;
    on fields, the tube behind each exit.
    """
    learned = report["claims"]["estimate"].get("learned")
    if learned is None or learned["verdict"] != "certified":
        return claims
    if all(isinstance(target.motion, RoadTarget) for target in scenario.targets):
        e0 = scenario.certificate.initial_error_m
        bound = ErrorBound(ROAD_E0_M if e0 is None else e0, model_error_mps or 0.0)
        return replace(claims, error=bound, error_after_laps=_LAPS)
    if not model:
        return claims
    tables: dict[tuple[int, int], tuple[Array, Array]] = {}
    names = [target.name for target in scenario.targets]
    for group in target_groups(scenario, model):
        if group.model is None:
            continue
        case = flow_case(build_network(group.scenario), group.model, model_error_mps)
        for camera, table in _tubes(case, group.model).items():
            tables.update({(names.index(member), camera): table for member in group.members})
    error = ErrorBound(max_m=np.inf, initial_m=np.inf, tables=tables)
    return replace(claims, error=error, error_after_laps=_LAPS)


def _tubes(case: FlowCase, model: LearnedModel) -> dict[int, tuple[Array, Array]]:
    """Return the ball's radius over the time out of view, for each camera that the target leaves."""
    out: dict[int, tuple[Array, Array]] = {}
    target = case.target
    for source, _, lost_s, _, _ in model.gaps[-len(case.ground) :].tolist():
        k = int(np.argmin(np.abs(model.path[:, 0] - lost_s)))
        tube = error_tube(
            case.fields[int(source)],
            model.path[k, 1:3],
            target.e0_m + target.spread_m,
            target.model_error_mps,
            target.v_max_mps,
            case.off_max_s,
            case.step_s,
            tolerance=1e-2,
            max_cells=600,
        )
        out[int(source)] = tube.t_s, tube.radius_m
    return out

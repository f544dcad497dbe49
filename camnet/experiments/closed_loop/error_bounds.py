"""What ``learned`` claims of the estimate's error when a target is seen again, as bounds that a flight can break."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camnet.certification.growth import error_tube
from camnet.config.models import Scenario
from camnet.experiments.certify_flow import FlowCase, flow_case
from camnet.experiments.closed_loop.claims import Claims, ErrorBound
from camnet.experiments.learned_model import LearnedModel
from camnet.experiments.target_groups import target_groups
from camnet.simulation.network import build_network
from camnet.types import Array

__all__ = ["with_error_bounds"]


def with_error_bounds(
    claims: Claims,
    report: dict[str, Any],
    scenario: Scenario,
    model: Mapping[str, LearnedModel] | None,
    model_error_mps: float | None,
) -> Claims:
    """Return the promise with the error bounds of a certified ``learned``, deterministic or stated.

    They hold from the second lap on: the model that the certificate speaks of is learned by then.
    """
    if report["claims"]["estimate"]["learned"]["verdict"] != "certified" or not model:
        return claims
    tables: dict[tuple[int, int], tuple[Array, Array]] = {}
    names = [target.name for target in scenario.targets]
    for group in target_groups(scenario, model):
        if group.model is None:
            continue
        case = flow_case(build_network(group.scenario), group.model, model_error_mps)
        for camera, table in _tubes(case, group.model).items():
            tables.update({(names.index(member), camera): table for member in group.members})
    return replace(claims, error=ErrorBound(max_m=np.inf, initial_m=np.inf, tables=tables), after_laps=1)


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

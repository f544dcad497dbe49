"""Networks with several targets: targets of one class are certified once, and the reports of the classes are joined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from camnet.config.models import Scenario
from camnet.experiments.certified import Certified
from camnet.experiments.learned_model import LearnedModel
from camnet.motion.settings import RoadTarget, TargetSettings

__all__ = ["Models", "TargetGroup", "join_targets", "target_groups"]

#: a learned model of the first target, or models by the targets' names
Models = LearnedModel | Mapping[str, LearnedModel] | None

#: what two targets of one class may differ in
_START = {"name", "start_m", "start_heading_rad"}

#: a network is as good as its worst target
_WORST = ("certified", "conditional", "not certified")


@dataclass(frozen=True, eq=False)
class TargetGroup:
    """Targets that one certificate is about.

    Attributes
    ----------
    name : their names, abbreviated
    scenario : the world with one of them alone
    model : its learned model
    members : names of all of them
    """

    name: str
    scenario: Scenario
    model: LearnedModel | None
    members: tuple[str, ...] = ()


def target_groups(scenario: Scenario, models: Models) -> list[TargetGroup]:
    """Group a world's targets: road-bound ones of equal class together, each other target by itself.

    The estimator learns every target by itself, so that a model is about one target only.
    """
    by_name = {scenario.targets[0].name: models} if isinstance(models, LearnedModel) else dict(models or {})
    groups: dict[str, list[TargetSettings]] = {}
    for target in scenario.targets:
        key = target.name
        if isinstance(target.motion, RoadTarget):  # where it starts is no part of its class
            motion = target.motion.model_copy(update={"road": "", "start_arc_m": None})
            key = target.model_copy(update={"motion": motion}).model_dump_json(exclude=_START)
        groups.setdefault(key, []).append(target)
    return [
        TargetGroup(
            ", ".join(t.name for t in group)
            if len(group) <= 3
            else f"{group[0].name} and {len(group) - 1} more",
            scenario.model_copy(update={"targets": (group[0],)}),
            by_name.get(group[0].name),
            tuple(t.name for t in group),
        )
        for group in groups.values()
    ]


def join_targets(parts: Mapping[str, Certified]) -> Certified:
    """Join the reports of several targets; every transition names its target, every verdict is that of the worst."""
    reports = {name: part.report for name, part in parts.items()}
    certificates: dict[str, dict[str, Any]] = {}
    for kind in ("published", "sound", "learned"):
        own = {n: r["certificates"][kind] for n, r in reports.items() if kind in r["certificates"]}
        if own and (kind != "learned" or len(own) == len(reports)):
            certificates[kind] = {
                "verdict": _worst([v["verdict"] for v in own.values()]),
                "reason": "; ".join(f"{n}: {v['reason']}" for n, v in own.items()),
            }
        elif own:  # a target without a model is not certified by it
            missing = ", ".join(n for n in reports if n not in own)
            certificates[kind] = {
                "verdict": "not certified",
                "reason": f"no motion model of {missing} was given",
            }
    first = next(iter(parts.values()))
    return Certified(
        {
            "target_class": "; ".join(f"{n}: {r['target_class']}" for n, r in reports.items()),
            "certificates": certificates,
            "transitions": [{**t, "target": n} for n, r in reports.items() for t in r["transitions"]],
            "uncertified": [{**t, "target": n} for n, r in reports.items() for t in r["uncertified"]],
            "constants": {
                **first.report["constants"],
                "targets": {n: r["constants"] for n, r in reports.items()},
            },
        },
        first.views,
        [line for part in parts.values() for line in part.lines],
    )


def _worst(verdicts: list[str]) -> str:
    if all(v == "unsatisfiable" for v in verdicts):
        return "unsatisfiable"
    ranks = [_WORST.index(v) if v in _WORST else len(_WORST) - 1 for v in verdicts]
    return _WORST[max(ranks)]

"""What types cannot say of pose sources and exit budgets: order of outages, sources that fit, room around regions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import shapely

from camnet.config.diagnose import Problem, show
from camnet.config.models import Agent, Scenario
from camnet.config.yaml_nodes import FieldPath
from camnet.geometry.regions import PrismRegion, Region

__all__ = ["exit_problems", "pose_problems"]


def pose_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield problems of the agents' pose sources."""
    for i, agent in enumerate(scenario.agents):
        path: FieldPath = ("agents", i, "pose")
        source = agent.pose
        if source.outages_s and not source.may_be_lost:
            advice = "with source 'external' the pose is never lost: give dead_reckoning or key_frames, or leave it out"
            yield Problem((*path, "outages_s"), show(source.outages_s), advice)
        before = 0.0
        for k, (begin, end) in enumerate(source.outages_s):
            if end <= begin:
                advice = "an outage is [from, to] in seconds, and ends after it began"
                yield Problem((*path, "outages_s", k), show([begin, end]), advice)
            elif k > 0 and begin <= before:
                advice = (
                    f"begins before the one before it has ended ({before:g} s): give them in order, apart"
                )
                yield Problem((*path, "outages_s", k), show([begin, end]), advice)
            before = max(before, end)
        yield from _rates(path, agent, scenario)


def _rates(path: FieldPath, agent: Agent, scenario: Scenario) -> Iterator[Problem]:
    rate, control = agent.pose.fixes.rate_hz, scenario.controller.rate_hz
    if agent.pose.may_be_lost and rate > control:
        advice = f"must not exceed controller.rate_hz = {control:g}, at which an agent knows its pose"
        yield Problem((*path, "fixes", "rate_hz"), show(rate), advice)


def exit_problems(scenario: Scenario, regions: Sequence[Region]) -> Iterator[Problem]:
    """Yield exit reaches that lead into others' regions or along occluders, and regions that are no convex ones."""
    by_name = {region.name: region for region in regions}
    for i, agent in enumerate(scenario.agents):
        if agent.exit_budget_s <= 0.0 or agent.region not in by_name:
            continue
        region, path = by_name[agent.region], ("agents", i, "exit_reach_m")
        if isinstance(region, PrismRegion):
            advice = f"region {region.name!r} is an extruded polygon; agents may leave boxes, cylinders and polytopes"
            yield Problem(("agents", i, "exit_budget_s"), show(agent.exit_budget_s), advice)
        wide = shapely.Polygon(region.footprint()).buffer(agent.exit_reach_m)
        for other in regions:
            if other is not region and wide.distance(shapely.Polygon(other.footprint())) <= 0.0:
                advice = (
                    f"reaches into region {other.name!r}: agents that meet there may collide; make it shorter"
                )
                yield Problem(path, show(agent.exit_reach_m), advice)
        if scenario.occluders:
            advice = "agents leave their regions in the open only: this world has occluders; set exit_budget_s to 0"
            yield Problem(("agents", i, "exit_budget_s"), show(agent.exit_budget_s), advice)

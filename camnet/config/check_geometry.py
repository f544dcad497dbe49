"""Whether a world can be built from a scenario whose names and numbers are right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from camnet.config.check_pose import exit_problems
from camnet.config.diagnose import Problem, raise_problems, show
from camnet.config.models import Agent, Occluder, Scenario
from camnet.config.models import Region as RegionSettings
from camnet.config.yaml_nodes import FieldPath, Node
from camnet.errors import WorldError
from camnet.geometry.regions import Region, build_region, overlaps
from camnet.motion.settings import VectorFieldTarget
from camnet.motion.track import Track
from camnet.settings import Vector3
from camnet.types import Array

__all__ = ["check_geometry"]


def check_geometry(scenario: Scenario, root: Node) -> Scenario:
    """Check regions, starts and occluders, and give every agent without a start the middle of its region.

    Raises
    ------
    WorldError
        A shape without an interior, regions that overlap, an agent outside its region or within a solid; one line
        for every problem.
    """
    regions = _build(scenario.regions, "regions", root)
    occluders = _build(scenario.occluders, "occluders", root)
    raise_problems(_overlaps(scenario, regions), root, WorldError)
    raise_problems(_room(scenario, regions), root, WorldError)
    by_name = {region.name: region for region in regions}
    raise_problems(exit_problems(scenario, regions), root, WorldError)
    agents = tuple(_with_start(agent, by_name[agent.region], scenario) for agent in scenario.agents)
    scenario = scenario.model_copy(update={"agents": agents})
    raise_problems(_agents_outside(scenario, by_name), root, WorldError)
    raise_problems(_in_solids(scenario, occluders), root, WorldError)
    raise_problems(_targets_away(scenario), root, WorldError)
    return scenario


def track_problems(scenario: Scenario, field: FieldPath, track: Track) -> Iterator[Problem]:
    """Yield a problem where a recorded track never comes near the world."""
    low, high = _surroundings(scenario)
    p = track.p_world[:, :2]
    if not np.any(np.all((p >= low) & (p <= high), axis=1)):
        a, b = p.min(axis=0), p.max(axis=0)
        advice = (
            f"the track lies in [{a[0]:.4g}, {b[0]:.4g}] x [{a[1]:.4g}, {b[1]:.4g}] m, away from the world in "
            f"[{low[0]:.4g}, {high[0]:.4g}] x [{low[1]:.4g}, {high[1]:.4g}] m: are its unit, axes or origin right?"
        )
        yield Problem(field, "", advice)


def _targets_away(scenario: Scenario) -> Iterator[Problem]:
    """Yield targets that begin so far from everything that nothing will come of them."""
    low, high = _surroundings(scenario)
    for i, target in enumerate(scenario.targets):
        if target.start_m is not None and not bool(
            np.all((target.start_m >= low) & (target.start_m <= high))
        ):
            advice = (
                f"far from the world in [{low[0]:.4g}, {high[0]:.4g}] x [{low[1]:.4g}, {high[1]:.4g}] m: "
                "are its unit and axes right?"
            )
            yield Problem(("targets", i, "start_m"), show(target.start_m), advice)


def _surroundings(scenario: Scenario) -> tuple[Array, Array]:
    """Corners (2,), (2,) of the box about regions, roads, fixed cameras and fields, grown by its size on each side."""
    points = [np.array(road.points_m) for road in scenario.roads]
    points += [build_region(r.name, r.shape).bounds[:, :2] for r in scenario.regions]
    for fixed in scenario.fixed_cameras:
        reach = next(c.far_m for c in scenario.cameras if c.name == fixed.camera)
        points.append(np.array(fixed.pose.position_m[:2]) + np.array([[-reach], [reach]]))
    for target in scenario.targets:
        if isinstance(target.motion, VectorFieldTarget) and target.motion.field == "wave":
            points.append(
                np.array(target.motion.center_m) + np.array([[-1.0], [1.0]]) * target.motion.scale_m
            )
    if not points:  # regions and roads are still to be made from traffic
        return np.full(2, -np.inf), np.full(2, np.inf)
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = float((high - low).max())
    return low - margin, high + margin


def _build(shapes: Sequence[RegionSettings | Occluder], section: str, root: Node) -> list[Region]:
    built, problems = [], []
    for index, item in enumerate(shapes):
        try:
            built.append(build_region(item.name, item.shape))
        except WorldError as error:
            problems.append(Problem((section, index, "shape"), show(item.shape.model_dump()), str(error)))
    raise_problems(problems, root, WorldError)
    return built


def _overlaps(scenario: Scenario, regions: Sequence[Region]) -> Iterator[Problem]:
    for (i, a), (j, b) in combinations(enumerate(regions), 2):
        if overlaps(a, b):
            advice = f"overlaps region {a.name!r} (regions[{i}]): operating regions must be disjoint"
            yield Problem(("regions", j, "shape"), show(scenario.regions[j].shape.model_dump()), advice)


def _room(scenario: Scenario, regions: Sequence[Region]) -> Iterator[Problem]:
    """Every region has room for its agent: a ball of the margin, and flight above the least height."""
    margin, floor = scenario.controller.region_margin_m, scenario.controller.min_height_m
    for i, region in enumerate(regions):
        path: FieldPath = ("regions", i, "shape")
        value = show(scenario.regions[i].shape.model_dump())
        if region.inradius_m <= margin:
            radius = f"its largest ball has radius {region.inradius_m:.4g} m"
            advice = f"too small for controller.region_margin_m = {margin}: {radius}"
            yield Problem(path, value, advice)
        elif region.bounds[1, 2] - margin <= floor:
            advice = f"too low: agents fly at controller.min_height_m = {floor} or higher, {margin} m below its top"
            yield Problem(path, value, advice)


def _with_start(agent: Agent, region: Region, scenario: Scenario) -> Agent:
    if agent.start_m is not None:
        return agent
    margin, floor = scenario.controller.region_margin_m, scenario.controller.min_height_m
    x, y, z = (float(value) for value in region.center)
    start = region.project(np.array([x, y, max(z, floor)]), margin)
    point: Vector3 = (float(start[0]), float(start[1]), float(start[2]))
    return agent.model_copy(update={"start_m": point})


def _agents_outside(scenario: Scenario, regions: dict[str, Region]) -> Iterator[Problem]:
    margin, floor = scenario.controller.region_margin_m, scenario.controller.min_height_m
    for i, agent in enumerate(scenario.agents):
        path: FieldPath = ("agents", i, "start_m")
        assert agent.start_m is not None
        depth = -float(regions[agent.region].signed_distance(np.array(agent.start_m)))
        if depth < margin - 1e-9:
            where = f"{-depth:.3g} m outside" if depth < 0 else f"only {depth:.3g} m inside"
            advice = f"{where} region {agent.region!r}: start at least controller.region_margin_m = {margin} m inside"
            yield Problem(path, show(agent.start_m), advice)
        elif agent.start_m[2] < floor - 1e-9:
            advice = f"too low: start at controller.min_height_m = {floor} or higher"
            yield Problem(path, show(agent.start_m), advice)


def _in_solids(scenario: Scenario, occluders: Sequence[Region]) -> Iterator[Problem]:
    """No agent, fixed camera or target begins within an occluder."""
    points: list[tuple[FieldPath, tuple[float, ...]]] = []
    points += [(("agents", i, "start_m"), a.start_m) for i, a in enumerate(scenario.agents) if a.start_m]
    points += [
        (("fixed_cameras", i, "pose", "position_m"), c.pose.position_m)
        for i, c in enumerate(scenario.fixed_cameras)
    ]
    for i, target in enumerate(scenario.targets):
        if target.start_m is not None:
            points.append((("targets", i, "start_m"), (*target.start_m, target.size_m[2] / 2)))
    for path, point in points:
        for solid in occluders:
            if bool(solid.contains(np.array(point))):
                yield Problem(path, show(point), f"inside occluder {solid.name!r}: choose a free place")

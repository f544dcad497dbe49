"""Every way of every target of a world, by classes of targets: roads as drawn and as driven, the paths of fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.certification.ways import Ways
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.experiments.certify_path import follow
from camnet.experiments.certify_world import alone
from camnet.experiments.target_groups import target_groups
from camnet.experiments.world_ways import drawn_ways, driven_ways
from camnet.motion.road import RoadMotion
from camnet.motion.settings import FieldTarget, VectorFieldTarget
from camnet.simulation.network import Network, build_network
from camnet.types import Array

__all__ = ["SiteWays", "flies", "places_of", "site_ways"]


@dataclass(frozen=True, eq=False)
class SiteWays:
    """Ways of targets of one class, and the world with one of them."""

    network: Network
    names: tuple[str, ...]
    ways: tuple[Ways, ...]


def site_ways(scenario: Scenario) -> list[SiteWays]:
    """Return every way of every target of a world: roads as drawn and as driven, the paths of fields.

    Raises
    ------
    ConfigError
        The world has agents or no targets, or a target may go anywhere.
    """
    if scenario.agents:
        raise ConfigError(
            f"world {scenario.name!r} has {len(scenario.agents)} agents: fixed cameras are placed, which need none; "
            "take agents and regions out of the world"
        )
    if not scenario.targets:
        raise ConfigError(f"world {scenario.name!r} has no targets: nothing asks for a camera")
    whole = build_network(scenario)
    return [_ways_of(alone(whole, group), group.members, whole) for group in target_groups(scenario, None)]


def _ways_of(network: Network, members: tuple[str, ...], whole: Network) -> SiteWays:
    target = network.scenario.targets[0]
    motions = [t.motion for t in whole.description.targets if t.name in members]
    roads = [m for m in motions if isinstance(m, RoadMotion)]
    if roads:
        slow = roads[0].speed_mps[0]
        return SiteWays(network, members, (drawn_ways(network, roads, slow), driven_ways(roads, slow)))
    if isinstance(target.motion, VectorFieldTarget | FieldTarget):
        return SiteWays(network, members, (follow(network).ways,))
    raise ConfigError(
        f"target {target.name!r} is of kind {target.motion.kind!r}: it may go anywhere, so that no choice of cameras "
        "bounds its time out of view; give it roads, or use camnet design --tracks"
    )


def flies(scenario: Scenario) -> bool:
    """Whether a target of a world leaves the ground."""
    return any(ways.height_m is not None for site in site_ways(scenario) for ways in site.ways)


def places_of(scenario: Scenario) -> Array:
    """Return places (n, 2), m, all along the ways of a world's targets."""
    return np.concatenate([ways.xy for site in site_ways(scenario) for ways in site.ways])

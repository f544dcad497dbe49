"""What a scenario becomes."""

from __future__ import annotations

import numpy as np

from camnet.config.load import load_scenario
from camnet.simulation.certificates import network_gaps, view_radius
from camnet.simulation.network import build_network


def test_containment_is_each_regions_own() -> None:
    for world in ("quickstart", "stationary_loop"):
        network = build_network(load_scenario(world))
        low, high = network.bounds
        points = np.random.default_rng(0).uniform(low, high, size=(4000, 3))
        expected = np.stack([region.contains(points) for region in network.regions], axis=1)
        np.testing.assert_array_equal(network.containment(points), expected)
        assert expected.any()


def test_regions_follow_the_cameras() -> None:
    network = build_network(load_scenario("stationary_loop"))
    assert [r.name for r in network.regions] == [c.name for c in network.scenario.fixed_cameras]
    for spec, region in zip(network.description.cameras, network.regions, strict=True):
        assert (
            region.contains(spec.p_world + 0.1 * (region.center - spec.p_world)) == np.False_
        )  # before the near plane
        assert region.contains(region.center)


def test_sight_lines_can_only_be_blocked_where_something_can_stand() -> None:
    assert not build_network(load_scenario("quickstart")).can_occlude
    assert build_network(load_scenario("stationary_loop")).can_occlude


def test_gaps_of_quickstart_are_those_between_its_boxes() -> None:
    network = build_network(load_scenario("quickstart"))
    gaps = {(gap.source, gap.target): gap.gap_m for gap in network_gaps(network)}
    assert np.isclose(gaps["east", "north"], np.hypot(0.4, 0.4))  # corner to corner
    assert np.isclose(gaps["east", "west"], 4.4)
    assert len(gaps) == 12


def test_the_working_ball_fits_the_view() -> None:
    network = build_network(load_scenario("quickstart"))
    height = network.regions[0].height[1] - network.scenario.controller.region_margin_m
    half_angle = np.arctan(240.0 / 420.0)
    extent = np.linalg.norm([0.12, 0.12, 0.3])
    assert np.isclose(view_radius(network, 0), height * np.sin(half_angle) - extent, rtol=1e-6)

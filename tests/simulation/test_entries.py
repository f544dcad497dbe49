"""Entries are where a path first meets a region, found here by stepping through it."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import assert_rounded_alike

from camnet.estimation.protocol import Rollout
from camnet.geometry.regions import build_region
from camnet.geometry.settings import Box
from camnet.simulation.entries import Entry, first_entry, predict_entries

EAST = build_region("east", Box(min_m=(4.0, -1.0, 0.0), max_m=(6.0, 1.0, 3.0)))
START = build_region("start", Box(min_m=(-1.0, -1.0, 0.0), max_m=(1.0, 1.0, 3.0)))


def straight(velocity: tuple[float, float], radius_m: float = 0.0, offset_y: float = 0.0) -> Rollout:
    t = 10.0 + 0.1 * np.arange(1, 201)
    p = np.stack([velocity[0] * (t - 10), velocity[1] * (t - 10) + offset_y, np.zeros_like(t)], axis=1)
    return Rollout(t, p, np.tile([1.0, 0, 0, 0], (len(t), 1)), np.full(len(t), radius_m))


def test_a_straight_path_enters_where_and_when_it_should() -> None:
    start, east = predict_entries(straight((0.5, 0.0)), [START, EAST])
    assert start is None  # the path begins there
    assert east is not None
    assert east.direct
    assert east.t_s == pytest.approx(18.0, abs=0.1)
    assert east.p_world == pytest.approx([4.0, 0.0, 0.0], abs=0.06)
    assert east.v_world == pytest.approx([0.5, 0.0, 0.0])


def test_a_path_that_passes_by_warns_only_when_its_ball_touches() -> None:
    passing = straight((0.5, 0.0), radius_m=0.4, offset_y=1.5)
    assert predict_entries(passing, [EAST]) == [None]
    touching = straight((0.5, 0.0), radius_m=0.6, offset_y=1.5)
    (entry,) = predict_entries(touching, [EAST])
    assert entry is not None
    assert not entry.direct
    assert entry.p_world[1] == pytest.approx(1.5)


def test_a_path_that_leads_away_never_enters() -> None:
    assert predict_entries(straight((-0.5, 0.0)), [EAST]) == [None]


def test_a_path_a_little_under_the_ground_enters_all_the_same() -> None:
    """Heights are estimated with noise: within the error radius a path below the floor is on it."""
    level = straight((0.5, 0.0), radius_m=0.05)
    for depth, direct in ((0.002, True), (0.04, True), (0.2, False)):
        p = level.p_world - np.array([0.0, 0.0, depth])
        (entry,) = predict_entries(Rollout(level.t_s, p, level.q_world, level.radius_m), [EAST])
        assert (entry is not None and entry.direct) == direct


def test_boxes_at_once_are_boxes_one_by_one() -> None:
    """The compiled search finds what the search in any region finds, on paths that wander in and out."""
    rng = np.random.default_rng(4)
    kinds = set()
    for _ in range(200):
        p = (
            np.cumsum(rng.normal(scale=0.4, size=(60, 3)) * (1.0, 1.0, 0.1), axis=0)
            + rng.normal(size=3) * 3.0
        )
        radius = rng.uniform(0.0, 0.8) + 0.01 * np.arange(60)
        path = Rollout(0.1 * np.arange(60), p, np.tile([1.0, 0, 0, 0], (60, 1)), radius)
        regions = [START, EAST]
        for found, region in zip(predict_entries(path, regions), regions, strict=True):
            expected = first_entry(regions.index(region), path, region)
            kinds.add(None if expected is None else expected.direct)
            if expected is None or found is None:
                assert found is expected
                continue
            assert isinstance(found, Entry)
            assert (found.direct, found.region) == (expected.direct, expected.region)
            assert_rounded_alike(found.t_s, expected.t_s)
            assert_rounded_alike(
                found.v_world, expected.v_world, scale=10.0
            )  # differences of places over 0.1 s
    assert kinds == {None, True, False}

"""Kernels: the compiled evaluation against NumPy, and where placements put them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis, evaluate_reference
from camnet.estimation.placement import (
    distance_to_roads,
    grid_centres,
    place_basis,
    place_on_data,
    road_centres,
)
from camnet.estimation.settings import BasisSettings
from camnet.geometry import rotations
from camnet.geometry.settings import Road

LOOP = Road(name="loop", closed=True, points_m=((0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)))


@pytest.mark.parametrize("d", [2, 4])
@given(seed=st.integers(0, 10_000))
def test_compiled_evaluation_is_the_gaussian(d: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((7, d, d))
    cov = a @ np.swapaxes(a, 1, 2) + 0.3 * np.eye(d)
    basis = RbfBasis.create(rng.standard_normal((7, d)), cov, 0.7)
    p, q = rng.standard_normal(3), rotations.from_yaw(rng.uniform(-3, 3))
    sigma = basis(p, q)
    np.testing.assert_allclose(sigma, evaluate_reference(basis, p, q), atol=4e-6)
    yaw = rotations.yaw_of(q)
    x = np.concatenate((p[:2], 0.7 * np.array([math.cos(yaw), math.sin(yaw)])))[:d]
    peer = [
        multivariate_normal.pdf(x, m, c) / multivariate_normal.pdf(m, m, c)
        for m, c in zip(basis.centres, cov, strict=True)
    ]
    np.testing.assert_allclose(sigma, peer, atol=4e-6)


@pytest.mark.parametrize(
    ("centres", "cov"),
    [
        (np.zeros((0, 2)), 1.0),
        (np.zeros((3, 3)), 1.0),
        (np.zeros((3, 2)), -1.0),
        (np.zeros((3, 2)), np.eye(3)),
        (np.array([[np.nan, 0.0]]), 1.0),
    ],
)
def test_bad_bases_are_refused(centres: np.ndarray, cov: object) -> None:
    with pytest.raises(ConfigError, match="basis"):
        RbfBasis.create(centres, cov)  # type: ignore[arg-type]


def test_grid_covers_its_box() -> None:
    g = grid_centres(np.array([-1.0, 0.0]), np.array([1.0, 0.7]), 0.3)
    assert g[:, 0].min() <= -1.0
    assert g[:, 0].max() >= 1.0
    assert g[:, 1].max() >= 0.7
    np.testing.assert_allclose(np.diff(np.unique(np.round(g[:, 0], 9))), 0.3)


def test_road_kernels_keep_to_the_margin_and_leave_no_hole() -> None:
    centres = road_centres([LOOP], 0.4, 0.8)
    distance, _ = distance_to_roads(centres, [LOOP])
    assert distance.max() <= 0.8
    # brute force: every point of the road has a kernel within a grid diagonal, the closing side included
    s = np.linspace(0, 1, 200)[:, None]
    points = np.array(LOOP.points_m)
    road = np.vstack([a + s * (b - a) for a, b in zip(points, np.roll(points, -1, axis=0), strict=True)])
    nearest = np.linalg.norm(road[:, None] - centres, axis=2).min(axis=1)
    assert nearest.max() < 0.4


def test_headings_of_a_road_are_its_two_directions() -> None:
    settings = BasisSettings(inputs="position_heading", heading_scale_m=0.5, max_kernels=4000)
    straight = Road(name="r", points_m=((0.0, 0.0), (3.0, 3.0)))
    basis = place_basis(settings, [straight], np.zeros(2), np.ones(2))
    direction = basis.centres[:, 2:] / 0.5
    np.testing.assert_allclose(np.abs(direction @ np.array([1.0, 1.0]) / math.sqrt(2)), 1.0)
    assert len(np.unique(np.sign(direction[:, 0]))) == 2


@given(limit=st.integers(5, 120))
def test_too_many_kernels_are_thinned(limit: int) -> None:
    basis = place_basis(BasisSettings(max_kernels=limit), [LOOP], np.zeros(2), np.ones(2))
    assert basis.size <= limit
    # width grows with the spacing
    spacing = np.diff(np.unique(np.round(basis.centres[:, 0], 6))).min()
    assert 1.0 / math.sqrt(basis.precision[0, 0, 0]) == pytest.approx(spacing, rel=1e-4)


def test_roads_are_taken_when_there_are_any() -> None:
    box = np.array([-1.0, -1.0]), np.array([7.0, 5.0])
    auto = place_basis(BasisSettings(), [LOOP], *box)
    np.testing.assert_array_equal(
        auto.centres, place_basis(BasisSettings(placement="road"), [LOOP], *box).centres
    )
    no_roads = place_basis(BasisSettings(), [], *box)
    np.testing.assert_array_equal(
        no_roads.centres, place_basis(BasisSettings(placement="grid"), [], *box).centres
    )
    with pytest.raises(ConfigError, match="roads"):
        place_basis(BasisSettings(placement="road"), [], *box)
    with pytest.raises(ConfigError, match="finite"):
        place_basis(BasisSettings(placement="grid"), [], np.array([-np.inf, 0]), np.ones(2))


def test_kernels_on_data_are_where_the_data_is() -> None:
    """Two clouds of different density: a fixed point of Lloyd's iteration, wider where kernels are sparse."""
    rng = np.random.default_rng(0)
    points = np.vstack(
        (0.1 * rng.standard_normal((400, 2)), np.array([8.0, 0.0]) + rng.standard_normal((400, 2)))
    )
    basis = place_on_data(points, 30, np.random.default_rng(1), overlap=0.8)
    assert basis.size <= 30
    nearest = np.argmin(((points[:, None] - basis.centres) ** 2).sum(axis=2), axis=1)
    means = np.array([points[nearest == k].mean(axis=0) for k in range(basis.size)])
    np.testing.assert_allclose(basis.centres, means, atol=0.25)
    width = basis.precision[:, 0, 0] ** -0.5
    gaps = np.sqrt(((basis.centres[:, None] - basis.centres) ** 2).sum(axis=2))
    np.testing.assert_allclose(width, 0.8 * np.sort(gaps, axis=1)[:, 1])
    dense = basis.centres[:, 0] < 4.0
    assert width[dense].mean() < 0.3 * width[~dense].mean()
    again = place_on_data(points, 30, np.random.default_rng(1), overlap=0.8)
    np.testing.assert_array_equal(again.centres, basis.centres)


@pytest.mark.parametrize(
    ("points", "count", "words"),
    [
        (np.zeros((5, 3)), 2, "shape"),
        (np.full((5, 2), np.nan), 2, "shape"),
        (np.zeros((5, 2)), 2, "count 2"),
        (np.arange(10.0).reshape(5, 2), 6, "count 6"),
    ],
)
def test_bad_data_for_kernels_are_refused(points: np.ndarray, count: int, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        place_on_data(points, count, np.random.default_rng(0))

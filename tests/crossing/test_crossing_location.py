"""Centres of weighted votes against optimisation by a general method and against a fine grid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from camnet.estimation.crossing.location import geometric_median, mode, weighted_mean


def votes(seed, n=25):
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 20.0, (n, 2)), rng.uniform(0.1, 1.0, n)


@given(st.integers(0, 1000))
def test_mean_is_numpys(seed):
    points, weights = votes(seed)
    np.testing.assert_allclose(
        weighted_mean(points, weights), np.average(points, axis=0, weights=weights), atol=1e-10
    )


@pytest.mark.parametrize("seed", range(8))
def test_geometric_median_minimises_the_smoothed_distance(seed):
    points, weights = votes(seed)

    def cost(x):
        return weights @ np.sqrt(np.sum((points - x) ** 2, axis=1) + 0.25)

    best = minimize(cost, points.mean(axis=0), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9})
    np.testing.assert_allclose(geometric_median(points, weights), best.x, atol=5e-3)


@pytest.mark.parametrize("seed", range(8))
def test_mode_is_the_highest_of_a_fine_grid(seed):
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(0.0, 3.0, (9, 2)), rng.normal(60.0, 3.0, (6, 2))])
    weights = rng.uniform(0.5, 1.0, 15)

    def density(x):
        gap2 = np.sum((points - x[..., None, :]) ** 2, axis=-1)
        return np.sum(weights * np.exp(-gap2 / 200.0), axis=-1)

    axis = np.arange(-20.0, 80.0, 0.25)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    found = mode(points, weights, 10.0)
    assert density(found) >= density(grid).max() - 1e-6


def test_mode_stays_with_the_majority_where_the_mean_falls_between():
    points = np.array([[0.0, 0.0]] * 6 + [[100.0, 0.0]] * 4)
    weights = np.ones(10)
    assert mode(points, weights, 10.0)[0] == pytest.approx(0.0, abs=0.1)
    assert weighted_mean(points, weights)[0] == pytest.approx(40.0)
    assert geometric_median(points, weights)[0] < 1.0


def test_a_wide_mode_is_the_mean():
    points, weights = votes(3)
    np.testing.assert_allclose(mode(points, weights, 1e5), weighted_mean(points, weights), atol=1e-3)


def test_one_vote_wins():
    point = np.array([[3.0, 4.0]])
    for found in (
        mode(point, np.ones(1), 5.0),
        geometric_median(point, np.ones(1)),
        weighted_mean(point, np.ones(1)),
    ):
        np.testing.assert_allclose(found, point[0])

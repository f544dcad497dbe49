"""Rotation and direction from two views: exact without noise, and what the odometry's direction adds with noise."""

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation.structure.geometry import unit
from camnet.estimation.structure.two_view import (
    aided_direction,
    essential_pose,
    homography_pose,
    turn_between,
)
from camnet.geometry.rotations import exp, to_matrix

R = to_matrix(exp(np.array([0.05, -0.2, 0.1])))
P = np.array([0.5, -0.1, -0.4])  # the key frame's origin in the camera frame
U = P / np.linalg.norm(P)


def two_views(points):
    return unit(points)[0], unit(points @ R.T + P)[0]


def spread(rng, count=40):
    return rng.uniform([-1.5, -1.0, 3.0], [1.5, 1.0, 6.0], (count, 3))


def plane(rng, count=40):
    x, y = rng.uniform(-0.8, 0.8, (2, count))
    return np.column_stack([x, y, 3.0 + 0.4 * x - 0.2 * y])


def noisy(u, sigma, rng):
    return unit(u + sigma * rng.standard_normal(u.shape))[0]


def test_essential_matrix_finds_the_pose_of_points_in_general_position():
    a, b = two_views(spread(np.random.default_rng(0)))
    r, u = essential_pose(a, b, 1e-6)
    assert turn_between(r, R) < 1e-5
    assert np.linalg.norm(u - U) < 1e-5


def test_homography_finds_the_pose_of_points_on_a_plane():
    a, b = two_views(plane(np.random.default_rng(0)))
    near = to_matrix(exp(np.array([0.08, -0.15, 0.1]))), unit(U + 0.1)[0]
    r, u = homography_pose(a, b, 1e-6, near)
    assert turn_between(r, R) < 1e-5
    assert np.linalg.norm(u - U) < 1e-5


@pytest.mark.parametrize("points", [spread, plane])
def test_known_rotation_leaves_the_direction_to_the_images(points):
    rng = np.random.default_rng(2)
    a, b = two_views(points(rng))
    expected = unit(U + 0.02 * rng.standard_normal(3))[0]
    near = aided_direction(a, b, R, expected, 1e-6, 10.0)
    assert np.linalg.norm(near - U) < 0.1 * np.linalg.norm(
        expected - U
    )  # linear in the departure from expected
    assert np.linalg.norm(aided_direction(a, b, R, near, 1e-6, 10.0) - U) < 1e-4


def test_direction_is_where_the_weighted_squares_are_least():
    rng = np.random.default_rng(7)
    a, b = two_views(spread(rng))
    a, b = noisy(a, 1e-3, rng), noisy(b, 1e-3, rng)
    expected = unit(U + np.array([0.01, -0.02, 0.01]))[0]
    found = aided_direction(a, b, R, expected, 1e-3, 0.02)
    n = np.cross(b, a @ R.T)

    def cost(u):
        v = u / (u @ expected)  # the plane across the expected direction, on which the squares are summed
        return np.sum((n @ v) ** 2) / 2e-6 + np.sum((v - expected) ** 2) / 4e-4

    for _ in range(20):
        assert cost(found) <= cost(found + 1e-4 * rng.standard_normal(3)) + 1e-9


def test_a_small_far_board_needs_the_expected_direction():
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(0.06 * np.arange(8), 0.06 * np.arange(6))
    a, b = two_views(np.column_stack([x.ravel(), y.ravel(), np.full(48, 4.0)]))
    alone, together, given = [], [], []
    for _ in range(30):
        expected = unit(U + 0.005 * rng.standard_normal(3))[0]
        pair = noisy(a, 4e-4, rng), noisy(b, 4e-4, rng)
        alone.append(np.linalg.norm(aided_direction(*pair, R, expected, 4e-4, 10.0) - U))
        together.append(np.linalg.norm(aided_direction(*pair, R, expected, 4e-4, 0.005) - U))
        given.append(np.linalg.norm(expected - U))
    assert np.mean(together) < 0.95 * np.mean(given)
    assert np.mean(together) < 0.5 * np.mean(alone)


def test_too_few_points_are_refused():
    a, b = two_views(spread(np.random.default_rng(0), 3))
    with pytest.raises(ConfigError, match="3 points: at least 5"):
        essential_pose(a, b, 1e-3)
    with pytest.raises(ConfigError, match="3 points: at least 4"):
        homography_pose(a, b, 1e-3, (R, U))

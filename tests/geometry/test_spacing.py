"""The least distance is SciPy's; membership in boxes by comparison."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist

from camnet.geometry.spacing import in_boxes, least_distance


def test_agrees_with_all_pairs() -> None:
    rng = np.random.default_rng(1)
    for n in (2, 3, 17):
        points = rng.normal(size=(n, 3))
        np.testing.assert_allclose(least_distance(points), pdist(points).min(), rtol=1e-14)


def test_one_point_has_no_neighbour() -> None:
    assert np.isinf(least_distance(np.zeros((1, 3))))


def test_boxes_hold_their_border_and_nothing_beyond() -> None:
    rng = np.random.default_rng(2)
    low = rng.normal(size=(5, 3))
    high = low + rng.uniform(0.1, 2.0, size=(5, 3))
    points = np.concatenate([rng.normal(size=(300, 3)), low, high, np.full((1, 3), np.nan)])
    expected = ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2)
    np.testing.assert_array_equal(in_boxes(points, low, high), expected)
    assert expected[300:310].any(axis=1).all()
    assert expected[:300].any()

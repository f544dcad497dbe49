"""The least distance is SciPy's."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist

from camnet.geometry.spacing import least_distance


def test_agrees_with_all_pairs() -> None:
    rng = np.random.default_rng(1)
    for n in (2, 3, 17):
        points = rng.normal(size=(n, 3))
        np.testing.assert_allclose(least_distance(points), pdist(points).min(), rtol=1e-14)


def test_one_point_has_no_neighbour() -> None:
    assert np.isinf(least_distance(np.zeros((1, 3))))

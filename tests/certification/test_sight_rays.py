"""Sight lines against PyBullet's rays: many random cameras, solids and points; more by ``scripts/sight_rays.py``."""

from __future__ import annotations

import numpy as np
import pytest
from sight_trials import compare, edge_distance


def _check(cases: int, seed: int) -> None:
    found = compare(cases, seed)
    assert found.cases == cases
    assert found.in_view >= 0.2 * cases
    assert found.near_edge >= 0.1 * cases
    assert found.farthest_m <= 0.01, found


def test_sight_lines_agree_with_rays() -> None:
    _check(20_000, 1)


@pytest.mark.slow
def test_sight_lines_agree_with_rays_in_a_million_cases() -> None:
    _check(1_000_000, 2)


def test_distance_to_edges() -> None:
    """Against points along both segments."""
    rng = np.random.default_rng(0)
    eyes, points, edges = rng.normal(size=(20, 3)), rng.normal(size=(20, 3)), rng.normal(size=(4, 2, 3))
    share = np.linspace(0.0, 1.0, 201)[:, None]
    for n, found in enumerate(edge_distance(eyes, points, edges)):
        line = eyes[n] + share * (points[n] - eyes[n])
        other = np.concatenate([a + share * (b - a) for a, b in edges])
        least = np.linalg.norm(line[:, None] - other, axis=2).min()
        assert found == pytest.approx(least, abs=0.02)
        assert found <= least + 1e-9

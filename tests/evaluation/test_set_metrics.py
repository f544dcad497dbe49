"""OSPA, GOSPA and identity switches against brute force over all assignments, and worked cases."""

from __future__ import annotations

from datetime import datetime
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import assert_rounded_alike

from camnet.evaluation.set_metrics import IdentityCounter, gospa, ospa


def brute(truth: np.ndarray, estimates: np.ndarray, c: float, p: float) -> tuple[float, float]:
    """OSPA and GOSPA by their definitions, over every assignment."""
    few, many = (truth, estimates) if len(truth) <= len(estimates) else (estimates, truth)
    n, k = len(few), len(many)
    least = min(
        sum(min(float(np.linalg.norm(few[i] - many[j])), c) ** p for i, j in enumerate(order))
        for order in permutations(range(k), n)
    )
    o = ((least + c**p * (k - n)) / k) ** (1 / p) if k else 0.0
    # GOSPA by its other form: sums over matched pairs, missed and false ones, alpha = 2
    options = []
    for size in range(n + 1):
        for rows in permutations(range(n), size):
            for columns in permutations(range(k), size):
                matched = sum(
                    float(np.linalg.norm(few[i] - many[j])) ** p for i, j in zip(rows, columns, strict=True)
                )
                options.append(matched + c**p / 2 * (n + k - 2 * size))
    return o, min(options) ** (1 / p)


@given(st.integers(0, 3), st.integers(0, 3), st.integers(0, 10**6), st.sampled_from([1.0, 2.0]))
def test_both_distances_are_those_of_their_definitions(n: int, k: int, seed: int, order: float) -> None:
    rng = np.random.default_rng(seed)
    truth, estimates = rng.normal(size=(n, 3)), rng.normal(size=(k, 3))
    wanted = brute(truth, estimates, 1.5, order)
    assert ospa(truth, estimates, 1.5, order) == pytest.approx(wanted[0], abs=1e-12)
    assert gospa(truth, estimates, 1.5, order) == pytest.approx(wanted[1], abs=1e-12)


def test_stone_soup_agrees() -> None:
    """Up to a hundred targets, of which some are missed, some false and some pairs beyond the cutoff."""
    pytest.importorskip("stonesoup")
    from stonesoup.measures import Euclidean
    from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
    from stonesoup.types.state import State

    now, rng = datetime(2026, 1, 1), np.random.default_rng(6)
    cases = ((1, 1, 2.0, 1.0), (3, 5, 1.0, 1.0), (6, 4, 2.0, 3.0), (40, 40, 2.0, 2.0), (100, 90, 1.0, 5.0))
    for n, k, order, spread in cases:
        truth, estimates = spread * rng.normal(size=(n, 3)), spread * rng.normal(size=(k, 3))
        theirs = [[State(p[:, None], timestamp=now) for p in places] for places in (truth, estimates)]
        options = {"p": order, "c": 1.5, "measure": Euclidean()}
        wanted = OSPAMetric(**options).compute_OSPA_distance(theirs[1], theirs[0]).value
        assert_rounded_alike(ospa(truth, estimates, 1.5, order), wanted, steps=n + k)
        wanted = GOSPAMetric(**options).compute_gospa_metric(theirs[1], theirs[0])[0]
        assert_rounded_alike(gospa(truth, estimates, 1.5, order), wanted.value["distance"], steps=n + k)


def test_identities_that_change_partners_are_switches() -> None:
    counter = IdentityCounter(1.0)
    truth = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    counter.add(truth, truth, [0, 1])
    counter.add(truth, truth + 0.2, [0, 1])
    assert counter.switches == 0
    counter.add(truth, truth[::-1], [0, 1])
    assert counter.switches == 2


def test_a_match_within_the_cutoff_is_kept_though_another_is_nearer() -> None:
    counter = IdentityCounter(1.0)
    truth = np.zeros((1, 3))
    counter.add(truth, np.array([[0.1, 0, 0]]), [7])
    counter.add(truth, np.array([[0.9, 0, 0], [0.0, 0, 0]]), [7, 8])
    assert counter.switches == 0
    counter.add(truth, np.array([[1.1, 0, 0], [0.0, 0, 0]]), [7, 8])
    assert counter.switches == 1

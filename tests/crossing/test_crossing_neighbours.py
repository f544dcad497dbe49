"""Compiled search for the nearest lessons against the readable one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camnet.estimation.crossing.neighbours import nearest_lessons, nearest_lessons_reference, vote_weights


@given(st.integers(0, 10_000), st.integers(1, 60), st.integers(1, 20), st.sampled_from([4, 5]))
def test_compiled_search_is_the_readable_one(seed, n, count, d):
    rng = np.random.default_rng(seed)
    arguments = (
        rng.normal(size=d),
        1000.0,
        1,
        rng.normal(size=(n, 5)),
        rng.choice([0.0, 0.6, 1.0], n),
        rng.uniform(0.0, 1000.0, n),
        rng.integers(0, 3, n),
        (1.5, 1.0, 300.0),
        count,
    )
    index, distance2 = nearest_lessons(*arguments)
    expected_index, expected = nearest_lessons_reference(*arguments)
    np.testing.assert_allclose(distance2, expected, rtol=1e-12, atol=1e-12)
    assert list(index) == list(expected_index)


def test_bonuses_bring_the_same_target_and_recent_lessons_nearer():
    features = np.zeros((3, 5))
    features[:, 0] = 0.5, 0.5, 0.5
    lesson_t = np.array([0.0, 0.0, 990.0])
    target = np.array([0, 7, 0])
    index, distance2 = nearest_lessons(
        np.zeros(5), 1000.0, 7, features, np.zeros(3), lesson_t, target, (1.5, 1.0, 100.0), 3
    )
    assert list(index) == [1, 2, 0]
    np.testing.assert_allclose(distance2, [0.25 - 1.5 - np.exp(-10), 0.25 - np.exp(-0.1), 0.25 - np.exp(-10)])


@given(st.lists(st.floats(-2.0, 50.0), min_size=1, max_size=20), st.integers(1, 8))
def test_weights_fall_from_one(values, rank):
    weights = vote_weights(np.sort(np.array(values)), rank, 1.0)
    assert weights[0] == 1.0
    assert np.all(np.diff(weights) <= 0.0)
    assert np.all(weights >= 0.0)


def test_weight_falls_by_e_at_the_rank():
    weights = vote_weights(np.array([2.0, 3.0, 6.0, 10.0]), 3, 1.0)
    np.testing.assert_allclose(weights, np.exp(-np.array([0.0, 0.25, 1.0, 2.0])))

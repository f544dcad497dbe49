"""The secular form of the printed selection rule against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import assert_rounded_alike

from camnet.estimation.selection import DOptimalRule, SmallestEigenvalueRule
from camnet.estimation.selection_secular import (
    SecularEigenvalueRule,
    drops,
    rounding_floor,
    smallest_after_downdates,
)
from camnet.estimation.stack import HistoryStack


def _brute(matrix: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.eigvalsh(matrix - rows[:, :, None] * rows[:, None, :])[:, 0])


def _naive_choice(gram: np.ndarray, row: np.ndarray, rows: np.ndarray) -> tuple[int, float]:
    """What ``SmallestEigenvalueRule`` does, all matrices at once, and the best eigenvalue."""
    values = _brute(gram + np.outer(row, row), rows)
    best = int(np.argmax(values))
    return best if values[best] > np.linalg.eigvalsh(gram)[0] else -1, float(values[best])


def _local_rows(rng: np.random.Generator, n: int, p: int) -> np.ndarray:
    """Rows of kernels on a line, as a target that walks along it gives them."""
    x = rng.uniform(0.0, 0.35 * p, (n, 1))
    return rng.uniform(0.5, 1.0, (n, 1)) * np.exp(-(((x - 0.35 * np.arange(p)) / 0.5) ** 2))


@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize(("n", "p"), [(12, 4), (60, 20), (120, 30)])
def test_all_eigenvalues_are_those_of_brute_force(n: int, p: int, local: bool) -> None:
    rng = np.random.default_rng(n)
    rows = _local_rows(rng, n, p) if local else rng.standard_normal((n, p))
    matrix = rows.T @ rows
    exact = _brute(matrix, rows)
    floor = rounding_floor(p, float(np.linalg.norm(matrix, 2)))
    np.testing.assert_allclose(smallest_after_downdates(matrix, rows), exact, rtol=1e-9, atol=10 * floor)


def test_deflated_equations_are_solved() -> None:
    """Multiple smallest eigenvalues, rows without share in them, and vanishing shares."""
    for d in ([1.0, 1.0, 1.0, 4.0], [1.0, 2.0, 2.0, 3.0], [1.0, 1.0 + 1e-15, 5.0, 6.0]):
        for z in (
            [0, 0, 0, 1.0],
            [0, 0.5, 0.5, 0.5],
            [1e-170, 0.9, 0, 0],
            [1e-9, 1.2, 0.3, 0.1],
            [0.3] * 4,
            [0] * 4,
        ):
            exact = np.linalg.eigvalsh(np.diag(d) - np.outer(z, z))[0]
            found = d[0] - drops(np.array([z], dtype=float), np.array(d) - d[0])[0]
            assert_rounded_alike(found, exact, scale=max(d) + sum(x * x for x in z))


def _sequence(seed: int) -> tuple[SecularEigenvalueRule, int]:
    """Run a random sequence of candidates by both rules on one stack; the number of candidates above rounding."""
    rng = np.random.default_rng(seed)
    p = int(rng.integers(2, 8))
    n = p + int(rng.integers(1, 10))
    draw = (
        _local_rows if seed % 2 else lambda r, k, q: r.standard_normal((k, q)) * r.uniform(0.01, 2.0, (k, 1))
    )
    rule = SecularEigenvalueRule(n, p, 1e-3)
    stack = HistoryStack(n, p, 1, rule, 1e-3)
    for y in draw(rng, n, p):
        stack.offer(0.0, y, np.zeros(1))
    above = 0
    for y in draw(rng, 5, p):
        with_row = stack.gram + np.outer(y, y)
        before = stack.rows.copy()
        expected, best = _naive_choice(stack.gram, y, before)
        printed = SmallestEigenvalueRule().choose(y, before, stack.gram) if seed < 20 else expected
        stack.offer(0.0, y, np.zeros(1))
        if best <= 2 * rounding_floor(p, float(np.linalg.norm(with_row, 2))):
            continue  # rounding decides
        assert printed == expected
        above += 1
        assert rule.name == "lambda_min"
        changed = np.flatnonzero((stack.rows != before).any(axis=1))
        assert changed.tolist() == ([] if expected < 0 else [expected])
    return rule, above


def test_choices_over_a_thousand_sequences_are_those_of_brute_force() -> None:
    results = [_sequence(seed) for seed in range(1000)]
    assert sum(above for _, above in results) > 4000


def test_below_rounding_the_choice_is_the_d_optimal_rules() -> None:
    """Ten kernels that no data reaches: the smallest eigenvalue is noise, and the record says who decided."""
    rng = np.random.default_rng(0)
    rule, peer = SecularEigenvalueRule(15, 20, 1e-2), DOptimalRule(15, 20, 1e-2)
    stacks = [HistoryStack(15, 20, 1, r, 1e-3) for r in (rule, peer)]
    for y in rng.standard_normal((60, 20)) * (np.arange(20) < 10):
        for stack in stacks:
            stack.offer(0.0, y, np.zeros(1))
    np.testing.assert_array_equal(stacks[0].rows, stacks[1].rows)
    assert rule.ran == {"lambda_min": 0, "d_optimal": 45}
    assert stacks[0].rule_name == "d_optimal"


def test_rank_deficiency_that_no_diagonal_shows_is_found_too() -> None:
    rng = np.random.default_rng(1)
    mix = rng.standard_normal((3, 6))
    rule = SecularEigenvalueRule(8, 6, 1e-2)
    stack = HistoryStack(8, 6, 1, rule, 1e-3)
    for y in rng.standard_normal((20, 3)) @ mix:
        stack.offer(0.0, y, np.zeros(1))
    assert rule.ran == {"lambda_min": 0, "d_optimal": 12}

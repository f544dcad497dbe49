"""The compiled rates are those of the plain rotations."""

from __future__ import annotations

import numpy as np

from camnet.control.rates_kernel import mean_rates, row_norms, turn_between
from camnet.geometry import rotations


def test_agrees_with_the_plain_rotations() -> None:
    rng = np.random.default_rng(0)
    q0, q1 = (rotations.normalise(rng.normal(size=(6, 4))) for _ in range(2))
    v = rng.normal(size=(6, 3))
    between = rotations.multiply(rotations.conjugate(q0), q1)
    np.testing.assert_allclose(mean_rates(q0, q1, 0.2), rotations.log(between) / 0.2, atol=1e-12)
    np.testing.assert_allclose(turn_between(q0, q1, v), rotations.rotate(between, v), atol=1e-12)
    np.testing.assert_allclose(row_norms(v), np.linalg.norm(v, axis=1), rtol=1e-14)


def test_a_constant_rate_is_recovered() -> None:
    w = np.array([[0.3, -0.5, 0.2]])
    q0 = rotations.exp(np.array([[1.0, 0.2, -0.4]]))
    q1 = rotations.multiply(q0, rotations.exp(0.05 * w))
    np.testing.assert_allclose(mean_rates(q0, -q1, 0.05), w, rtol=1e-9)  # either sign of q

"""Rotations of tuples are those of arrays."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.geometry import rotations, triples
from camnet.types import Array


def _unit(rng: np.random.Generator) -> Array:
    q = rng.normal(size=4)
    return np.asarray(q / np.linalg.norm(q))


@pytest.mark.parametrize("seed", range(5))
def test_rotations_of_tuples_are_those_of_arrays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, v = _unit(rng), _unit(rng), rng.normal(size=3)
    qa, qb, x = tuple(a.tolist()), tuple(b.tolist()), tuple(v.tolist())
    close = {"atol": 1e-14}
    np.testing.assert_allclose(triples.multiply(qa, qb), rotations.multiply(a, b), **close)
    np.testing.assert_allclose(triples.rotate(qa, x), rotations.rotate(a, v), **close)
    np.testing.assert_allclose(
        triples.rotate_inverse(qa, x), rotations.rotate(rotations.conjugate(a), v), **close
    )
    r = rotations.to_matrix(a)
    np.testing.assert_allclose(triples.matrix(qa), r, **close)
    np.testing.assert_allclose(triples.out_of(triples.matrix(qa), x), r @ v, **close)
    np.testing.assert_allclose(triples.into(triples.matrix(qa), x), r.T @ v, **close)
    assert triples.norm(x) == pytest.approx(float(np.linalg.norm(v)))


@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 0.5, 3.0])
def test_exp_and_log_at_any_angle(size: float) -> None:
    v = size * np.array([0.6, -0.48, 0.64])
    q = triples.exp(tuple(v.tolist()))
    np.testing.assert_allclose(q, rotations.exp(v), atol=1e-14)
    np.testing.assert_allclose(triples.log(q), v, atol=1e-12)
    np.testing.assert_allclose(triples.log(tuple(-c for c in q)), v, atol=1e-12)  # either sign

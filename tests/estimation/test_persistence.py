"""Learned models saved, loaded and merged; damaged files refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from artefacts import rewritten

from camnet.errors import DataError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.persistence import extract, install, load_models, merge, save_models
from camnet.estimation.placement import grid_centres
from camnet.estimation.settings import EstimatorSettings

BASIS = RbfBasis.create(grid_centres(np.zeros(2), np.array([2.0, 1.0]), 0.5), 0.25)
Q0 = np.array([1.0, 0.0, 0.0, 0.0])


def _taught(low: float, high: float, seed: int = 0, alpha: float = 1.0) -> MotionModel:
    """A model that saw a known field between two abscissae."""
    rng = np.random.default_rng(seed)
    model = MotionModel(EstimatorSettings(alpha=alpha), BASIS.size, 1 / 30)
    w = np.random.default_rng(9).standard_normal((BASIS.size, 8))
    for _ in range(60):
        row = 0.4 * BASIS(np.array([rng.uniform(low, high), rng.uniform(0, 1), 0.0]), Q0)
        model.learn_window(rng.uniform(0, 9), row, row @ w)
        if alpha < 1.0:
            model.learn_rate(1.0, row / 0.4, row @ w / 0.4)
    model.settle(50.0)
    return model


@pytest.mark.parametrize("alpha", [1.0, 0.5])
def test_a_loaded_model_goes_on_as_the_saved_one(tmp_path: Path, alpha: float) -> None:
    models = [_taught(0.0, 1.0, alpha=alpha), _taught(1.0, 2.0, 1, alpha)]
    save_models(tmp_path / "m.npz", [extract(m, BASIS) for m in models])
    for original, learned in zip(models, load_models(tmp_path / "m.npz"), strict=True):
        again = MotionModel(EstimatorSettings(alpha=alpha), BASIS.size, 1 / 30)
        install(again, BASIS, learned)
        np.testing.assert_array_equal(again.weights, original.weights)
        np.testing.assert_array_equal(again.integral.rows, original.integral.rows)
        for _ in range(50):
            again.step()
            original.step()
        np.testing.assert_allclose(again.weights, original.weights, atol=1e-9)


def test_merged_models_know_what_either_knew() -> None:
    """Two halves of a field, each learned apart, against one model that saw all of it."""
    left, right = _taught(0.0, 1.0), _taught(1.0, 2.0, 1)
    whole = MotionModel(EstimatorSettings(), BASIS.size, 1 / 30)
    for part in (left, right):
        for row, increment in zip(part.integral.rows, part.integral.increments, strict=True):
            whole.learn_window(0.0, row, increment)
    whole.settle(2000.0)
    assert merge(left, BASIS, extract(right, BASIS)) == 60
    np.testing.assert_allclose(left.psi, whole.psi, atol=1e-12)
    left.settle(2000.0)
    at = BASIS(np.array([1.6, 0.5, 0.0]), Q0)
    np.testing.assert_allclose(at @ left.weights, at @ whole.weights, atol=2e-2)
    np.testing.assert_allclose(at @ left.weights, at @ right.weights, atol=0.2)


def test_models_of_other_kernels_or_forms_do_not_mix() -> None:
    learned = extract(_taught(0.0, 2.0), BASIS)
    other = RbfBasis.create(BASIS.centres + 0.1, 0.25)
    with pytest.raises(DataError, match="not the estimator's"):
        install(MotionModel(EstimatorSettings(), BASIS.size, 1 / 30), other, learned)
    with pytest.raises(DataError, match="form 'twist'"):
        install(MotionModel(EstimatorSettings(form="stacked"), BASIS.size, 1 / 30), BASIS, learned)
    with pytest.raises(DataError, match="use merge"):
        install(_taught(0.0, 1.0), BASIS, learned)


def _change(changes: dict) -> Callable[[dict, dict], None]:
    def change(header: dict, arrays: dict) -> None:
        for name, value in changes.items():
            where = header if name in header else arrays
            if value is None:
                del where[name]
            else:
                where[name] = value

    return change


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"version": 7}, "version 7"),
        ({"format": "x"}, "format 'x'"),
        ({"form": "x"}, "form 'x'"),
        ({"models": 0}, "models 0"),
        ({"models": 2}, "'rows_1' is missing"),
        ({"weights_0": None}, "'weights_0' is missing"),
        ({"weights_0": np.zeros((3, 8))}, "'weights_0' is float64"),
        ({"models": True}, "models True"),
        ({"heading_scale_m": 1}, "heading_scale_m 1"),
        ({"rows_0": np.full((60, BASIS.size), np.nan)}, "'rows_0' holds"),
        ({"rows_0": np.zeros((60, BASIS.size), dtype=int)}, "'rows_0' is int64"),
        ({"increments_0": np.zeros((5, 8))}, "'increments_0' is"),
        ({"precision": np.zeros((BASIS.size, 2, 2))}, "no basis"),
    ],
)
def test_files_that_do_not_fit_are_refused_by_name(tmp_path: Path, changes: dict, words: str) -> None:
    path = tmp_path / "m.npz"
    save_models(path, [extract(_taught(0.0, 1.0), BASIS)])
    rewritten(path, _change(changes), seal=True)
    with pytest.raises(DataError, match=words):
        load_models(path)


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    with pytest.raises(DataError, match="No such file"):
        load_models(path)
    save_models(path, [extract(_taught(0.0, 1.0), BASIS)])
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for cut in (0, 10, len(whole) // 2, len(whole) - 5):
        path.write_bytes(whole[:cut])
        with pytest.raises(DataError, match=r"m\.npz"):
            load_models(path)
    for _ in range(20):
        damaged = bytearray(whole)
        start = int(rng.integers(200, len(whole) - 600))
        damaged[start : start + 40] = rng.bytes(40)
        path.write_bytes(bytes(damaged))
        with pytest.raises(DataError, match=r"m\.npz"):
            load_models(path)
    np.savez(path, a=np.zeros(3))
    with pytest.raises(DataError, match="no header"):
        load_models(path)
    with pytest.raises(DataError, match="no models"):
        save_models(path, [])


def test_weights_beyond_the_projection_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    save_models(path, [extract(_taught(0.0, 1.0), BASIS)])
    rewritten(path, lambda _, arrays: arrays.update(weights_0=1e3 * arrays["weights_0"]), seal=True)
    with pytest.raises(DataError, match="weight_bound"):
        install(MotionModel(EstimatorSettings(), BASIS.size, 1 / 30), BASIS, load_models(path)[0])

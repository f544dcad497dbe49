"""Learned models on disk, and merged from several regions, targets or runs.

A file is a sealed archive (`camnet.storage.archive`): the header has the form, the number of models and the scale of
headings; ``centres``, ``precision`` are the basis; ``rows_i``, ``increments_i``, ``entered_i`` (and the same with
``rate_`` in front) are the stacks of model i, ``weights_i`` its weights. Models can be joined when they speak of the
same kernels and outputs.

Merging offers every window of one model to the stack of the other, whose selection rule decides what to keep; the law
then settles on the joint data. As the windows of both obey the same equation, ``Deta = Y W``, their order does not
matter until a stack is full.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import ConfigError, DataError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.propagate import COLUMNS
from camnet.estimation.stack import HistoryStack
from camnet.storage.archive import Archive, read_archive, write_archive
from camnet.types import Array

__all__ = ["LearnedModel", "check_same", "extract", "install", "load_models", "merge", "save_models"]

FORMAT = "camnet learned models"
VERSION = 2
#: time for which the law runs on the joint data after a merger, s
SETTLE_S = 120.0
_STACKS = ("", "rate_")


@dataclass(frozen=True, eq=False, slots=True)
class LearnedModel:
    """What one model learned, over p kernels.

    Attributes
    ----------
    form : ``twist`` or ``stacked``
    basis : the kernels
    weights : (p, 8)
    stacks : for the integral windows and for the measured rates: rows (n, p), increments (n, 8), times (n,), s
    """

    form: str
    basis: RbfBasis
    weights: Array
    stacks: tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]


def _contents(stack: HistoryStack) -> tuple[Array, Array, Array]:
    return stack.rows.copy(), stack.increments.copy(), stack.entered_s.copy()


def extract(model: MotionModel, basis: RbfBasis) -> LearnedModel:
    """Copy what ``model`` has learned over ``basis``."""
    stacks = (_contents(model.integral), _contents(model.instantaneous))
    return LearnedModel(model.form, basis, model.weights.copy(), stacks)


def check_same(form: str, basis: RbfBasis, learned: LearnedModel) -> None:
    """See that a model speaks of the outputs and kernels of an estimator.

    Raises
    ------
    DataError
        If form or kernels differ.
    """
    if learned.form != form:
        raise DataError(f"learned model: form '{learned.form}', but the estimator's is '{form}'")
    same = learned.basis.centres.shape == basis.centres.shape and all(
        np.allclose(a, b, rtol=1e-9, atol=1e-12)
        for a, b in (
            (learned.basis.centres, basis.centres),
            (learned.basis.precision, basis.precision),
            (learned.basis.heading_scale_m, basis.heading_scale_m),
        )
    )
    if not same:
        raise DataError(
            f"learned model: {learned.basis.size} kernels that are not the estimator's {basis.size}; "
            "learned weights mean nothing with other kernels"
        )


def merge(model: MotionModel, basis: RbfBasis, learned: LearnedModel) -> int:
    """Add what was learned elsewhere to ``model``; returns how many windows were taken.

    Raises
    ------
    DataError
        If form or kernels differ.
    """
    taken = _offer(model, basis, learned)
    model.settle(SETTLE_S)
    return taken


def install(model: MotionModel, basis: RbfBasis, learned: LearnedModel) -> None:
    """Put a saved model into a fresh one: its windows and its weights as they were.

    Raises
    ------
    DataError
        If form or kernels differ, or ``model`` has learned something already.
    """
    if model.integral.count + model.instantaneous.count:
        raise DataError("learned model: the model to load it into has data already; use merge")
    _offer(model, basis, learned)
    model.weights = learned.weights.copy()


def _offer(model: MotionModel, basis: RbfBasis, learned: LearnedModel) -> int:
    check_same(model.form, basis, learned)
    if not model.can_hold(learned.weights):
        raise DataError(
            "learned model: its weights are larger than the estimator's weight_bound ever leaves them"
        )
    taken = 0
    for offer, (rows, increments, times) in zip(
        (model.learn_window, model.learn_rate), learned.stacks, strict=True
    ):
        for row, increment, t_s in zip(rows, increments, times, strict=True):
            taken += offer(float(t_s), row, increment)
    # not every window was measured here: excitation is for new measurements to show
    model.visited.clear()
    return taken


def save_models(path: Path | str, models: Sequence[LearnedModel]) -> None:
    """Write models of one basis to ``path``, whole or not at all.

    Raises
    ------
    DataError
        If there are none, or their bases or forms differ.
    """
    path = Path(path)
    if not models:
        raise DataError(f"{path}: no models to save")
    first = models[0]
    arrays: dict[str, Any] = {"centres": first.basis.centres, "precision": first.basis.precision}
    for i, model in enumerate(models):
        if model.form != first.form or model.basis is not first.basis:
            raise DataError(f"{path}: model {i} has another basis or form than model 0; save them apart")
        arrays[f"weights_{i}"] = model.weights
        for prefix, (rows, increments, times) in zip(_STACKS, model.stacks, strict=True):
            arrays |= {
                f"{prefix}rows_{i}": rows,
                f"{prefix}increments_{i}": increments,
                f"{prefix}entered_{i}": times,
            }
    header = {
        "form": first.form,
        "models": len(models),
        "heading_scale_m": first.basis.heading_scale_m,
    }
    write_archive(path, FORMAT, VERSION, header, arrays)


def load_models(path: Path | str) -> list[LearnedModel]:
    """Read models from ``path``.

    Raises
    ------
    DataError
        If the file is missing, is no such archive, is damaged, or holds arrays that do not fit together.
    """
    archive = read_archive(Path(path), FORMAT, VERSION)
    form, count, heading_scale_m = _header(archive)
    try:
        centres = archive.floats("centres", (None, None))
        precision = archive.floats("precision", (len(centres), None, None))
        covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        basis = RbfBasis.create(centres, covariance, heading_scale_m)
    except (np.linalg.LinAlgError, ValueError, ConfigError) as error:
        raise DataError(f"{path}: its kernels are no basis ({error})") from error
    parts = [f"{prefix}{part}" for prefix in _STACKS for part in ("rows", "increments", "entered")]
    names = {f"{part}_{i}" for part in ("weights", *parts) for i in range(count)}
    archive.only({"centres", "precision"} | names)
    return [_model(archive, i, form, basis) for i in range(count)]


def _header(archive: Archive) -> tuple[str, int, float]:
    path, header = archive.path, archive.header
    if set(header) != {"form", "models", "heading_scale_m"}:
        raise DataError(f"{path}: header {sorted(header)}, expected form, heading_scale_m, models")
    form, count, scale = header["form"], header["models"], header["heading_scale_m"]
    if form not in ("twist", "stacked"):
        raise DataError(f"{path}: header: form {form!r}, expected 'twist' or 'stacked'")
    if type(count) is not int or not 1 <= count <= len(archive.arrays):
        raise DataError(f"{path}: header: models {count!r}, expected a positive number")
    if type(scale) is not float or not scale > 0.0:
        raise DataError(f"{path}: header: heading_scale_m {scale!r}, expected a positive number")
    return form, count, scale


def _model(archive: Archive, i: int, form: str, basis: RbfBasis) -> LearnedModel:
    p = basis.size
    stacks = []
    for prefix in _STACKS:
        rows = archive.floats(f"{prefix}rows_{i}", (None, p))
        increments = archive.floats(f"{prefix}increments_{i}", (len(rows), COLUMNS))
        stacks.append((rows, increments, archive.floats(f"{prefix}entered_{i}", (len(rows),))))
    return LearnedModel(form, basis, archive.floats(f"weights_{i}", (p, COLUMNS)), (stacks[0], stacks[1]))

"""Learned models on disk, and merged from several regions, targets or runs.

A file is a NumPy archive (``.npz``): ``header`` is a JSON object with format, version, form and the number of models;
``centres``, ``precision`` are the basis; ``rows_i``, ``increments_i``, ``entered_i`` (and the same with ``rate_`` in
front) are the stacks of model i, ``weights_i`` its weights. Models can be joined when they speak of the same kernels
and outputs. Nothing is unpickled.

Merging offers every window of one model to the stack of the other, whose selection rule decides what to keep; the law
then settles on the joint data. As the windows of both obey the same equation, ``Deta = Y W``, their order does not
matter until a stack is full.
"""

from __future__ import annotations

import json
import struct
import tokenize
import zipfile
import zlib
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
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["LearnedModel", "check_same", "extract", "install", "load_models", "merge", "save_models"]

FORMAT = "camnet learned models"
VERSION = 1
#: time for which the law runs on the joint data after a merger, s
SETTLE_S = 120.0
_STACKS = ("", "rate_")
#: what a damaged archive can raise on its way through NumPy, zipfile and zlib
_UNREADABLE = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    NotImplementedError,
    RuntimeError,
    MemoryError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


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
        "format": FORMAT,
        "version": VERSION,
        "form": first.form,
        "models": len(models),
        "heading_scale_m": first.basis.heading_scale_m,
    }
    arrays["header"] = np.array(json.dumps(header))
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_models(path: Path | str) -> list[LearnedModel]:
    """Read models from ``path``.

    Raises
    ------
    DataError
        If the file is missing, is no such archive, is damaged, or holds arrays that do not fit together.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file of learned models") from error
    except _UNREADABLE as error:
        raise DataError(f"{path}: not a readable archive of learned models ({error})") from error
    header = _header(path, arrays)
    try:
        centres = _array(path, arrays, "centres", (None, None))
        precision = _array(path, arrays, "precision", (len(centres), None, None))
        covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        basis = RbfBasis.create(centres, covariance, header["heading_scale_m"])
    except (np.linalg.LinAlgError, ValueError, ConfigError) as error:
        raise DataError(f"{path}: its kernels are no basis ({error})") from error
    return [_model(path, arrays, i, header["form"], basis) for i in range(header["models"])]


def _header(path: Path, arrays: dict[str, Any]) -> dict[str, Any]:
    try:
        header = json.loads(str(arrays["header"]))
    except (KeyError, json.JSONDecodeError) as error:
        raise DataError(f"{path}: no JSON header; not a file of learned models") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise DataError(f"{path}: header {header!r}, expected format '{FORMAT}'")
    if header.get("version") != VERSION:
        raise DataError(f"{path}: version {header.get('version')!r}, this program reads {VERSION}")
    if header.get("form") not in ("twist", "stacked"):
        raise DataError(f"{path}: form {header.get('form')!r}, expected 'twist' or 'stacked'")
    if not isinstance(header.get("models"), int) or header["models"] < 1:
        raise DataError(f"{path}: models {header.get('models')!r}, expected a positive number")
    if not isinstance(header.get("heading_scale_m"), float):
        raise DataError(f"{path}: heading_scale_m {header.get('heading_scale_m')!r}, expected a number")
    return header


def _array(path: Path, arrays: dict[str, Any], name: str, shape: tuple[int | None, ...]) -> Array:
    """Return the named array if its shape fits (None: any length) and it is finite."""
    if name not in arrays:
        raise DataError(f"{path}: array '{name}' is missing")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits or array.dtype.kind != "f":
        raise DataError(f"{path}: array '{name}' is {array.dtype} {array.shape}, expected float {shape}")
    if not np.isfinite(array).all():
        raise DataError(f"{path}: array '{name}' holds values that are not finite")
    return np.asarray(array, dtype=np.float64)


def _model(path: Path, arrays: dict[str, Any], i: int, form: str, basis: RbfBasis) -> LearnedModel:
    p = basis.size
    stacks = []
    for prefix in _STACKS:
        rows = _array(path, arrays, f"{prefix}rows_{i}", (None, p))
        increments = _array(path, arrays, f"{prefix}increments_{i}", (len(rows), COLUMNS))
        stacks.append((rows, increments, _array(path, arrays, f"{prefix}entered_{i}", (len(rows),))))
    weights = _array(path, arrays, f"weights_{i}", (p, COLUMNS))
    return LearnedModel(form, basis, weights, (stacks[0], stacks[1]))

"""Learned models that outlive a run: written at its end, put into the estimators of the next one at its start.

A file holds one set of models for each target, or one for all: R models a set, R the number of regions (one with
``estimator.share``). Sets and estimators go together like this:

| file | estimators | what happens |
| --- | --- | --- |
| a set for each target | private | each its own |
| one set | private | each starts from a copy of it |
| any sets | `learned_shared` | the first is put in, the others are merged into it |

Windows keep their order of age, but count as older than anything in the new run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from camnet.errors import ConfigError, DataError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.delayed import underlying
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.persistence import LearnedModel, extract, install, merge
from camnet.estimation.protocol import TargetFilter
from camnet.storage.whole_file import check_writable

__all__ = ["check_learning", "check_saving", "collect_learned", "start_from"]

#: estimators that start from saved models; `printed` is the bare one and learns for itself
_STARTS = ("learned", "learned_shared")


def check_saving(path: Path, filters: Sequence[str]) -> None:
    """Refuse before a run what could not be saved after it.

    Raises
    ------
    ConfigError
        There is no such folder, or no estimator that learns.
    OSError
        The file cannot be written.
    """
    if not path.absolute().parent.is_dir() or path.is_dir():
        raise ConfigError(f"--save-model {path}: give a file in a folder that exists")
    check_learning(filters, f"--save-model {path}: ")
    check_writable(path)


def check_learning(filters: Sequence[str], named: str = "") -> None:
    """Refuse a run without an estimator that learns (ConfigError)."""
    if not set(filters) & set(_STARTS):
        raise ConfigError(f"{named}none of the estimators {', '.join(filters)} learns; add 'learned'")


def collect_learned(
    filters: Mapping[str, Sequence[TargetFilter]], basis: RbfBasis, count: int
) -> list[LearnedModel]:
    """Return what the first learning estimator of a run has learned: ``count`` models a target."""
    name = next(name for name in filters if name in _STARTS)
    sets = filters[name][:1] if name == "learned_shared" else filters[name]
    return [extract(_learner(f).model(j), basis) for f in sets for j in range(count)]


def start_from(
    saved: Sequence[LearnedModel],
    path: Path,
    filters: Mapping[str, Sequence[TargetFilter]],
    basis: RbfBasis,
    count: int,
) -> None:
    """Put saved models, read from ``path``, into all fresh estimators that start from them.

    Raises
    ------
    DataError
        Number, form or kernels do not fit.
    """
    sets = [[_aged(one) for one in saved[k : k + count]] for k in range(0, len(saved), count)]
    for name in filters:
        if name not in _STARTS:
            continue
        targets = len(filters[name])
        shared = name == "learned_shared"
        if len(saved) % count or not (shared or len(sets) in (1, targets)):
            raise DataError(
                f"{path}: {len(saved)} learned models, expected {count} (a set for all targets)"
                + (f" or {count * targets} (a set for each of {targets})" if targets > 1 else "")
            )
        for m, target in enumerate(filters[name][:1] if shared else filters[name]):
            for j, one in enumerate(sets[0 if len(sets) == 1 else m]):
                install(_learner(target).model(j), basis, one)
        if shared:
            for more in sets[1:]:
                for j, one in enumerate(more):
                    merge(_learner(filters[name][0]).model(j), basis, one)


def _learner(target: TargetFilter) -> LearningEstimator:
    inner = underlying(target)
    if not isinstance(inner, LearningEstimator):
        raise ConfigError(f"estimator {inner.name!r} has no learned models")
    return inner


def _aged(model: LearnedModel) -> LearnedModel:
    """Shift the times of all windows to before zero: they are older than the run."""
    newest = max((float(times.max()) for _, _, times in model.stacks if len(times)), default=0.0)
    first, second = ((rows, increments, times - newest - 1.0) for rows, increments, times in model.stacks)
    return replace(model, stacks=(first, second))

"""Runs of experiments that are kept: a stopped experiment goes on, and nothing else is taken for a result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from camnet.experiments.kept_runs import KeptRuns
from camnet.settings import Settings
from camnet.types import Array


class Common(Settings):
    factor: float = 2.0


@dataclass(frozen=True, eq=False)
class Found:
    value: float
    trace: Array


DONE: list[int] = []


def work(settings: Common, job: int) -> Found:
    if job == 13:
        raise RuntimeError("stopped here")
    DONE.append(job)
    return Found(settings.factor * job, np.random.default_rng(job).random(3))


def results(jobs: list[int], out, factor: float = 2.0, progress=None) -> list[Found]:
    DONE.clear()
    kept = KeptRuns("trial", Common(factor=factor), work, [Found])
    return kept.results(jobs, "job-{}".format, out, progress, workers=1)


def test_a_stopped_experiment_goes_on_where_it_was(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(RuntimeError, match="stopped"):
        results([1, 2, 13, 3], out)
    assert DONE == [1, 2]
    told: list[float] = []
    found = results([1, 2, 3], out, progress=told.append)
    assert DONE == [3]
    assert told == [pytest.approx(2 / 3), 1.0]
    whole = results([1, 2, 3], None)
    assert DONE == [1, 2, 3]
    assert [f.value for f in found] == [f.value for f in whole] == [2.0, 4.0, 6.0]
    for a, b in zip(found, whole, strict=True):
        np.testing.assert_array_equal(a.trace, b.trace)


def test_other_settings_and_damaged_files_are_run_again(tmp_path, caplog):
    out = tmp_path / "out"
    results([1, 2], out)
    assert [f.value for f in results([1, 2], out, factor=3.0)] == [3.0, 6.0]
    assert DONE == [1, 2]
    for path in tmp_path.glob(".trial-runs/*/job-2.npz"):
        path.write_bytes(path.read_bytes()[:-30])
    assert [f.value for f in results([1, 2], out)] == [2.0, 4.0]
    assert DONE == [2]
    assert "run again" in caplog.text

"""Work on a Ray cluster: results of a local pool to the last bit, also where a worker is killed on the way."""

from __future__ import annotations

import json
import os
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ray")

from camnet.cli.main import main
from camnet.errors import WorkerError
from camnet.estimation.settings import EkfSettings
from camnet.experiments.kept_runs import KeptRuns
from camnet.processes.place import read_place

_RAY = ("--on", "ray", "--jobs", "2")


def _local(tmp_path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[Any, Any]:
    """Run a command locally and on a cluster; return both JSON objects."""
    results = []
    for name, on in (("local", ()), ("ray", _RAY)):
        command, *rest = words
        where = ("--out", str(tmp_path / name))
        assert main([command, *rest, *where, "--json", "--quiet", *on]) in (0, 1)
        results.append(json.loads(capsys.readouterr().out))
    return results[0], results[1]


def _without(content: Any, *names: str) -> Any:
    if isinstance(content, dict):
        return {k: _without(v, *names) for k, v in content.items() if k not in names}
    return [_without(v, *names) for v in content] if isinstance(content, list) else content


def test_forty_seeds_are_those_of_a_local_pool(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    here, there = _local(tmp_path, capsys, "simulate", "quickstart", "--duration", "10", "--seeds", "40")
    assert _without(here, "real_time_factor") == _without(there, "real_time_factor")
    for seed in range(40):
        logs = [(tmp_path / name / f"seed-{seed}" / "log.parquet").read_bytes() for name in ("local", "ray")]
        assert logs[0] == logs[1]


def test_episodes_are_those_of_a_local_pool(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--agents", "ekf,nearest", "--episodes", "50", "--cycles", "60")
    here, there = _local(tmp_path, capsys, "evaluate", *options)
    assert here == there


@pytest.mark.parametrize(
    "options",
    [
        ("stationary_certified", "--learn", "--trials", "10000"),
        ("stationary_certified", "--learn", "--closed-loop", "--trials", "64", "--keep-going"),
        ("patrol", "--trials", "10000"),
    ],
)
def test_attacks_are_those_of_this_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    here, there = _local(tmp_path, capsys, "falsify", *options)
    assert here == there


def test_runs_of_an_experiment_are_those_of_a_local_pool_and_are_kept(tmp_path: Path) -> None:
    def drawn(settings: EkfSettings, job: int) -> float:
        return float(np.random.default_rng(job).normal())

    kept: KeptRuns[int, float] = KeptRuns("trial", EkfSettings(), drawn, [])
    found = [
        kept.results(range(6), "job-{}".format, tmp_path / name / "out", None, 2, place)
        for name, place in (("ray", read_place("ray")), ("ray", read_place("local")))
    ]
    here = [float(np.random.default_rng(job).normal()) for job in range(6)]
    assert found == [here, here]  # the second finds all there
    assert len(list((tmp_path / "ray").glob(".trial-runs/*/job-*.npz"))) == 6


def test_a_killed_worker_is_replaced_and_its_task_done_again(tmp_path: Path) -> None:
    with read_place("ray").workers(2) as workers:
        found = dict(workers.finished(_killed_once(tmp_path / "killed"), range(12)))
    assert found == {k: k * k for k in range(12)}
    assert (tmp_path / "killed").exists()


def test_a_task_that_kills_every_worker_is_an_error_and_nothing_is_left() -> None:
    with pytest.raises(WorkerError, match="a task was lost"), read_place("ray").workers(2) as workers:
        list(workers.finished(_deadly(), range(3)))
    assert not list(Path(tempfile.gettempdir()).glob("cn-ray-*"))


def test_the_error_of_a_task_is_raised_as_it_is() -> None:
    with pytest.raises(ZeroDivisionError), read_place("ray").workers(2) as workers:
        list(workers.finished(_inverse(), [1, 0, 2]))


def test_no_cluster_at_the_address_is_one_clear_error() -> None:
    with pytest.raises(WorkerError, match=r"no Ray cluster at '127\.0\.0\.1:1'"):
        list(read_place("ray:127.0.0.1:1").workers(1).finished(_inverse(), [1]))


# closures travel by value: the workers do not find this file


def _killed_once(mark: Path) -> Callable[[int], int]:
    name = str(mark)

    def work(k: int) -> int:
        if k == 5 and not os.path.exists(name):
            with open(name, "w"):
                pass
            os.kill(os.getpid(), signal.SIGKILL)
        return k * k

    return work


def _deadly() -> Callable[[int], int]:
    def work(k: int) -> int:
        os.kill(os.getpid(), signal.SIGKILL)
        return k

    return work


def _inverse() -> Callable[[int], float]:
    return lambda k: 1 / k

"""Where work is done: what ``--on`` takes, and that results come in the order of the tasks."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from camnet.cli.main import main
from camnet.errors import ConfigError
from camnet.processes import Workers
from camnet.processes.place import LOCAL, Place, in_order, read_place

sys.path.insert(0, str(Path(__file__).parent))  # the workers look for their functions here, too
import pool_programs as programs


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("local", LOCAL),
        ("ray", Place(ray=True)),
        ("ray:auto", Place(True, "auto")),
        ("ray:10.0.0.1:6379", Place(True, "10.0.0.1:6379")),
        ("ray://head:10001", Place(True, "ray://head:10001")),
    ],
)
def test_places_are_read(text: str, place: Place) -> None:
    assert read_place(text) == place


@pytest.mark.parametrize("text", ["", "Ray", "ray:", "ray: ", "slurm", "local:2", "raylet"])
def test_other_places_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="give local, ray, or ray:ADDRESS"):
        read_place(text)


def test_results_are_in_the_order_of_the_tasks() -> None:
    shares: list[float] = []
    assert in_order(None, programs.square, [3, 1, 2], shares.append) == [9, 1, 4]
    assert shares == [pytest.approx(k / 3) for k in (1, 2, 3)]
    with Workers(2) as workers:
        assert in_order(workers, programs.square, range(5), None) == [0, 1, 4, 9, 16]


def test_one_run_is_not_for_a_cluster(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "quickstart", "--on", "ray"]) == 2
    assert "--on ray: one run is done on this machine; add --seeds" in capsys.readouterr().err


def test_an_unknown_place_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "quickstart", "--seeds", "2", "--on", "slurm"]) == 2
    assert "'slurm': unknown; give local" in capsys.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="Ray is installed here")
def test_without_ray_the_extra_is_named() -> None:
    with pytest.raises(ConfigError, match=r"camnet\[ray\]"):
        read_place("ray").workers(2)

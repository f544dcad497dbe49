"""After ``camnet warm-up`` nothing is compiled any more by what it promises to cover."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from camnet.cli.main import main
from camnet.warm_up import GROUPS, workloads

#: runs a command, or plays the environment, and prints what was compiled
_COUNT = """
import sys
import numba.core.event as event
with event.install_recorder("numba:compile") as seen:
    if sys.argv[1] == "environment":
        from camnet.agents import make_team
        from camnet.env import handoff_v0
        env = handoff_v0.parallel_env(max_cycles=600)
        observations, _ = env.reset(seed=3)
        team = make_team("learned", env)
        while env.agents:
            observations, *_ = env.step(team(observations))
    else:
        from camnet.cli.main import main
        # of a world as it is nothing that rests on a prediction is certified: a verdict, and all has run
        assert main(sys.argv[1:]) == (1 if sys.argv[1:] == ["certify", "quickstart"] else 0)
names = [e.data["dispatcher"].py_func.__name__ for _, e in seen.buffer if e.is_start]
print("compiled:", *names)
"""


def test_every_part_has_work_and_no_part_is_unknown(capsys: pytest.CaptureFixture[str]) -> None:
    todo = workloads()
    assert {w.group for w in todo} == set(GROUPS)
    assert len({w.name for w in todo}) == len(todo)
    assert workloads(["certify"]) != []
    assert main(["warm-up", "everything"]) == 2
    assert "quickstart, simulate" in capsys.readouterr().err


def _compiled(cache: Path, place: Path, *words: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", _COUNT, *words],
        env={**os.environ, "CAMNET_CACHE": str(cache)},
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1].split()[1:]


@pytest.mark.slow
def test_after_it_nothing_is_compiled(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    environment = {**os.environ, "CAMNET_CACHE": str(cache)}
    command = [sys.executable, "-m", "camnet.cli.main", "warm-up", "--json", "--quiet"]
    contents = [
        json.loads(
            subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
        )
        for _ in range(2)
    ]
    assert contents[0]["folder"] == str(cache)
    assert contents[0]["compiled"] > 100
    assert contents[1]["compiled"] == 0
    for words in (
        ["simulate", "quickstart", "--no-report", "--out", "simulated"],
        ["environment"],
        [
            "evaluate",
            "--world",
            "quickstart",
            "--agents",
            "learned,ekf",
            "--episodes",
            "4",
            "--out",
            "scores",
        ],
        ["certify", "quickstart"],
        ["certify", "mobile_certified", "--learn"],
        ["coverage", "stationary_certified"],
    ):
        assert _compiled(cache, tmp_path, *words) == [], words

"""Killed commands leave no process and nothing else behind, and their results are those of undisturbed runs."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

linux = pytest.mark.skipif(sys.platform != "linux", reason="finds processes by Linux's /proc")


def _soak(project_root: Path, *words: str) -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, str(project_root / "scripts" / "kill_soak.py"), *words],
        capture_output=True,
        text=True,
        check=False,
    )
    content: dict[str, object] = json.loads(done.stdout)
    assert done.returncode == 0, content
    return content


@linux
@pytest.mark.slow  # about 50 s, and a checkout that nobody changes meanwhile
def test_killed_seeds_go_on_as_if_nothing_had_been(project_root: Path) -> None:
    assert _soak(project_root, "--kills", "2", "--commands", "simulate")["kills"] == 2


@linux
@pytest.mark.slow
def test_sixty_kills(project_root: Path) -> None:
    commands = ["simulate", "evaluate", "reproduce", "report"]
    if importlib.util.find_spec("stable_baselines3") is not None:
        commands.append("train")
    assert _soak(project_root, "--kills", "60", "--commands", ",".join(commands))["kills"] == 60

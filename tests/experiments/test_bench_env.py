"""The environment's benchmark beside its peers."""

from __future__ import annotations

import sys

import pytest

from camnet.experiments import bench_env


def _talkative(seed: int) -> float:
    sys.stdout.write("a peer's greeting\n")
    return 2.0 + seed


def test_a_peer_that_prints_leaves_standard_output_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_env, "_PEERS", {"talkative": _talkative, "absent": lambda seed: None})
    assert bench_env._measure_peers(1) == {"talkative": 3.0}
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "a peer's greeting\n")

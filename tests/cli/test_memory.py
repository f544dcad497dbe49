from __future__ import annotations

import pytest

from camnet.cli import worlds
from camnet.cli.main import main


def test_without_memory_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def greedy(args: object) -> int:
        raise MemoryError("Unable to allocate 7 TiB")

    monkeypatch.setattr(worlds, "run", greedy)
    assert main(["worlds"]) == 1
    assert capsys.readouterr().err == "camnet: out of memory (Unable to allocate 7 TiB): ask for less\n"

"""Every malformed input gives exit status 2, a message with field and value, and leaves no output behind."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from camnet.cli.main import main


def _load_cases() -> ModuleType:
    path = Path(__file__).resolve().parent.parent / "config" / "malformed_cases.py"
    spec = importlib.util.spec_from_file_location("malformed_cases_cli", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


CASES = _load_cases().CASES


def test_there_are_enough_cases() -> None:
    assert len(CASES) >= 40


@pytest.mark.parametrize("case", CASES, ids=[case.id for case in CASES])
def test_malformed_input(
    case: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    inputs, outputs = tmp_path / "inputs", tmp_path / "outputs"
    inputs.mkdir()
    outputs.mkdir()
    monkeypatch.chdir(outputs)
    source = case.write(inputs)
    overrides = [word for text in case.arguments(inputs) for word in ("--set", text)]
    before = sorted(p.name for p in inputs.rglob("*"))
    status = main(["simulate", str(source), *overrides, "--out", str(outputs / "run"), "--quiet"])
    out, err = capsys.readouterr()
    assert status == 2, err
    assert out == ""
    for words in case.mentions:
        assert words in err
    assert "Traceback" not in err
    assert list(outputs.iterdir()) == []
    assert sorted(p.name for p in inputs.rglob("*")) == before

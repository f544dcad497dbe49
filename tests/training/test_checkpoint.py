"""Checkpoints come back as they were; changed, damaged and foreign ones are refused by name."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from camnet.errors import DataError  # noqa: E402 - after the check for torch
from camnet.training.checkpoint import read_checkpoint, write_checkpoint  # noqa: E402


def content() -> dict[str, Any]:
    return {
        "digest": "d",
        "chunk": 2,
        "policy": {"layer.weight": torch.arange(6.0).reshape(2, 3), "layer.bias": torch.zeros(2)},
        "optimiser": {
            "state": {0: {"step": torch.tensor(3.0)}},
            "param_groups": [{"betas": (0.9, 0.99), "lr": 1e-4}],
        },
        "timesteps": 512,
        "history": [{"steps": 256.0}, {"steps": 512.0, "return": -1.5}],
        "imitation_error": float("nan"),
    }


def test_a_checkpoint_comes_back(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "checkpoint.pt", content())
    found = read_checkpoint(tmp_path / "checkpoint.pt")
    assert set(found) == set(content())
    assert torch.equal(found["policy"]["layer.weight"], content()["policy"]["layer.weight"])
    assert found["optimiser"]["param_groups"] == content()["optimiser"]["param_groups"]
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint.pt"]


CHANGES: list[Callable[[dict[str, Any]], object]] = [
    lambda c: c.update(digest="e"),
    lambda c: c.update(chunk=3),
    lambda c: c.update(chunk=2.5),
    lambda c: c.pop("timesteps"),
    lambda c: c.update(more=1),
    lambda c: c.pop("seal"),
    lambda c: c.update(seal=""),
    lambda c: c["history"].pop(),
    lambda c: c["history"][1].update({"return": 1.5}),
    lambda c: c["policy"].pop("layer.bias"),
    lambda c: c["policy"]["layer.weight"].mul_(1.01),
    lambda c: c["policy"]["layer.weight"].fill_(float("nan")),
    lambda c: c["policy"].update({"layer.weight": c["policy"]["layer.weight"].double()}),
    lambda c: c["policy"].update({"layer.weight": c["policy"]["layer.weight"].reshape(3, 2)}),
    lambda c: c["policy"].update({"layer.weight": c["policy"]["layer.weight"].to(torch.int64)}),
    lambda c: c["optimiser"]["state"][0].update(step=torch.tensor(4.0)),
    lambda c: c["optimiser"]["param_groups"][0].update(lr=1.0),
]


@pytest.mark.parametrize("change", CHANGES)
def test_any_change_is_refused(tmp_path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = tmp_path / "checkpoint.pt"
    write_checkpoint(path, content())
    found = torch.load(path, weights_only=True)
    change(found)
    torch.save(found, path)
    with pytest.raises(DataError, match=r"checkpoint\.pt: its content is not what was written"):
        read_checkpoint(path)


@pytest.mark.parametrize("thing", [[1, 2], "text", None, {"seal": {1, 2}}, {1: torch.zeros(2)}])
def test_other_things_are_no_checkpoint(tmp_path: Path, thing: object) -> None:
    path = tmp_path / "checkpoint.pt"
    torch.save(thing, path)
    with pytest.raises(DataError, match=r"checkpoint\.pt"):
        read_checkpoint(path)


def test_damaged_and_missing_files_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "checkpoint.pt"
    with pytest.raises(DataError, match="No such file"):
        read_checkpoint(path)
    write_checkpoint(path, content())
    whole = path.read_bytes()
    for cut in (0, 4, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(DataError, match=r"checkpoint\.pt"):
            read_checkpoint(path)
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file,
        file.open("data.pkl", "w", force_zip64=True) as out,
    ):
        out.write(bytes(3_000_000))
    monkeypatch.setattr("camnet.training.checkpoint._LIMIT_BYTES", 2_000_000)
    with pytest.raises(DataError, match="would unpack"):
        read_checkpoint(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(DataError, match="no file"):
        read_checkpoint(path)

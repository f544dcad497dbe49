"""Policy files come back as they were; damaged and malicious ones give an error and run nothing."""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from artefacts import rewritten
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camnet.agents.policy_file import PolicyHeader, PolicyNet, load_policy, save_policy
from camnet.errors import DataError


def make_net(features: int = 4, outputs: int = 5) -> PolicyNet:
    rng = np.random.default_rng(0)
    header = PolicyHeader(features=tuple(f"f{k}" for k in range(features)), training={"steps": 3})
    weights = (rng.normal(size=(features, 8)), rng.normal(size=(8, outputs)))
    return PolicyNet(
        header, rng.normal(size=features), np.full(features, 2.0), weights, (np.zeros(8), np.ones(outputs))
    )


class Harm:
    """Unpickling it would make a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


def archive(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return path


def test_a_policy_comes_back_and_acts_as_before(tmp_path: Path) -> None:
    net = make_net()
    save_policy(tmp_path / "p.npz", net)
    back = load_policy(tmp_path / "p.npz")
    x = np.random.default_rng(1).normal(size=(10, 4))
    np.testing.assert_array_equal(back(x), net(x))
    by_hand = np.clip(np.tanh((x - net.mean) / 2.0 @ net.weights[0]) @ net.weights[1] + 1.0, -1.0, 1.0)
    np.testing.assert_allclose(back(x), by_hand, atol=1e-12)
    assert back.header.training == {"steps": 3}
    assert [p.name for p in tmp_path.iterdir()] == ["p.npz"]


def test_a_pickle_inside_an_array_does_not_run(tmp_path: Path) -> None:
    trap = np.empty(1, dtype=object)
    trap[0] = Harm(tmp_path / "harmed")
    content = io.BytesIO()
    np.save(content, trap, allow_pickle=True)
    header = io.BytesIO()
    np.save(header, np.frombuffer(b"{}", dtype=np.uint8))
    for name in ("weight_0.npy", "header.npy"):
        path = archive(tmp_path / "trap.npz", {"header.npy": header.getvalue(), name: content.getvalue()})
        with pytest.raises(DataError, match=r"trap\.npz"):
            load_policy(path)
        assert not (tmp_path / "harmed").exists()
    np.load(path, allow_pickle=True)["header"]  # the trap does spring where pickles are let in
    assert (tmp_path / "harmed").exists()


@pytest.mark.parametrize("content", [b"", b"not an archive", pickle.dumps({"weights": [1]})])
def test_other_files_are_named_as_such(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "p.npz").write_bytes(content)
    with pytest.raises(DataError, match=r"p\.npz: is not a readable archive"):
        load_policy(tmp_path / "p.npz")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        load_policy(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": "other"}, "format 'other'"),
        ({"version": 1}, "version 1"),
        ({"run": "rm"}, "description is wrong"),
        ({"activation": "lambda x: x"}, "description is wrong"),
        ({"residual_scale": -1.0}, "description is wrong"),
        ({"features": ["a"]}, "'mean' is float64"),
    ],
)
def test_wrong_descriptions_are_refused(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    save_policy(tmp_path / "p.npz", make_net())
    rewritten(tmp_path / "p.npz", lambda header, _: header.update(changes), seal=True)
    with pytest.raises(DataError, match=words):
        load_policy(tmp_path / "p.npz")


def test_wrong_numbers_are_refused(tmp_path: Path) -> None:
    net = make_net()
    for broken in (
        PolicyNet(net.header, net.mean, net.scale * 0, net.weights, net.biases),
        PolicyNet(net.header, net.mean * np.nan, net.scale, net.weights, net.biases),
        PolicyNet(net.header, net.mean, net.scale, net.weights[:1], net.biases[1:]),
    ):
        save_policy(tmp_path / "p.npz", broken)
        with pytest.raises(DataError):
            load_policy(tmp_path / "p.npz")


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.data())
def test_flipped_bytes_never_give_anything_but_a_data_error(tmp_path: Path, data: st.DataObject) -> None:
    save_policy(tmp_path / "good.npz", make_net())
    content = bytearray((tmp_path / "good.npz").read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / "bad.npz").write_bytes(bytes(content[: data.draw(st.integers(1, len(content)))]))
    with contextlib.suppress(DataError):
        load_policy(tmp_path / "bad.npz")

"""Training: the same command gives the same weights, stopped or not; the file acts as the learner's network does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch

from camnet.agents import load_policy
from camnet.errors import DataError
from camnet.training.environments import open_worlds
from camnet.training.settings import TrainSettings
from camnet.training.train import _Run, train

SMALL = TrainSettings(
    estimator="ekf",
    environments=2,
    max_cycles=60,
    imitation_steps=400,
    imitation_epochs=2,
    rollout_steps=32,
    chunk_steps=256,
    minibatch=64,
    hidden=(8,),
    steps=512,
    threads=1,
)


def weights(folder: Path) -> np.ndarray:
    net = load_policy(folder / "policy.npz")
    return np.concatenate([w.ravel() for w in (*net.weights, *net.biases, net.mean, net.scale)])


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Folder and result of a whole run with seed 3."""
    folder = tmp_path_factory.mktemp("trained") / "whole"
    return folder, train(SMALL, 3, folder, None)


def test_the_same_seed_gives_the_same_policy_and_another_seed_another(
    trained: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    whole, result = trained
    train(SMALL, 3, tmp_path / "again", None)
    train(SMALL, 4, tmp_path / "other", None)
    assert result["steps"] == 512
    assert len(result["episodes"]) == 2
    np.testing.assert_array_equal(weights(whole), weights(tmp_path / "again"))
    assert not np.array_equal(weights(whole), weights(tmp_path / "other"))


def test_a_run_that_was_stopped_ends_as_one_that_was_not(
    trained: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    train(SMALL.model_copy(update={"steps": 256}), 3, tmp_path / "parts", None)
    halfway = weights(tmp_path / "parts")
    train(SMALL, 3, tmp_path / "parts", None)
    assert not np.array_equal(halfway, weights(tmp_path / "parts"))
    np.testing.assert_array_equal(weights(trained[0]), weights(tmp_path / "parts"))
    with pytest.raises(DataError, match="other settings, seed or version"):
        train(SMALL, 5, tmp_path / "parts", None)


@pytest.mark.parametrize("residual", ["learned", None])
def test_the_file_acts_as_the_network_that_was_trained(tmp_path: Path, residual: str | None) -> None:
    settings = SMALL.model_copy(update={"residual_of": residual, "teacher": "ekf"})
    train(settings, 1, tmp_path / "p", None)
    worlds = open_worlds(settings)
    run = _Run(settings, 1, tmp_path / "p", worlds, lambda share, words: None)
    assert run._restore()
    rng = np.random.default_rng(0)
    net = load_policy(tmp_path / "p" / "policy.npz")
    features = net.mean + net.scale * rng.normal(size=(50, len(net.mean)))
    wanted, _ = run.model.predict(run.normaliser(features), deterministic=True)
    np.testing.assert_allclose(net(features), np.clip(wanted, -1.0, 1.0), atol=2e-5)
    assert net.header.residual_of == residual
    for world in worlds:
        world.rows.close()


def test_a_residual_policy_starts_as_the_rule_itself(tmp_path: Path) -> None:
    worlds = open_worlds(SMALL)
    run = _Run(SMALL, 1, tmp_path / "p", worlds, lambda share, words: None)
    run._imitate()
    assert run.imitation_error == 0.0
    features = np.random.default_rng(0).normal(size=(9, len(run.normaliser.mean)))
    np.testing.assert_array_equal(run.policy()(features), np.zeros((9, 5)))
    worlds[0].rows.close()


def test_a_checkpoint_that_would_run_code_is_refused(tmp_path: Path) -> None:
    class Harm:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.mkdir, (tmp_path / "harmed",)

    (tmp_path / "p").mkdir()
    torch.save({"digest": Harm()}, tmp_path / "p" / "checkpoint.pt")
    with pytest.raises(DataError, match="cannot be read"):
        train(SMALL, 1, tmp_path / "p", None)
    assert not (tmp_path / "harmed").exists()

"""Rows for a learner can be copied: they go on like the original."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("torch")

from camnet.env.batch_handoff import BatchHandoff
from camnet.env.batch_vector import sb3_vec_env
from camnet.errors import ConfigError
from camnet.training.environments import open_worlds
from camnet.training.rows import JoinedRows
from camnet.training.settings import TrainSettings


def rows_of_a_batch() -> Any:
    return sb3_vec_env(BatchHandoff("quickstart", 2, filter_name="ekf", threads=1, max_cycles=7))


def joined_rows() -> Any:
    settings = TrainSettings(
        worlds=("quickstart",),
        environments=2,
        estimator="ekf",
        threads=1,
        max_cycles=7,
        residual_of="learned",
    )
    return JoinedRows([world.rows for world in open_worlds(settings)])


@pytest.mark.parametrize("make", [rows_of_a_batch, joined_rows])
def test_copies_go_on_bit_for_bit(make: Callable[[], Any]) -> None:
    rows = make()
    rows.seed(3)
    rows.reset()
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (12, rows.num_envs, *rows.action_space.shape)).astype(np.float32)
    for action in actions[:4]:
        rows.step(action)
    copies = [
        copy.deepcopy(rows),
        pickle.loads(pickle.dumps(rows)),
        cloudpickle.loads(cloudpickle.dumps(rows)),
    ]
    told = [[one.step(action)[:3] for action in actions[4:]] for one in (*copies, rows)]
    for other in told[1:]:
        for one_step, other_step in zip(told[0], other, strict=True):
            for one, another in zip(one_step, other_step, strict=True):
                np.testing.assert_array_equal(one, another)
    rows.close()
    with pytest.raises(ConfigError, match="closed"):
        rows.reset()
    assert copies[0].reset().shape[0] == rows.num_envs


def test_misuse_of_rows() -> None:
    rows = rows_of_a_batch()
    with pytest.raises(ConfigError, match="not reset"):
        rows.step(np.zeros((8, 5), dtype=np.float32))
    rows.reset()
    for wrong in (
        np.zeros((4, 5)),
        np.full((8, 5), np.nan),
        np.full((8, 5), 2.0),
        np.zeros((8, 5), dtype=int),
    ):
        with pytest.raises(ConfigError, match="actions = "):
            rows.step(wrong)
    with pytest.raises(ConfigError, match="seed = -1"):
        rows.seed(-1)
    rows.set_options({"gravity": 1.0})
    with pytest.raises(ConfigError, match="gravity"):
        rows.reset()
    rows.close()

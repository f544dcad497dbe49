"""Small valid files of every kind that camnet reads back, and ways to change them."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from camnet.agents.features import FEATURES
from camnet.agents.policy_file import PolicyHeader, PolicyNet, save_policy
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.persistence import extract, save_models
from camnet.estimation.settings import EstimatorSettings
from camnet.evaluation.kept import keep_scores, score_file
from camnet.evaluation.play import Match
from camnet.evaluation.scores import METRICS
from camnet.experiments.learned_model import LearnedModel
from camnet.storage.seal import seal_of

__all__ = [
    "learned_models",
    "learned_motion",
    "pack",
    "policy",
    "rewritten",
    "run_folder",
    "scores",
    "unpack",
]


def policy(path: Path) -> Path:
    """Write a policy that `camnet evaluate --agents PATH` takes."""
    rng = np.random.default_rng(0)
    header = PolicyHeader(features=FEATURES, residual_of="learned", residual_scale=0.3, training={"steps": 3})
    n = len(FEATURES)
    weights = (0.1 * rng.normal(size=(n, 4)), 0.1 * rng.normal(size=(4, 5)))
    save_policy(
        path, PolicyNet(header, rng.normal(size=n), np.full(n, 2.0), weights, (np.zeros(4), np.zeros(5)))
    )
    return path


def learned_models(path: Path) -> Path:
    """Write one learned model (`camnet simulate --save-model`) over four kernels."""
    basis = RbfBasis.create(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]), 0.25)
    rng = np.random.default_rng(0)
    model = MotionModel(EstimatorSettings(), basis.size, 1 / 30)
    for k in range(6):
        model.learn_window(float(k), rng.uniform(size=basis.size), rng.normal(size=8))
    model.settle(10.0)
    save_models(path, [extract(model, basis)])
    return path


def learned_motion(path: Path) -> Path:
    """Write a learned motion of one target (`camnet certify --learn`) over two kernels and three regions."""
    t_s = np.arange(0.1, 6.05, 0.1)
    seen = np.where(np.arange(len(t_s)) % 20 < 10, np.arange(len(t_s)) // 20 % 3, -1.0)
    around = np.c_[t_s, np.cos(t_s), np.sin(t_s), seen]
    gaps = np.array([[0.0, 1.0, 1.1, 2.1, 0.2], [1.0, 2.0, 3.1, 4.1, 0.1]])
    rng = np.random.default_rng(0)
    LearnedModel(
        np.array([[0.0, 0.0], [1.0, 0.5]]),
        np.repeat(4.0 * np.eye(2)[None], 2, axis=0),
        0.3 * rng.normal(size=(3, 2, 8)),
        around,
        gaps,
        "world",
        "robot",
    ).save(path)
    return path


def run_folder(folder: Path, seconds: float = 2.0) -> Path:
    """Write the run of a short simulation, without pictures."""
    from camnet import __version__
    from camnet.config.load import load_scenario
    from camnet.simulation.run import run_network
    from camnet.simulation.run_files import write_run

    scenario = load_scenario("quickstart", [f"run.duration_s={seconds:g}"], seed=3)
    result = run_network(scenario, 3)
    folder.mkdir(parents=True)
    content = {
        "summary": result.summary,
        "seed": 3,
        "version": __version__,
        "config": scenario.model_dump(mode="json"),
    }
    write_run(folder, content, result.handoffs, result.log, result.events)
    return folder


def scores(folder: Path, match: Match, seeds: range) -> Path:
    """Write made-up scores, as an evaluation of ``match`` keeps them; returns their file."""
    made = {s: {name: float(s % 7) + 0.25 * k for k, name in enumerate(METRICS)} for s in seeds}
    keep_scores(folder, match, "pybullet", made)
    return score_file(folder, match)


# --- changes -------------------------------------------------------------------------------------------


def unpack(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return header and arrays of an archive."""
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in data.files}
    return json.loads(arrays.pop("header").tobytes()), arrays


def pack(
    path: Path,
    header: Mapping[str, Any] | bytes,
    arrays: Mapping[str, Any],
    compression: int = zipfile.ZIP_DEFLATED,
    reverse: bool = False,
    pickled: bool = False,
) -> None:
    """Write an archive as it is told, right or wrong."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    members = [("header", np.frombuffer(text, np.uint8)), *arrays.items()]
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, array in reversed(members) if reverse else members:
            content = io.BytesIO()
            np.save(content, array, allow_pickle=pickled)
            file.writestr(f"{name}.npy", content.getvalue())


def rewritten(
    path: Path,
    change: Callable[[dict[str, Any], dict[str, Any]], None],
    seal: bool = False,
) -> None:
    """Change header and arrays of an archive in place; with ``seal`` its seal is made to fit again."""
    header, arrays = unpack(path)
    change(header, arrays)
    if seal:
        header["seal"] = seal_of({k: v for k, v in header.items() if k != "seal"}, arrays)
    pack(path, header, arrays)

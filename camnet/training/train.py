"""Parameter-shared PPO (Stable-Baselines3) on the batch back end, after imitation of a built-in agent.

One network acts for every agent of every environment; a row of the learner's batch is one agent. Determinism: torch
works with a fixed number of threads and deterministic algorithms, and every chunk sets all generators and environments
from the seed and its number, which is also what makes a resumed run end where an uninterrupted one does.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

from camnet import __version__
from camnet.agents import save_policy
from camnet.agents.features import FEATURES
from camnet.agents.policy_file import PolicyHeader, PolicyNet
from camnet.env.infos import EPISODE
from camnet.errors import DataError
from camnet.training.checkpoint import read_checkpoint, write_checkpoint
from camnet.training.environments import WorldRows, open_worlds, rule_on_rows
from camnet.training.imitation import as_layers, collect, imitate
from camnet.training.rows import JoinedRows, Normaliser, Rule
from camnet.training.settings import TrainSettings

__all__ = ["train"]

#: called with the share of the run that is done, and a line on how it goes
Progress = Callable[[float, str], None]


def train(
    settings: TrainSettings, seed: int, folder: Path, progress: Progress | None = None
) -> dict[str, Any]:
    """Train a policy and write it.

    The folder gets ``policy.npz`` (the result so far, after every chunk), ``checkpoint.pt`` (weights and optimiser,
    read back as plain tensors) and TensorBoard's files. A folder that holds a checkpoint of the same settings, seed and
    version is gone on with.

    Returns
    -------
    dict
        ``{"policy", "steps", "imitation_error", "episodes": [{"steps", "return", "time_in_view"}]}``

    Raises
    ------
    ConfigError
        A world does not exist or has no agents.
    DataError
        The folder's checkpoint is of another run.
    """
    _fix_threads(settings.threads)
    worlds = open_worlds(settings)
    try:
        run = _Run(settings, seed, folder, worlds, progress or (lambda share, words: None))
        return run.go()
    finally:
        for world in worlds:
            world.rows.close()


def _fix_threads(threads: int) -> None:
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    torch.set_num_threads(threads)
    torch.use_deterministic_algorithms(True)


class _Run:
    """One training run in its folder."""

    def __init__(
        self, settings: TrainSettings, seed: int, folder: Path, worlds: list[WorldRows], progress: Progress
    ) -> None:
        self.settings, self.seed, self.folder, self.worlds, self.progress = (
            settings,
            seed,
            folder,
            worlds,
            progress,
        )
        self.rows = JoinedRows([world.rows for world in worlds])
        s = settings
        self.model = PPO(
            "MlpPolicy",
            self.rows,
            learning_rate=s.learning_rate,
            n_steps=s.rollout_steps,
            batch_size=s.minibatch,
            n_epochs=s.epochs,
            gamma=s.discount,
            gae_lambda=s.gae_lambda,
            clip_range=s.clip,
            ent_coef=s.entropy,
            policy_kwargs={
                "net_arch": list(s.hidden),
                "log_std_init": s.log_std,
                "activation_fn": torch.nn.Tanh,
            },
            seed=seed,
            device="cpu",
        )
        folder.mkdir(parents=True, exist_ok=True)
        self.model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
        self.normaliser = Normaliser.none()
        self.history: list[dict[str, float]] = []
        self.imitation_error = float("nan")
        self.chunk = 0

    @property
    def steps(self) -> int:
        """Decisions of single agents so far."""
        return self.chunk * self._chunk_rows

    @property
    def _chunk_rows(self) -> int:
        per_rollout: int = self.settings.rollout_steps * self.rows.num_envs
        return max(1, self.settings.chunk_steps // per_rollout) * per_rollout

    def go(self) -> dict[str, Any]:
        """Imitate, then learn chunk by chunk."""
        if self._restore():  # the run may have been stopped between checkpoint and policy
            save_policy(self.folder / "policy.npz", self.policy())
        else:
            self._imitate()
            self._keep()
        while self.steps < self.settings.steps:
            self._learn_chunk()
            self._keep()
        return {
            "policy": str(self.folder / "policy.npz"),
            "steps": self.steps,
            "imitation_error": None if np.isnan(self.imitation_error) else self.imitation_error,
            "episodes": self.history,
        }

    def _imitate(self) -> None:
        s, rng = self.settings, np.random.default_rng([self.seed, 0])
        lessons = []
        for world in self.worlds:
            world.rows.seed(_child_seed(self.seed, 0))
            teacher = self._teacher(world)
            count = max(s.imitation_steps, 20_000) // len(self.worlds)
            self.progress(0.0, f"watching {s.teacher} on {world.name}")
            lessons.append(collect(world.rows, teacher, count, s.discount, rng))
        features = np.concatenate([x.features.reshape(-1, len(FEATURES)) for x in lessons])
        actions = np.concatenate([x.actions.reshape(len(x.returns.ravel()), -1) for x in lessons])
        returns = np.concatenate([x.returns.ravel() for x in lessons])
        self._use(Normaliser.of(features))
        if s.residual_of:
            _still(self.model)
        if s.imitation_steps:
            self.imitation_error = imitate(
                self.model,
                self.normaliser(features),
                actions,
                returns,
                s.imitation_epochs,
                lambda share: self.progress(0.0, f"imitating {s.teacher}: {share:.0%}"),
            )

    def _teacher(self, world: WorldRows) -> Rule:
        """Return what is imitated; a policy that adds to a rule starts by adding nothing."""
        s = self.settings
        if s.residual_of:
            return lambda shown: np.zeros((len(shown), world.rows.action_space.shape[0]), dtype=np.float32)
        known = {context.name: context for context in world.known}
        return rule_on_rows(s.teacher, known, world.rows.num_envs // len(known), self.seed)

    def _use(self, normaliser: Normaliser) -> None:
        self.normaliser = normaliser
        for world in self.worlds:
            world.rows.normaliser = normaliser

    def _learn_chunk(self) -> None:
        self.chunk += 1
        model, seed = self.model, _child_seed(self.seed, self.chunk)
        model.set_random_seed(seed)  # torch, NumPy and the environments
        model._last_obs = None  # new episodes: nothing of the last chunk reaches into this one
        meter = _Meter(self.settings, self.steps - self._chunk_rows, self.progress)
        model.learn(self._chunk_rows, callback=meter, reset_num_timesteps=False)
        self.history.append({"steps": float(self.steps), **meter.summary()})

    # --- what is kept ----------------------------------------------------------------------------------------------

    def _digest(self) -> str:
        settings = self.settings.model_dump(mode="json", exclude={"steps"})  # a run may be made longer
        return hashlib.sha256(json.dumps([__version__, self.seed, settings]).encode()).hexdigest()

    def _keep(self) -> None:
        content = {
            "digest": self._digest(),
            "chunk": self.chunk,
            "policy": self.model.policy.state_dict(),
            "optimiser": self.model.policy.optimizer.state_dict(),
            "mean": torch.as_tensor(self.normaliser.mean),
            "scale": torch.as_tensor(self.normaliser.scale),
            "timesteps": self.model.num_timesteps,
            "history": self.history,
            "imitation_error": self.imitation_error,
        }
        write_checkpoint(self.folder / "checkpoint.pt", content)
        save_policy(self.folder / "policy.npz", self.policy())

    def _restore(self) -> bool:
        path = self.folder / "checkpoint.pt"
        if not os.path.lexists(path):
            return False
        content = read_checkpoint(path)
        if content.get("digest") != self._digest():
            raise DataError(
                f"checkpoint {path}: is of other settings, seed or version; give another --out or remove it"
            )
        if (
            content["timesteps"] != content["chunk"] * self._chunk_rows
            or len(content["history"]) != content["chunk"]
        ):
            raise DataError(f"checkpoint {path}: its chunks, steps and history do not fit together")
        try:
            self.model.policy.load_state_dict(content["policy"])
            self.model.policy.optimizer.load_state_dict(content["optimiser"])
        except (RuntimeError, ValueError, KeyError) as error:
            raise DataError(
                f"checkpoint {path}: its weights are not those of these settings ({error})"
            ) from error
        self._use(Normaliser(content["mean"].numpy(), content["scale"].numpy()))
        self.chunk, self.history = content["chunk"], content["history"]
        self.model.num_timesteps, self.imitation_error = content["timesteps"], content["imitation_error"]
        return True

    def policy(self) -> PolicyNet:
        """Return the policy's mean as a policy file's content."""
        weights, biases = as_layers(self.model)
        training = {
            "settings": self.settings.model_dump(mode="json"),
            "seed": self.seed,
            "steps": self.steps,
            "camnet": __version__,
        }
        header = PolicyHeader(
            features=FEATURES,
            filter_name=self.settings.estimator,
            residual_of=self.settings.residual_of,
            residual_scale=self.settings.residual_scale,
            training=training,
        )
        return PolicyNet(header, self.normaliser.mean, self.normaliser.scale, weights, biases)


def _child_seed(seed: int, chunk: int) -> int:
    return int(np.random.SeedSequence([seed, chunk]).generate_state(1)[0] % 2**31)


def _still(model: PPO) -> None:
    """Make the policy's mean zero everywhere."""
    with torch.no_grad():
        model.policy.action_net.weight.zero_()
        model.policy.action_net.bias.zero_()


class _Meter(BaseCallback):
    """Watches finished episodes and tells how the run goes."""

    def __init__(self, settings: TrainSettings, before: int, progress: Progress) -> None:
        super().__init__()
        self._settings, self._before, self._progress = settings, before, progress
        self._returns: list[float] = []
        self._in_view: list[float] = []
        self._done = before

    def _on_step(self) -> bool:
        self._done += self.training_env.num_envs
        for info in self.locals["infos"]:
            if "episode" in info:
                self._returns.append(float(info["episode"]["r"]))
                self._in_view.append(float(info[EPISODE]["time_in_view"]))
        return True

    def _on_rollout_end(self) -> None:
        figures = self.summary()
        for name, value in figures.items():
            self.logger.record(f"episodes/{name}", value)
        words = (
            ""
            if not self._returns
            else f"return {figures['return']:.2f}, in view {figures['time_in_view']:.1%}"
        )
        self._progress(min(self._done / self._settings.steps, 1.0), words)

    def summary(self) -> dict[str, float]:
        """Mean return and time in view of the episodes that ended in this chunk."""
        if not self._returns:
            return {}
        return {"return": float(np.mean(self._returns)), "time_in_view": float(np.nanmean(self._in_view))}

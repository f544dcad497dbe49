"""Imitation of a built-in agent: least squares on its actions, the start of a training run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from camnet.training.rows import FeatureRows

__all__ = ["as_layers", "collect", "imitate"]

_BATCH = 2048


def collect(
    rows: FeatureRows,
    teacher: Callable[[NDArray[np.float32]], NDArray[np.float32]],
    count: int,
    rng: np.random.Generator,
    noise: float = 0.3,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Features (B, F) and the teacher's actions (B, A) of about ``count`` decisions.

    In half of the rows noise of standard deviation ``noise`` is added to what is done, not to what is learned, so
    that the pupil sees places that the teacher would not get to (Laskey et al., "DART", CoRL 2017).
    """
    features, actions = [np.asarray(rows.reset())], []
    shaken = rng.random(rows.num_envs) < 0.5
    for _ in range(max(1, count // rows.num_envs)):
        wanted = teacher(rows.shown)
        actions.append(wanted)
        done = wanted + shaken[:, None] * rng.normal(scale=noise, size=wanted.shape)
        shown, *_ = rows.step(np.clip(done, -1.0, 1.0).astype(np.float32))
        features.append(np.asarray(shown))
    return np.concatenate(features[:-1]), np.concatenate(actions)


def imitate(
    model: PPO,
    features: NDArray[np.float32],
    actions: NDArray[np.float32],
    epochs: int,
    progress: Callable[[float], None] | None = None,
) -> float:
    """Fit the policy's mean to the teacher's actions; returns the last epoch's mean square error."""
    policy, generator = model.policy, torch.Generator().manual_seed(int(model.seed or 0))
    optimiser = torch.optim.Adam(policy.parameters(), lr=1e-3)
    x, y = torch.as_tensor(features), torch.as_tensor(actions)
    loss_sum = 0.0
    for epoch in range(epochs):
        order, loss_sum = torch.randperm(len(x), generator=generator), 0.0
        for k in range(0, len(x), _BATCH):
            rows = order[k : k + _BATCH]
            mean = policy.action_net(policy.mlp_extractor.forward_actor(x[rows]))
            loss = ((mean - y[rows]) ** 2).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            loss_sum += float(loss.detach()) * len(rows)
        if progress is not None:
            progress((epoch + 1) / epochs)
    return loss_sum / len(x)


def as_layers(model: PPO) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Weights (in, out) and biases of the policy's mean, layer by layer."""
    layers = [m for m in model.policy.mlp_extractor.policy_net if isinstance(m, torch.nn.Linear)]
    layers.append(model.policy.action_net)
    weights = tuple(layer.weight.detach().numpy().T.astype(float).copy() for layer in layers)
    return weights, tuple(layer.bias.detach().numpy().astype(float).copy() for layer in layers)

"""Imitation of a built-in agent: least squares on its actions and on what they bring; the start of a training run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from camnet.training.rows import FeatureRows

__all__ = ["Lessons", "as_layers", "collect", "imitate"]

_BATCH = 2048


@dataclass(frozen=True, eq=False)
class Lessons:
    """What was seen, and what the teacher did.

    Attributes
    ----------
    features, actions : (T, B, F), (T, B, A) of T decisions in B rows
    returns : (T, B) discounted sums of the rewards that followed; NaN where too little followed to know
    """

    features: NDArray[np.float32]
    actions: NDArray[np.float32]
    returns: NDArray[np.float32]


def collect(
    rows: FeatureRows,
    teacher: Callable[[NDArray[np.float32]], NDArray[np.float32]],
    count: int,
    discount: float,
    rng: np.random.Generator,
    noise: float = 0.3,
) -> Lessons:
    """Watch the teacher for about ``count`` decisions.

    In half of the rows noise of standard deviation ``noise`` is added to what is done, not to what is learned, so
    that the pupil sees places that the teacher would not get to (Laskey et al., "DART", CoRL 2017).
    """
    shown, features, actions, rewards, ends = np.asarray(rows.reset()), [], [], [], []
    shaken = np.asarray(rng.random(rows.num_envs) < 0.5)
    for _ in range(max(1, count // rows.num_envs)):
        wanted = teacher(rows.shown)
        features.append(shown)
        actions.append(wanted)
        done = wanted + shaken[:, None] * rng.normal(scale=noise, size=wanted.shape)
        next_shown, reward, ended, _ = rows.step(np.clip(done, -1.0, 1.0).astype(np.float32))
        shown = np.asarray(next_shown)
        rewards.append(reward)
        ends.append(ended)
    returns = _returns(np.array(rewards), np.array(ends), discount)
    returns[:, shaken] = np.nan  # they are not the teacher's
    return Lessons(np.array(features), np.array(actions), returns)


def _returns(rewards: NDArray[Any], ends: NDArray[Any], discount: float) -> NDArray[np.float32]:
    """Discounted sums of (T, B) rewards, running over the ends of episodes; NaN in the last ``5 / (1 - discount)``."""
    sums, tail = np.zeros_like(rewards), np.zeros(rewards.shape[1])
    for t in range(len(rewards) - 1, -1, -1):
        tail = rewards[t] + discount * tail * ~ends[t]
        sums[t] = tail
    unknown = round(5.0 / max(1.0 - discount, 1e-6))
    sums[max(0, len(rewards) - unknown) :] = np.nan
    return sums.astype(np.float32)


def imitate(
    model: PPO,
    features: NDArray[np.float32],
    actions: NDArray[np.float32],
    returns: NDArray[np.float32],
    epochs: int,
    progress: Callable[[float], None] | None = None,
) -> float:
    """Fit the policy's mean to the teacher's actions (B, A), and the critic to the returns (B,) that are known.

    Returns the last epoch's mean square error of the actions.
    """
    policy, generator = model.policy, torch.Generator().manual_seed(int(model.seed or 0))
    optimiser = torch.optim.Adam(policy.parameters(), lr=1e-3)
    x, y, g = torch.as_tensor(features), torch.as_tensor(actions), torch.as_tensor(returns)
    known, error = torch.isfinite(g), 0.0
    for epoch in range(epochs):
        order, error = torch.randperm(len(x), generator=generator), 0.0
        for rows in order.split(_BATCH):
            mean = policy.action_net(policy.mlp_extractor.forward_actor(x[rows]))
            misfit = ((mean - y[rows]) ** 2).mean()
            told = rows[known[rows]]
            value = policy.value_net(policy.mlp_extractor.forward_critic(x[told]))[:, 0]
            loss = misfit + (((value - g[told]) ** 2).mean() if len(told) else 0.0)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            error += float(misfit.detach()) * len(rows)
        if progress is not None:
            progress((epoch + 1) / epochs)
    return error / len(x)


def as_layers(model: PPO) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Weights (in, out) and biases of the policy's mean, layer by layer."""
    layers = [m for m in model.policy.mlp_extractor.policy_net if isinstance(m, torch.nn.Linear)]
    layers.append(model.policy.action_net)
    weights = tuple(layer.weight.detach().numpy().T.astype(float).copy() for layer in layers)
    return weights, tuple(layer.bias.detach().numpy().astype(float).copy() for layer in layers)

"""Settings of a training run."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["TrainSettings"]

_Count = Annotated[int, Field(gt=0)]


class TrainSettings(Settings):
    """What is trained on, and how.

    ``steps`` counts decisions of single agents. A run goes in chunks of ``chunk_steps``: at the start of each, all
    generators and environments are set anew from the seed and the chunk's number, and after each a checkpoint is
    kept; so a run that was stopped and went on ends with the same weights as one that was not.

    ``imitation_steps`` decisions of the built-in agent ``teacher`` are imitated first (0: from scratch). PPO's names
    are those of Schulman et al., "Proximal policy optimization algorithms", 2017.
    """

    worlds: tuple[str, ...] = ("quickstart",)
    steps: _Count = 4_000_000
    environments: _Count = 64
    max_cycles: _Count = 1200
    estimator: str = "learned"
    teacher: str = "learned"
    imitation_steps: Annotated[int, Field(ge=0)] = 200_000
    imitation_epochs: _Count = 30
    hidden: tuple[_Count, ...] = (64, 64)
    rollout_steps: _Count = 128
    chunk_steps: _Count = 500_000
    minibatch: _Count = 4096
    epochs: _Count = 4
    learning_rate: Positive = 3e-4
    discount: Fraction = 0.99
    gae_lambda: Fraction = 0.95
    clip: Positive = 0.2
    entropy: NonNegative = 0.0
    log_std: float = -2.0
    threads: _Count = 2

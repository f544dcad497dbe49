"""Settings of a training run."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["TrainSettings"]

_Count = Annotated[int, Field(gt=0, le=10_000_000_000)]
_Size = Annotated[int, Field(gt=0, le=100_000)]


class TrainSettings(Settings):
    """What is trained on, and how.

    ``steps`` counts decisions of single agents. A run goes in chunks of ``chunk_steps``: at the start of each, all
    generators and environments are set anew from the seed and the chunk's number, and after each a checkpoint is
    kept; so a run that was stopped and went on ends with the same weights as one that was not.

    With ``residual_of: learned`` the network's output, times ``residual_scale``, is added to what the built-in agent
    does (residual policy learning: Silver et al., 2018; Johannink et al., 2019), and ``imitation_steps`` decisions
    teach the critic alone. With ``residual_of: null`` the network acts by itself: ``imitation_steps`` decisions of
    the built-in agent ``teacher`` are imitated first (0: from scratch). PPO's names are those of Schulman et al.,
    "Proximal policy optimization algorithms", 2017.
    """

    worlds: tuple[str, ...] = ("quickstart",)
    steps: _Count = 4_000_000
    environments: _Size = 64
    max_cycles: _Size = 1200
    estimator: str = "learned"
    residual_of: Literal["learned"] | None = "learned"
    residual_scale: Annotated[float, Field(gt=0, le=2)] = 0.3
    teacher: str = "learned"
    imitation_steps: Annotated[int, Field(ge=0, le=10_000_000_000)] = 200_000
    imitation_epochs: _Size = 20
    hidden: Annotated[tuple[Annotated[int, Field(gt=0, le=4096)], ...], Field(max_length=16)] = (64, 64)
    rollout_steps: _Size = 128
    chunk_steps: _Count = 500_000
    minibatch: _Count = 4096
    epochs: _Size = 4
    learning_rate: Positive = 1e-4
    discount: Fraction = 0.99
    gae_lambda: Fraction = 0.95
    clip: Positive = 0.2
    entropy: NonNegative = 0.0
    log_std: Annotated[float, Field(ge=-20, le=5)] = -2.0
    threads: Annotated[int, Field(gt=0, le=1024)] = 2

"""Policy files: weights and a JSON description, nothing that runs.

A policy file is a sealed archive (`camnet.storage.archive`): ``mean`` and ``scale`` (F,) normalise the features;
``weight_k`` (in, out) and ``bias_k`` (out,) are the layers of a perceptron. Archives that would unpack to more than
`SIZE_LIMIT_BYTES`, unknown members, wrong shapes or types and numbers that are not finite are refused.

| header field | meaning |
| --- | --- |
| ``format``, ``version``, ``seal`` | ``camnet-policy``, 2, digest of the content |
| ``features`` | names of the features in order (`camnet.agents.features`) |
| ``activation`` | between layers: ``tanh`` or ``relu``; the last layer is linear, then clipped to [-1, 1] |
| ``filter_name`` | estimator that the observations must come from |
| ``residual_of`` | null, or the built-in agent whose action the output is added to |
| ``residual_scale`` | weight of the output then |
| ``training`` | how it was made: free figures and words |
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from camnet.errors import DataError
from camnet.storage.archive import Archive, read_archive, write_archive
from camnet.types import Array

__all__ = ["SIZE_LIMIT_BYTES", "PolicyHeader", "PolicyNet", "load_policy", "save_policy"]

#: no policy of this kind is larger; an archive that claims to be is not read
SIZE_LIMIT_BYTES = 64_000_000
FORMAT, VERSION = "camnet-policy", 2


class PolicyHeader(BaseModel):
    """The JSON description; see the module's table."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    features: tuple[str, ...]
    activation: Literal["tanh", "relu"] = "tanh"
    filter_name: str = "learned"
    residual_of: Literal["learned"] | None = None
    residual_scale: Annotated[float, Field(gt=0, le=2)] = 1.0
    training: dict[str, Any] = {}


@dataclass(frozen=True, eq=False)
class PolicyNet:
    """A perceptron with normalised inputs.

    Attributes
    ----------
    header : description
    mean, scale : (F,) features are shown to the network as ``clip((x - mean) / scale, -10, 10)``
    weights, biases : layers, (in, out) and (out,)
    """

    header: PolicyHeader
    mean: Array
    scale: Array
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def __call__(self, features: NDArray[np.floating[Any]]) -> Array:
        """Return the output (..., A) in [-1, 1] for features (..., F)."""
        x = np.clip((np.asarray(features, dtype=float) - self.mean) / self.scale, -10.0, 10.0)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = x @ weight + bias
            x = np.tanh(x) if self.header.activation == "tanh" else np.maximum(x, 0.0)
        return np.asarray(np.clip(x @ self.weights[-1] + self.biases[-1], -1.0, 1.0))


def save_policy(path: Path, net: PolicyNet) -> None:
    """Write a policy file (under a temporary name first, then renamed)."""
    arrays = {"mean": net.mean, "scale": net.scale}
    for k, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
        arrays |= {f"weight_{k}": weight, f"bias_{k}": bias}
    write_archive(path, FORMAT, VERSION, net.header.model_dump(mode="json"), arrays)


def load_policy(path: Path) -> PolicyNet:
    """Read a policy file.

    Raises
    ------
    DataError
        The file cannot be read, is no policy file, or breaks a rule of the format; nothing of it was run.
    """
    archive = read_archive(path, FORMAT, VERSION, SIZE_LIMIT_BYTES)
    try:
        header = PolicyHeader.model_validate_json(json.dumps(archive.header))
    except ValidationError as error:
        raise DataError(f"policy {path}: its description is wrong: {error}") from error
    return _net(archive, header)


def _net(archive: Archive, header: PolicyHeader) -> PolicyNet:
    layers = sum(name.startswith("weight_") for name in archive.arrays)
    if layers == 0:
        raise DataError(f"{archive.path}: array 'weight_0' is missing")
    archive.only({"mean", "scale"} | {f"{part}_{k}" for part in ("weight", "bias") for k in range(layers)})
    width = len(header.features)
    mean, scale = archive.floats("mean", (width,)), archive.floats("scale", (width,))
    if not (scale > 0).all():
        raise DataError(f"{archive.path}: array 'scale' holds numbers that are not positive")
    weights, biases = [], []
    for k in range(layers):
        weights.append(archive.floats(f"weight_{k}", (width, None)))
        width = weights[-1].shape[1]
        biases.append(archive.floats(f"bias_{k}", (width,)))
    return PolicyNet(header, mean, scale, tuple(weights), tuple(biases))

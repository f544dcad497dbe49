"""Policy files: weights and a JSON description, nothing that runs.

A policy file is a NumPy archive (``.npz``, a zip of plain arrays): ``header`` holds UTF-8 JSON as bytes; ``mean`` and
``scale`` (F,) normalise the features; ``weight_k`` (in, out) and ``bias_k`` (out,) are the layers of a perceptron.
Object arrays, which are pickles and could run code, are refused by the reader, as are archives that would unpack to
more than `SIZE_LIMIT_BYTES`, unknown members, wrong shapes and numbers that are not finite.

| header field | meaning |
| --- | --- |
| ``format``, ``version`` | ``camnet-policy``, 1 |
| ``features`` | names of the features in order (`camnet.agents.features`) |
| ``activation`` | between layers: ``tanh`` or ``relu``; the last layer is linear, then clipped to [-1, 1] |
| ``filter_name`` | estimator that the observations must come from |
| ``residual_of`` | null, or the built-in agent whose action the output is added to |
| ``residual_scale`` | weight of the output then |
| ``training`` | how it was made: free figures and words |
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from camnet.errors import DataError
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["SIZE_LIMIT_BYTES", "PolicyHeader", "PolicyNet", "load_policy", "save_policy"]

#: no policy of this kind is larger; an archive that claims to be is not read
SIZE_LIMIT_BYTES = 64_000_000
#: what the readers of zip archives and of arrays raise on files that are damaged or made to do harm
_BROKEN = (
    ValueError,
    KeyError,
    EOFError,
    MemoryError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)


class PolicyHeader(BaseModel):
    """The JSON description; see the module's table."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["camnet-policy"] = "camnet-policy"
    version: Literal[1] = 1
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
    header = json.dumps(net.header.model_dump(mode="json")).encode()
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, header=np.frombuffer(header, dtype=np.uint8), **arrays)  # type: ignore[arg-type]


def load_policy(path: Path) -> PolicyNet:
    """Read a policy file.

    Raises
    ------
    DataError
        The file cannot be read, is no policy file, or breaks a rule of the format; nothing of it was run.
    """
    try:
        arrays = _members(path)
        header = PolicyHeader.model_validate_json(arrays.pop("header").astype(np.uint8).tobytes())
    except OSError as error:
        raise DataError(f"policy {path}: cannot be read: {error}") from error
    except ValidationError as error:
        raise DataError(f"policy {path}: its description is wrong: {error}") from error
    except _BROKEN as error:
        raise DataError(
            f"policy {path}: is no policy file ({error}); camnet train writes archives of plain arrays"
        ) from error
    return _net(path, header, arrays)


def _members(path: Path) -> dict[str, Array]:
    """All arrays of the archive; pickled ones are refused by NumPy's reader."""
    with zipfile.ZipFile(path) as archive:
        size = sum(info.file_size for info in archive.infolist())
    if size > SIZE_LIMIT_BYTES:
        raise ValueError(f"it would unpack to {size} bytes, more than {SIZE_LIMIT_BYTES}")
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: np.asarray(archive[name]) for name in archive.files}
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu":
            raise ValueError(f"array {name!r} has type {array.dtype}, should hold numbers")
    if "header" not in arrays:
        raise ValueError("it has no header")
    return arrays


def _net(path: Path, header: PolicyHeader, arrays: dict[str, Array]) -> PolicyNet:
    layers = sum(name.startswith("weight_") for name in arrays)
    names = {"mean", "scale"} | {f"{part}_{k}" for part in ("weight", "bias") for k in range(layers)}
    if layers == 0 or set(arrays) != names:
        raise DataError(f"policy {path}: holds {sorted(arrays)}, should hold {sorted(names)}")
    values = {name: array.astype(float) for name, array in arrays.items()}
    width = len(header.features)
    for k in range(layers):
        weight, bias = values[f"weight_{k}"], values[f"bias_{k}"]
        if weight.ndim != 2 or weight.shape[0] != width or bias.shape != (weight.shape[1],):
            raise DataError(
                f"policy {path}: layer {k} has shapes {weight.shape} and {bias.shape}, should take {width} numbers"
            )
        width = weight.shape[1]
    shapes_fit = values["mean"].shape == values["scale"].shape == (len(header.features),)
    if not shapes_fit or not (values["scale"] > 0).all():
        raise DataError(
            f"policy {path}: mean and scale must be {len(header.features)} numbers, scale positive"
        )
    for name, value in values.items():
        if not np.isfinite(value).all():
            raise DataError(f"policy {path}: {name} holds numbers that are not finite")
    weights = tuple(values[f"weight_{k}"] for k in range(layers))
    return PolicyNet(
        header, values["mean"], values["scale"], weights, tuple(values[f"bias_{k}"] for k in range(layers))
    )

"""Checkpoints of a training run: plain tensors and values, sealed; nothing in them runs.

A checkpoint is what `torch.save` makes of a dict of tensors, numbers, text, lists and dicts. It is read with torch's
reader of plain values, within a limit on size, and has to be what was written (`camnet.storage.seal`).
"""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import Any

import torch

from camnet.errors import DataError
from camnet.storage.reading import open_bounded
from camnet.storage.seal import seal_of
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["read_checkpoint", "write_checkpoint"]

_LIMIT_BYTES = 1_000_000_000


def write_checkpoint(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint, whole or not at all."""
    with whole_file(path) as temporary:
        torch.save({**content, "seal": _seal(content)}, temporary)


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint.

    Raises
    ------
    DataError
        It cannot be read, is too large, or is not what was written.
    """
    with open_bounded(path, _LIMIT_BYTES) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                size = sum(info.file_size for info in archive.infolist())
            if size > _LIMIT_BYTES:
                raise ValueError(f"it would unpack to {size} bytes, more than the limit of {_LIMIT_BYTES}")
            stream.seek(0)
            content = torch.load(stream, map_location="cpu", weights_only=True)
        except Exception as error:  # torch documents no narrower class
            words = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise DataError(
                f"checkpoint {path}: cannot be read ({words}); remove it to start anew"
            ) from error
    seal = content.pop("seal", None) if isinstance(content, dict) else None
    try:
        fits = seal == _seal(content)
    except (TypeError, ValueError, RecursionError):  # things that no checkpoint holds
        fits = False
    if not fits:
        raise DataError(
            f"checkpoint {path}: its content is not what was written (its seal does not fit); remove it to start anew"
        )
    return dict(content)


def _seal(content: object) -> str:
    arrays: dict[str, Array] = {}
    return seal_of(_plain(content, "", arrays), arrays)


def _plain(value: object, where: str, arrays: dict[str, Array]) -> object:
    """Return ``value`` as JSON has it, its tensors put into ``arrays`` under their places."""
    if isinstance(value, torch.Tensor):
        arrays[where] = value.detach().cpu().numpy()
        return "tensor"
    if isinstance(value, dict):
        return {str(k): _plain(v, f"{where}/{k}", arrays) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v, f"{where}/{k}", arrays) for k, v in enumerate(value)]
    return None if isinstance(value, float) and math.isnan(value) else value

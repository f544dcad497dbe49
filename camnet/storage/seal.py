"""Seals: digests of what a file means, not of its bytes, so that any change of content is found and none of form.

A seal is the SHA-256 of the values: JSON with its names in order, arrays with name, type, shape and numbers. Another
compression, layout or order of names keeps it. It is no signature: it finds damage and careless edits.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["seal_of"]


def seal_of(content: object, arrays: Mapping[str, NDArray[Any]] | None = None) -> str:
    """Return the seal of JSON content (no NaN) and arrays of numbers."""
    total = hashlib.sha256()
    read_back = json.loads(json.dumps(content, allow_nan=False))  # tuples are lists there, names are text
    plain = json.dumps(read_back, sort_keys=True, separators=(",", ":"))
    total.update(plain.encode())
    for name, array in sorted((arrays or {}).items()):
        little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
        if little.dtype.kind == "f":
            little = np.where(np.isnan(little), np.array(np.nan, little.dtype), little)  # of one kind
        total.update(f"\n{name} {little.dtype.str} {array.shape}\n".encode())
        total.update(little.tobytes())
    return total.hexdigest()

"""Machine code on disk: one file for each compiled function and kind of arguments, named by a digest of what it is.

A file's name holds two digests: of the function's source (`camnet.compiled.source`), and of everything else that
decides the code: arguments, options, processor, versions. Whoever looks for the same name wants the same content, so
several clones, installations and processes share a folder without locks: a file is written under another name and
renamed.
The content begins with its own digest; a file that is cut short or of another program counts as absent.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.serialize import dumps as _dumps

from camnet.cache_folder import KERNELS, cache_folders
from camnet.storage.whole_file import sweep_files, whole_file

__all__ = ["held", "is_known", "load", "prune", "remove", "save", "sweep"]

_LOG = logging.getLogger(__name__)
_DIGEST_BYTES = hashlib.sha256().digest_size
#: characters of a digest in a name
_SHOWN = 24
#: a file that is used is marked so at most this often
_DAY_S = 86_400.0
#: Numba has no types for its inside
dumps: Any = _dumps
_saving = True


def _name(function: str, source: str, key: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_.]+", "_", function)[-120:]
    return f"{plain}-{source[:_SHOWN]}-{key[:_SHOWN]}.kernel"


def load(function: str, source: str, key: str) -> Any | None:  # noqa: ANN401 - whatever was saved
    """Return what was saved for a function, the digest of its source and that of all else; None if nothing was."""
    for folder in cache_folders().read:
        path = folder / KERNELS / _name(function, source, key)
        try:
            content = path.read_bytes()
        except OSError:
            continue
        if hashlib.sha256(content[_DIGEST_BYTES:]).digest() != content[:_DIGEST_BYTES]:
            continue
        try:
            found = pickle.loads(content[_DIGEST_BYTES:])
        except Exception:  # it names a class that is elsewhere now
            _LOG.debug("%s cannot be read and is written anew", path, exc_info=True)
            continue
        _mark_used(path)
        return found
    return None


def _mark_used(path: Path) -> None:
    try:
        if time.time() - path.stat().st_mtime > _DAY_S:
            os.utime(path)
    except OSError:  # an administrator's folder
        pass


def save(function: str, source: str, key: str, data: object) -> None:
    """Keep the code of a function; a disk that is full or cannot be written gives one warning, never an error."""
    global _saving
    folder = cache_folders().write
    if folder is None or not _saving:
        return
    path = folder / KERNELS / _name(function, source, key)
    payload = dumps(data)
    try:
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        with whole_file(path) as temporary:
            temporary.write_bytes(hashlib.sha256(payload).digest() + payload)
    except OSError as error:
        _saving = False
        _LOG.warning("cache: %s cannot be written (%s); kernels are compiled again", folder, error.strerror)


def is_known(function: str, source: str) -> bool:
    """Whether there is any code of a function as it is now, for whatever arguments."""
    stem = _name(function, source, "").removesuffix(".kernel")
    return any(next((f / KERNELS).glob(f"{stem}*"), None) for f in cache_folders().read)


def remove(function: str, source: str) -> None:
    """Forget all code of a function as it is now."""
    stem, folder = _name(function, source, "").removesuffix(".kernel"), cache_folders().write
    for path in () if folder is None else (folder / KERNELS).glob(f"{stem}*"):
        path.unlink(missing_ok=True)


def _files() -> Iterator[Path]:
    folder = cache_folders().write
    return iter(()) if folder is None else (folder / KERNELS).iterdir()


def held() -> tuple[int, int]:
    """Return how many compiled functions are kept, and their size in bytes."""
    sizes = [path.stat().st_size for path in _files() if path.suffix == ".kernel"]
    return len(sizes), sum(sizes)


def sweep() -> None:
    """Remove what processes that were killed left half-written."""
    folder = cache_folders().write
    if folder is not None:
        with suppress(OSError):
            sweep_files(folder / KERNELS)


def prune(days: float) -> int:
    """Remove code that was not used for so many days; return how many files went."""
    old = [p for p in _files() if p.suffix == ".kernel" and time.time() - p.stat().st_mtime > days * _DAY_S]
    for path in old:
        path.unlink(missing_ok=True)
    return len(old)

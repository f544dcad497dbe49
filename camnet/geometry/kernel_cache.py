"""Numba's cache on disk, for several processes at once, and for code that is spread over several files.

To add a kernel, Numba reads an index, takes the next free file name and writes the index back. Of two processes that do
so at the same moment both take the same name, and what one wrote is later read as the other's code. So processes take
turns, folder by folder; where the system has no such locks, all is as Numba has it.

Numba takes code from the disk until the kernel's own file changes. Here it also has to be the same code that the kernel
calls, constants that it reads and fields of the named tuples that it takes, wherever they are written
(`camnet.geometry.kernel_source`). Kernels that call nothing of this package are left to Numba.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.caching import Cache as _KernelCache
from numba.core.caching import IndexDataCacheFile as _IndexDataCacheFile

from camnet.geometry.kernel_source import fields_of, source_digest

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

__all__ = ["announce", "notice_changes", "take_turns"]

_LOG = logging.getLogger(__name__)

#: the inside of Numba has no types
_Cache: Any = _IndexDataCacheFile
_Kernel: Any = _KernelCache


@contextmanager
def _turn(folder: Path) -> Iterator[None]:
    try:
        lock = (folder / "camnet.lock").open("w")
    except OSError:  # no such folder yet, or nothing can be written there
        yield
        return
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # until the file is closed
        yield


def _in_turn(method: Callable[..., Any]) -> Callable[..., Any]:
    def locked(self: Any, *arguments: Any) -> Any:  # noqa: ANN401 - of Numba's inside
        with _turn(Path(self._cache_path)):
            return method(self, *arguments)

    return locked


def _or_nothing(method: Callable[..., dict[Any, str]]) -> Callable[..., dict[Any, str]]:
    """Read an index; one that cannot be read, as it names a class that is elsewhere now, counts as none."""

    def read(self: Any) -> dict[Any, str]:  # noqa: ANN401 - of Numba's inside
        try:
            return method(self)
        except Exception:
            _LOG.debug("%s cannot be read and is written anew", self._index_path, exc_info=True)
            return {}

    return read


def take_turns() -> None:
    """Let this process take turns with others in reading and writing compiled kernels; called once, on import."""
    if fcntl is not None:
        _Cache.save, _Cache.load = _in_turn(_Cache.save), _in_turn(_Cache.load)


def _digest(kernel: Any) -> str | None:  # noqa: ANN401 - of Numba's inside
    """Digest of all that the kernel is made of, which its code on disk must bear besides Numba's stamp."""
    if not hasattr(kernel, "_camnet_digest"):  # not on import: names may be bound further down in the file
        digest = kernel._camnet_digest = source_digest(kernel._py_func, "camnet")
        file = kernel._cache_file
        if digest is not None:
            file._source_stamp = (file._source_stamp, digest)
    of: str | None = kernel._camnet_digest
    return of


def _stamped(method: Callable[..., Any]) -> Callable[..., Any]:
    def stamped(self: Any, *arguments: Any) -> Any:  # noqa: ANN401 - of Numba's inside
        _digest(self)
        return method(self, *arguments)

    return stamped


def _with_fields(method: Callable[..., Any]) -> Callable[..., Any]:
    def keyed(self: Any, signature: Any, codegen: Any) -> Any:  # noqa: ANN401 - of Numba's inside
        key = method(self, signature, codegen)
        if _digest(self) is None:
            return key
        return (*key, tuple(fields_of(of) for of in getattr(signature, "args", signature)))

    return keyed


def notice_changes() -> None:
    """Let code on disk count only while all that is compiled into it is as it was; called once, on import."""
    _Kernel.load_overload, _Kernel.save_overload = (
        _stamped(_Kernel.load_overload),
        _stamped(_Kernel.save_overload),
    )
    _Kernel._index_key = _with_fields(_Kernel._index_key)
    _Cache._load_index = _or_nothing(_Cache._load_index)


def announce(kernel: Any, what: str) -> None:  # noqa: ANN401 - a compiled function
    """Warn that ``what`` has to be compiled first, if the disk has no code of ``kernel`` as it is; call before it."""
    cache = kernel._cache
    if kernel.signatures or not hasattr(cache, "_cache_file"):
        return
    _digest(cache)
    if not cache._cache_file._load_index():
        _LOG.warning("compiling %s; this takes a minute or two, once on this machine", what)

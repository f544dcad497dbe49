"""Numba's cache on disk, for several processes at once.

To add a kernel, Numba reads an index, takes the next free file name and writes the index back. Of two processes that do
so at the same moment both take the same name, and what one wrote is later read as the other's code. So processes take
turns, folder by folder; where the system has no such locks, all is as Numba has it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile as _IndexDataCacheFile

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

__all__ = ["announce", "take_turns"]

_LOG = logging.getLogger(__name__)

#: the inside of Numba has no types
_Cache: Any = _IndexDataCacheFile


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


def take_turns() -> None:
    """Let this process take turns with others in reading and writing compiled kernels; called once, on import."""
    if fcntl is not None:
        _Cache.save, _Cache.load = _in_turn(_Cache.save), _in_turn(_Cache.load)


def announce(kernel: Any, what: str) -> None:  # noqa: ANN401 - a compiled function
    """Warn that ``what`` has to be compiled first, if there is no code of ``kernel`` on disk yet; call before it."""
    files = getattr(kernel._cache, "_cache_file", None)
    if not kernel.signatures and files is not None and not Path(files._index_path).exists():
        _LOG.warning("compiling %s; this takes a minute or two, once on this machine", what)

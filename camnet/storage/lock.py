"""One writer of a folder at a time: a lock file beside the folder, held by the kernel for the life of its process.

The lock ends with the process, however it ends; the file that a killed process leaves behind blocks nobody and goes
with the next run. Where the system or the file system has no such locks, nothing is locked.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from camnet.errors import ConfigError
from camnet.storage.names import short_name

try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # no such locks on this system
    LOCK_EX = LOCK_NB = 0  # type: ignore[misc]

    def flock(descriptor: int, operation: int) -> None:  # type: ignore[misc]
        """Lock nothing."""


__all__ = ["FolderBusyError", "folder_lock", "locked_name"]

_PREFIX = ".camnet-lock."
_ATTEMPTS = 10


class FolderBusyError(ConfigError):
    """Another run is writing this folder."""


def _lock_path(folder: Path) -> Path:
    """Return where the lock of ``folder`` lies: beside it, as the folder itself may not be there yet."""
    return folder.parent / f"{_PREFIX}{short_name(folder.name)}"


def locked_name(name: str) -> str | None:
    """Return which folder a lock file is for; None if it is no lock file."""
    return name.removeprefix(_PREFIX) if name.startswith(_PREFIX) and name != _PREFIX else None


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of ``folder``.

    Raises
    ------
    FolderBusyError
        Another process, or another run of this one, holds it.
    OSError
        The lock file cannot be made: the parent folder cannot be written.
    """
    path = _lock_path(folder)
    descriptor = _take(path, folder)
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # while it is held: nobody else's
        os.close(descriptor)


def _take(path: Path, folder: Path) -> int:
    attempts = 0
    while True:
        descriptor = os.open(
            path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0), 0o644
        )
        if not _lock(descriptor):
            os.close(descriptor)
            attempts += 1
            if attempts < _ATTEMPTS:  # a run that sweeps holds it for a moment
                time.sleep(0.02)
                continue
            raise FolderBusyError(
                f"--out {str(folder)!r}: another run is writing this folder; wait for it, or give another"
            )
        if _is_at(descriptor, path):
            return descriptor
        os.close(descriptor)  # its holder removed it in between: a new file is the lock now


def _lock(descriptor: int) -> bool:
    try:
        flock(descriptor, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # this file system has no locks
        return True
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path, follow_symlinks=False))
    except FileNotFoundError:
        return False

"""Bytes of a file: a regular one, of bounded size, or an error that names it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from camnet.errors import DataError

__all__ = ["open_bounded", "read_bounded"]


@contextmanager
def open_bounded(path: Path, limit_bytes: int) -> Iterator[BinaryIO]:
    """Open a regular file (through links) of at most ``limit_bytes`` for reading.

    Raises
    ------
    DataError
        There is none, it is a folder or a device, it may not be read, or it is larger.
    """
    try:
        # a pipe without a writer would block the opening
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError as error:  # a null character in the name
        raise DataError(f"{str(path)!r}: cannot be read ({error})") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or status.st_size > limit_bytes:
        os.close(descriptor)
        what = f"has {status.st_size} bytes, more than the limit of {limit_bytes}"
        raise DataError(
            f"{path}: {what if stat.S_ISREG(status.st_mode) else 'is no file, a file was expected'}"
        )
    with os.fdopen(descriptor, "rb") as stream:
        yield stream


def read_bounded(path: Path, limit_bytes: int) -> bytes:
    """Return the content of a regular file of at most ``limit_bytes`` (DataError as `open_bounded`)."""
    with open_bounded(path, limit_bytes) as stream:
        content = stream.read(limit_bytes + 1)
    if len(content) > limit_bytes:  # it grew
        raise DataError(f"{path}: has more bytes than the limit of {limit_bytes}")
    return content

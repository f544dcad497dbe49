"""Files that are whole or absent: written under a temporary name beside, then renamed."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from camnet.storage.names import parse, temporary_name

__all__ = ["check_writable", "sweep_files", "whole_file", "write_json", "write_text"]


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path with the ending of ``path``; it becomes ``path`` on success and vanishes on error."""
    temporary = path.with_name(temporary_name(path.name))
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(temporary)):
            error.filename = str(path)  # the name that people know
        raise


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, content: object) -> None:
    """Write indented JSON, whole or not at all."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def check_writable(path: Path) -> None:
    """See that ``path`` can be written, without touching what is there.

    Raises
    ------
    OSError
        It cannot: no such folder, no permission, a full disk, a name that is too long.
    """
    with suppress(FileNotFoundError):
        if not stat.S_ISREG(os.stat(path).st_mode) or not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    sweep_files(path.parent)
    temporary = path.with_name(temporary_name(path.name))
    try:
        temporary.write_bytes(b"\0" * 512)  # a full disk shows when something is written
    except OSError as error:
        error.filename = str(path)
        raise
    finally:
        with suppress(OSError):
            temporary.unlink()


def sweep_files(folder: Path) -> None:
    """Remove the temporary files that dead processes of this host left in ``folder``."""
    with os.scandir(folder) as entries:
        for entry in entries:
            left = parse(entry.name)
            if left is not None and left.is_stale() and entry.is_file(follow_symlinks=False):
                Path(entry.path).unlink(missing_ok=True)

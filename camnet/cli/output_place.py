"""Where an output folder may be: never a place that holds, or could hold, what camnet did not write."""

from __future__ import annotations

import errno
import glob
import os
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path

from camnet.errors import ConfigError
from camnet.storage.marker import MARKER, foreign_file, read_marker

__all__ = ["clear", "close_to", "open_place", "plain_words"]

_WORDS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than the system's limit allows",
    errno.EROFS: "the file system is read-only",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.ENAMETOOLONG: "the name is too long",
}


def plain_words(error: BaseException) -> str:
    """Say in one line what failed, and with which file."""
    if not isinstance(error, OSError):
        return str(error) or type(error).__name__
    words = _WORDS.get(error.errno or 0) or error.strerror or str(error) or type(error).__name__
    return words if error.filename is None else f"{words} ({error.filename})"


def close_to(path: str) -> str:
    """Return the pattern that matches ``path`` alone."""
    return glob.escape(path)


def open_place(stack: ExitStack, out: str | Path, stated: bool) -> Path:
    """Return the absolute path of a folder to write; its parents are made, and removed on failure if still empty.

    Raises
    ------
    ConfigError
        It is a file, a link, a mount point, or a place that holds the run itself.
    OSError
        Its parent cannot be made or read, or the name is too long.
    """
    named = f"--out {str(out)!r}" if stated else f"folder {str(out)!r}"
    if "\0" in str(out):
        raise ConfigError(f"{named}: holds a null character; give the name of a folder")
    folder = Path(os.path.abspath(out))
    folder = Path(os.path.realpath(folder.parent)) / folder.name
    _check(folder, named)
    _make_parents(stack, folder.parent, named)
    return folder


def _check(folder: Path, named: str) -> None:
    homes = [Path(home).expanduser() for home in ("~",) if os.environ.get("HOME")]
    for holder in (Path.cwd(), *homes):
        real = Path(os.path.realpath(holder))
        if folder == real or folder in real.parents:
            raise ConfigError(f"{named}: holds {holder}; give a folder of its own")
    try:
        os.lstat(folder)
    except (FileNotFoundError, NotADirectoryError):
        return
    if folder.is_symlink():
        raise ConfigError(f"{named}: is a link to {os.readlink(folder)}; give that folder itself")
    if not folder.is_dir():
        raise ConfigError(f"{named}: is a file; give a folder")
    if folder.is_mount():
        raise ConfigError(f"{named}: is a mount point, which cannot be renamed; give a folder in it")


def _make_parents(stack: ExitStack, parent: Path, named: str) -> None:
    missing = []
    for path in (parent, *parent.parents):
        if path.is_dir():
            break
        if os.path.lexists(path):
            raise ConfigError(f"{named}: {path} is a file, not a folder")
        missing.append(path)
    for path in reversed(missing):
        path.mkdir(exist_ok=True)
        stack.callback(_drop_if_empty, path)


def _drop_if_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def clear(folder: Path, force: bool, kind: str | None = None) -> None:
    """See that ``folder`` may be written: it is absent, empty, or (``force``) holds only what camnet wrote there.

    With ``kind`` the folder is gone on with: what an earlier run of that kind wrote is kept, or removed by ``force``.

    Raises
    ------
    ConfigError
        It may not; the message says why.
    """
    if not folder.is_dir() or not any(folder.iterdir()):
        return
    marker = read_marker(folder)
    if kind is None and not force:
        raise ConfigError(
            f"--out {str(folder)!r}: the folder is not empty; add --force to replace it or give another"
        )
    if marker is None:
        raise ConfigError(
            f"--out {str(folder)!r}: the folder is not empty and has no {MARKER}, so camnet did not write it; "
            "give another"
        )
    if kind is not None and marker.kind != kind:
        raise ConfigError(f"--out {str(folder)!r}: camnet {marker.kind} wrote this folder; give another")
    foreign = foreign_file(folder, marker.files) if force else None
    if foreign is not None:
        raise ConfigError(
            f"--out {str(folder)!r}: --force would remove {foreign!r}, which camnet did not write; "
            "move it or give another folder"
        )
    if kind is not None and force:
        for path in (p for p in folder.iterdir() if p.name != MARKER):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()

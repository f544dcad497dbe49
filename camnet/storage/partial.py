"""Folders that are whole or absent: made under a temporary name beside, then renamed; leftovers of the dead swept."""

from __future__ import annotations

import glob
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from camnet.errors import ConfigError
from camnet.storage.lock import folder_lock, locked_name
from camnet.storage.marker import MARKER, files_in, foreign_file, read_marker, write_marker
from camnet.storage.names import parse, short_name, temporary_name

__all__ = [
    "keep_failed",
    "make_partial",
    "put_in_place",
    "remove_partial",
    "replaced_folder",
    "scratch_folder",
    "sweep_beside",
    "sweep_inside",
]


def make_partial(folder: Path, kind: str) -> Path:
    """Make the temporary folder that is to become ``folder``; the marker in it proves that the disk takes data.

    Raises
    ------
    OSError
        It cannot be made.
    """
    partial = folder.with_name(temporary_name(folder.name))
    shutil.rmtree(partial, ignore_errors=True)  # a dead process had our number
    partial.mkdir()
    try:
        write_marker(partial, kind, ())
    except BaseException:
        remove_partial(partial)
        raise
    return partial


def remove_partial(partial: Path) -> None:
    """Remove a temporary folder."""
    shutil.rmtree(partial, ignore_errors=True)


def put_in_place(partial: Path, folder: Path) -> None:
    """Rename a finished folder to its name; a folder that camnet wrote there before is replaced.

    What was there is moved aside, and removed only when the new folder stands in its place.

    Raises
    ------
    ConfigError
        Something that camnet did not write has come to be in the folder.
    OSError
        It cannot be renamed.
    """
    if not folder.is_dir() or not any(folder.iterdir()):
        os.rename(partial, folder)
        return
    marker = read_marker(folder)
    if marker is None or foreign_file(folder, marker.files) is not None:
        raise ConfigError(f"{folder}: something that camnet did not write is there now")
    _exchange(partial, folder)


def _exchange(partial: Path, folder: Path) -> None:
    """Put ``partial`` in the place of ``folder``, which is moved aside first and removed after."""
    if not os.path.lexists(folder):
        os.rename(partial, folder)
        return
    aside = folder.with_name(temporary_name(folder.name, "replaced"))
    _remove(aside)
    os.rename(folder, aside)
    try:
        os.rename(partial, folder)
    except BaseException:
        os.rename(aside, folder)
        raise
    _remove(aside)


def _remove(path: Path) -> None:
    """Remove a folder, a file or a link (never what it leads to), or nothing."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def keep_failed(partial: Path, folder: Path) -> Path | None:
    """Keep what a failed run has written, under a name that nothing sweeps; None, and removed, if it has nothing."""
    if not any(path.is_file() and path.name != MARKER for path in partial.rglob("*")):
        remove_partial(partial)
        return None
    kept = folder.with_name(f"{short_name(folder.name)}.failed-{os.getpid()}")
    try:
        os.rename(partial, kept)
    except OSError:
        return partial
    return kept


@contextmanager
def replaced_folder(folder: Path, kind: str) -> Iterator[Path]:
    """Yield a temporary folder that takes the place of ``folder`` on success and vanishes on error.

    For folders inside one that the caller has locked and owns: what was there goes, whatever it holds.
    """
    partial = make_partial(folder, kind)
    try:
        yield partial
        write_marker(partial, kind, [glob.escape(name) for name in files_in(partial)])
        _exchange(partial, folder)
    except BaseException:
        remove_partial(partial)
        raise


@contextmanager
def scratch_folder(path: Path, kind: str) -> Iterator[Path]:
    """Yield a temporary folder beside ``path`` that is removed at the end; those of dead processes go first."""
    for other in path.parent.iterdir():
        left = parse(other.name)
        if left is not None and left.name == short_name(path.name) and left.is_stale():
            _clear(other, left.purpose, path)
    partial = make_partial(path, kind)
    try:
        yield partial
    finally:
        remove_partial(partial)


def sweep_beside(folder: Path) -> None:
    """Remove what dead processes left beside ``folder``, whose lock the caller holds.

    Of ``folder`` itself any leftover is stale, as only the holder of its lock may write it. What stands for another
    name is swept if its process ran on this host and is gone, and nobody holds that name's lock.
    """
    for path in sorted(folder.parent.iterdir()):
        lock = locked_name(path.name)
        if lock is not None and lock != short_name(folder.name):
            with suppress(ConfigError, OSError), folder_lock(folder.parent / lock):
                pass  # nobody's: it goes when it is let go
        left = parse(path.name)
        if left is None or path.is_symlink():
            continue
        if left.name == short_name(folder.name):
            _clear(path, left.purpose, folder)
        elif left.is_stale():
            target = folder.parent / left.name
            with suppress(ConfigError, OSError), folder_lock(target):
                _clear(path, left.purpose, target)


def sweep_inside(folder: Path) -> None:
    """Remove every temporary file and folder in ``folder`` and its folders; the caller holds its lock."""
    for root, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            left, path = parse(name), Path(root) / name
            if left is not None and not path.is_symlink():
                _clear(path, left.purpose, Path(root) / left.name)


def _clear(path: Path, purpose: str, target: Path) -> None:
    if path.is_file():
        path.unlink(missing_ok=True)
    elif purpose == "replaced" and not target.exists():
        with suppress(OSError):
            os.rename(path, target)  # killed between two renames: what was there comes back
    elif read_marker(path) is not None:
        shutil.rmtree(path, ignore_errors=True)
    else:  # killed before its marker was whole
        names = [entry.name for entry in path.iterdir()]
        if names in ([], [MARKER]):
            shutil.rmtree(path, ignore_errors=True)

"""Where camnet keeps what is costly to make again: compiled kernels, traffic.

| order | folder | kept for |
| --- | --- | --- |
| 1 | ``CAMNET_CACHE``, else ``XDG_CACHE_HOME/camnet``, else ``~/.cache/camnet`` | all later runs |
| 2 | a private folder in the system's temporary one | this process and its workers |
| 3 | none | |

Compiled kernels are pickles, which can run anything when they are read. So their folder, ``kernels`` in it, counts only
if it belongs to this user or to root and nobody else may write in it, and the temporary one has a name that nobody can
foresee. One that belongs to root and cannot be written is read all the same: an administrator may fill it with
``camnet warm-up``.
"""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path

from camnet.alive import is_alive
from camnet.errors import ConfigError

__all__ = ["KERNELS", "CacheFolders", "adopt", "cache_folder", "cache_folders", "user_cache"]

_LOG = logging.getLogger(__name__)
#: folder of the compiled kernels inside a cache folder
KERNELS = "kernels"
_PREFIX = "camnet-cache-"


@dataclass(frozen=True, slots=True)
class CacheFolders:
    """Folders of this process.

    Attributes
    ----------
    read : folders to look in
    write : the one to write in; None where there is none
    lasting : whether later runs find what is written
    """

    read: tuple[Path, ...]
    write: Path | None
    lasting: bool


_chosen: CacheFolders | None = None


def user_cache() -> Path | None:
    """Return the user's folder, whether or not it exists; None for a user without a home."""
    if named := os.environ.get("CAMNET_CACHE"):
        return Path(named).absolute()
    if base := os.environ.get("XDG_CACHE_HOME"):
        return Path(base).absolute() / "camnet"
    try:
        return Path.home() / ".cache" / "camnet"
    except RuntimeError:  # the user has no entry in the list of users
        return None


def cache_folders() -> CacheFolders:
    """Return the folders of this process; they are chosen once, with a warning if nothing is kept."""
    global _chosen
    if _chosen is None:
        _chosen = _choose()
    return _chosen


def cache_folder() -> Path:
    """Return the folder to write in.

    Raises
    ------
    ConfigError
        There is none.
    """
    folder = cache_folders().write
    if folder is None:
        raise ConfigError("no folder for files to keep can be written; set CAMNET_CACHE to one that can")
    return folder


def adopt(folders: CacheFolders) -> None:
    """Use the folders of the process that started this one."""
    global _chosen
    _chosen = folders


def _choose() -> CacheFolders:
    folder = user_cache()
    fault = "this user has no home" if folder is None else _prepare(folder)
    if folder is not None and fault is None:
        return CacheFolders((folder,), folder, lasting=True)
    read = () if folder is None or not _is_trusted(folder / KERNELS) else (folder,)
    temporary = _temporary()
    kept = "are not kept" if temporary is None else "are kept for this run only"
    _LOG.warning("cache: %s; compiled kernels %s (CAMNET_CACHE names another folder)", fault, kept)
    return CacheFolders(read if temporary is None else (*read, temporary), temporary, lasting=False)


def _prepare(folder: Path) -> str | None:
    """Make a cache folder; return what is wrong with it, or None."""
    kernels = folder / KERNELS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        kernels.mkdir(mode=0o755, exist_ok=True)
        if not _is_trusted(kernels):
            return f"{kernels} belongs to another user, or others may write in it"
        with tempfile.TemporaryFile(dir=kernels):
            return None
    except OSError as error:
        return f"{folder} cannot be written ({error.strerror or error})"


def _is_trusted(folder: Path) -> bool:
    """Whether nobody but this user and root can have put anything there."""
    if not hasattr(os, "geteuid"):  # not a POSIX system: a user's folders are the user's
        return folder.is_dir()
    try:
        of = folder.stat()
    except OSError:
        return False
    return stat.S_ISDIR(of.st_mode) and of.st_uid in (os.geteuid(), 0) and not of.st_mode & 0o022


def _temporary() -> Path | None:
    """Make a private folder that goes with this process; remove those of processes that were killed."""
    try:
        base = Path(tempfile.gettempdir())
        for old in base.glob(f"{_PREFIX}*"):
            process = old.name.removeprefix(_PREFIX).split("-")[0]
            if process.isdecimal() and not is_alive(int(process)) and _is_trusted(old):
                shutil.rmtree(old, ignore_errors=True)
        made = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-", dir=base))
        (made / KERNELS).mkdir(mode=0o700)
    except OSError:  # no folder for temporary files, or a full one
        return None
    atexit.register(_remove, made, os.getpid())
    return made


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # not in a copy of the process that ``fork`` made
        shutil.rmtree(folder, ignore_errors=True)

"""The marker of a folder that camnet wrote: ``.camnet.json``, with what wrote it and which files are its own.

Only a folder with a marker is ever replaced, and only if it holds nothing beyond the files that the marker names.
"""

from __future__ import annotations

import fnmatch
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from camnet import __version__
from camnet.storage.names import parse

__all__ = ["MARKER", "Marker", "files_in", "foreign_file", "read_marker", "write_marker"]

MARKER = ".camnet.json"
_FORMAT, _VERSION = "camnet folder", 1
#: a marker is a list of names; a file that is larger is none
_LIMIT_BYTES = 10_000_000


@dataclass(frozen=True, slots=True)
class Marker:
    """What a marker says.

    Attributes
    ----------
    kind : what wrote the folder, such as ``simulate``
    files : the folder's own files, paths relative to it, as patterns of `fnmatch`
    """

    kind: str
    files: tuple[str, ...]


def write_marker(folder: Path, kind: str, files: Sequence[str]) -> None:
    """Write the marker of ``folder``; equal content gives equal bytes."""
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "kind": kind,
        "camnet": __version__,
        "files": sorted(files),
    }
    (folder / MARKER).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_marker(folder: Path) -> Marker | None:
    """Return the marker of ``folder``; None if there is none, or something else under its name."""
    path = folder / MARKER
    try:
        if not path.is_file() or path.stat().st_size > _LIMIT_BYTES:
            return None
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or (content.get("format"), content.get("version")) != (
        _FORMAT,
        _VERSION,
    ):
        return None
    kind, files = content.get("kind"), content.get("files")
    if not isinstance(kind, str) or not isinstance(files, list) or not all(isinstance(f, str) for f in files):
        return None
    return Marker(kind, tuple(files))


def files_in(folder: Path) -> Iterator[str]:
    """Yield every file and link below ``folder``, relative and with slashes, without the marker."""
    for root, folders, files in os.walk(folder):
        here = Path(root).relative_to(folder)
        links = [name for name in folders if (Path(root) / name).is_symlink()]
        for name in [*files, *links]:
            path = (here / name).as_posix()
            if path != MARKER:
                yield path


def foreign_file(folder: Path, own: Sequence[str]) -> str | None:
    """Return a file in ``folder`` that ``own`` does not name, leftovers of killed runs aside; None without any."""
    exact = set(own)
    patterns = [name for name in own if any(c in name for c in "*?[")]
    for path in files_in(folder):
        ours = path in exact or any(fnmatch.fnmatchcase(path, pattern) for pattern in patterns)
        if not ours and all(parse(part) is None for part in path.split("/")):
            return path
    return None

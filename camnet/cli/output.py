"""Output folders that are whole or absent, and the one JSON object on standard output."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from camnet.errors import ConfigError

__all__ = ["choose_folder", "print_json", "whole_folder", "write_json"]


def choose_folder(out: str | None, default_name: str, force: bool) -> Path:
    """Return the folder to write: ``out``, or ``runs/<default_name>`` with a number if that is taken.

    Raises
    ------
    ConfigError
        If ``out`` holds something already and ``force`` is not given, or is a file.
    """
    if out is None:
        base = Path("runs") / default_name
        taken = (base.with_name(f"{base.name}-{n}") for n in range(2, 10_000))
        return base if not base.exists() else next(p for p in taken if not p.exists())
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"--out {out!r}: is a file; give a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise ConfigError(
            f"--out {out!r}: the folder is not empty; add --force to replace it or give another"
        )
    return folder


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes ``folder`` on success and vanishes on error."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = folder.with_name(f".{folder.name}.partial-{os.getpid()}")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        yield temporary
        if folder.exists():
            shutil.rmtree(folder)
        temporary.replace(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        _drop_if_empty(folder.parent)


def _drop_if_empty(folder: Path) -> None:
    if folder.name == "runs" and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def write_json(path: Path, content: object) -> None:
    """Write indented JSON (a temporary name first, then renamed)."""
    temporary = path.with_suffix(".partial")
    temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    temporary.replace(path)


def print_json(content: object) -> None:
    """Print one JSON object on standard output."""
    json.dump(content, sys.stdout, allow_nan=False)
    sys.stdout.write("\n")
    sys.stdout.flush()

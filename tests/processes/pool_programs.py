"""Functions for worker processes of the tests."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from camnet.cache_folder import cache_folders
from camnet.errors import ConfigError


def square(x: int) -> int:
    return x * x


def who(task: int) -> tuple[int, int, str]:
    time.sleep(0.2)
    return task, os.getpid(), str(cache_folders().write)


def refuse(x: int) -> int:
    if x == 1:
        raise ConfigError("x = 1: give another")
    time.sleep(60.0)
    return x


def vanish(x: int) -> int:
    if x == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(60.0)
    return x


def linger(folder: Path) -> None:
    """Leave a file while at work; it goes when the work is unwound."""
    mark = folder / str(os.getpid())
    mark.touch()
    try:
        time.sleep(60.0)
    finally:
        mark.unlink()


def deaf(folder: Path) -> None:
    """Work on whatever comes."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    (folder / str(os.getpid())).touch()
    time.sleep(60.0)

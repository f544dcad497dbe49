"""The PyBullet back end; the only place that imports the engine. Start reading at `world`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def _silence() -> Iterator[None]:
    """Send what C code writes to standard error to nowhere: the engine greets on import."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _silence():
    import pybullet  # noqa: F401 - first import, so that the greeting is lost here

from camnet.world.pybullet.engine import open_clients  # noqa: E402 - after the engine
from camnet.world.pybullet.world import PyBulletWorld  # noqa: E402 - after the engine

__all__ = ["PyBulletWorld", "open_clients"]

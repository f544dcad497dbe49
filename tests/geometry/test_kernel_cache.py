"""Several processes add to one index of compiled kernels."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

import camnet.geometry  # noqa: F401 - it makes processes take turns

KEYS = 60


def _file(folder: Path) -> IndexDataCacheFile:
    return IndexDataCacheFile(str(folder), "kernel", ("source", 1))


def _save(folder: Path, who: int) -> None:
    for k in range(KEYS):
        _file(folder).save((who, k), f"code of {who}, {k}")


def test_two_processes_keep_their_code_apart(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    fork = multiprocessing.get_context("fork")
    others = [fork.Process(target=_save, args=(tmp_path, who)) for who in (1, 2, 3)]
    for process in others:
        process.start()
    for process in others:
        process.join()
    assert [process.exitcode for process in others] == [0, 0, 0]
    for who in (1, 2, 3):
        for k in range(KEYS):
            assert _file(tmp_path).load((who, k)) == f"code of {who}, {k}"


_KERNEL = """
from numba import njit
from camnet.geometry.kernel_cache import announce

@njit(cache=True)
def twice(x):
    return 2 * x

announce(twice, "a test")
twice(1)
announce(twice, "a test")
"""


def test_compilation_is_announced_where_nothing_is_compiled_yet(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(_KERNEL)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    said = [
        subprocess.run(
            [sys.executable, str(tmp_path / "kernel.py")],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        ).stderr
        for _ in range(2)
    ]
    assert said[0] == "compiling a test; this takes a minute or two, once on this machine\n"
    assert said[1] == ""

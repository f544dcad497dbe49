"""Compiled kernels are kept where they may be, shared by processes, and never a reason for a run to fail."""

from __future__ import annotations

import ast
import errno
import logging
import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from camnet import cache_folder
from camnet.compiled import store
from camnet.storage.names import temporary_name

KEYS = 60
posix = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and modes of files are POSIX")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAMNET_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache_folder, "_chosen", None)
    monkeypatch.setattr(store, "_saving", True)


def _save(who: int) -> None:
    for k in range(KEYS):
        store.save("kernel", "source", f"{who}-{k}", f"code of {who}, {k}")
        store.save("kernel", "source", f"all-{k}", f"code of all, {k}")
        assert store.load("kernel", "source", f"all-{k}") == f"code of all, {k}"


def test_several_processes_save_at_once() -> None:
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork on this system")
    fork = multiprocessing.get_context("fork")
    others = [fork.Process(target=_save, args=(who,)) for who in (1, 2, 3)]
    for process in others:
        process.start()
    for process in others:
        process.join()
    assert [process.exitcode for process in others] == [0, 0, 0]
    for k in range(KEYS):
        for who in (1, 2, 3):
            assert store.load("kernel", "source", f"{who}-{k}") == f"code of {who}, {k}"
        assert store.load("kernel", "source", f"all-{k}") == f"code of all, {k}"


def test_a_full_disk_gives_one_warning(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def full(path: Path, content: bytes) -> int:
        with path.open("wb") as file:
            file.write(content[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    said: list[str] = []  # not caplog: what ran before may have set up loggers of its own
    monkeypatch.setattr(store._LOG, "warning", lambda words, *values: said.append(words % values))
    monkeypatch.setattr(Path, "write_bytes", full)
    store.save("kernel", "source", "a", 1)
    store.save("kernel", "source", "b", 2)
    assert said == [
        f"cache: {tmp_path / 'cache'} cannot be written (No space left on device); kernels are compiled again"
    ]
    assert list((tmp_path / "cache" / "kernels").iterdir()) == []
    assert store.load("kernel", "source", "a") is None


def test_half_written_files_of_dead_processes_go(tmp_path: Path) -> None:
    store.save("kernel", "source", "a", 1)
    folder = tmp_path / "cache" / "kernels"
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    ours = folder / temporary_name("a.kernel")
    theirs = folder / ours.name.replace(f"-{os.getpid()}.", f"-{dead.pid}.")
    assert ours != theirs
    ours.write_bytes(b"x")
    theirs.write_bytes(b"x")
    store.sweep()
    assert ours.exists()
    assert not theirs.exists()
    assert store.load("kernel", "source", "a") == 1


def test_what_is_not_used_goes(tmp_path: Path) -> None:
    for key in ("old", "used"):
        store.save("kernel", "source", key, 1)
    for path in (tmp_path / "cache" / "kernels").iterdir():
        os.utime(path, (time.time() - 100 * 86_400,) * 2)
    assert store.load("kernel", "source", "used") == 1  # marks it as used
    assert store.prune(days=60) == 1
    assert store.load("kernel", "source", "old") is None
    assert store.load("kernel", "source", "used") == 1


# --- which folder ----------------------------------------------------------------------------------------------------


def test_the_users_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert cache_folder.user_cache() == tmp_path / "cache"
    monkeypatch.delenv("CAMNET_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder.user_cache() == tmp_path / "xdg" / "camnet"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder.user_cache() == tmp_path / ".cache" / "camnet"


def test_a_file_in_the_way_leads_to_a_private_folder_and_one_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cache").write_text("a file")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with caplog.at_level(logging.WARNING):
        found = cache_folder.cache_folders()
        assert cache_folder.cache_folders() is found
    assert found.write is not None
    assert found.write.parent == tmp_path
    assert not found.lasting
    assert len(caplog.records) == 1
    assert "are kept for this run only" in caplog.text
    store.save("kernel", "source", "a", 1)
    assert store.load("kernel", "source", "a") == 1
    if os.name == "posix":
        assert found.write.stat().st_mode & 0o777 == 0o700


def test_without_any_folder_nothing_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cache").write_text("a file")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "cache"))
    with caplog.at_level(logging.WARNING):
        assert cache_folder.cache_folders() == cache_folder.CacheFolders((), None, lasting=False)
    assert len(caplog.records) == 1
    assert "are not kept" in caplog.text
    store.save("kernel", "source", "a", 1)
    assert store.load("kernel", "source", "a") is None
    assert not store.is_known("kernel", "source")
    store.sweep()


@posix
def test_a_folder_where_others_may_write_is_neither_read_nor_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    store.save("kernel", "source", "planted", 1)
    (tmp_path / "cache" / "kernels").chmod(0o777)
    monkeypatch.setattr(cache_folder, "_chosen", None)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert store.load("kernel", "source", "planted") is None
    assert tmp_path / "cache" not in cache_folder.cache_folders().read
    assert "others may write in it" in caplog.text


@posix
def test_a_folder_of_another_user_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store.save("kernel", "source", "planted", 1)
    us = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    monkeypatch.setattr(cache_folder, "_chosen", None)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    if us == 0:  # what root left may be read
        assert cache_folder._is_trusted(tmp_path / "cache" / "kernels")
        os.chown(tmp_path / "cache" / "kernels", 12345, 12345)
    assert store.load("kernel", "source", "planted") is None


def test_private_folders_of_dead_processes_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    left = tmp_path / f"camnet-cache-{dead.pid}-abc"
    left.mkdir(mode=0o700)
    made = cache_folder._temporary()
    assert made is not None
    assert not left.exists()
    cache_folder._remove(made, os.getpid() + 1)
    assert made.exists()  # a forked process leaves it alone
    cache_folder._remove(made, os.getpid())
    assert not made.exists()


# --- whole programs --------------------------------------------------------------------------------------------------

_KERNEL = """
from camnet.compiled import announce, cached_njit

@cached_njit
def twice(x):
    return 2 * x

announce(twice, "a test")
twice(1)
announce(twice, "a test")
print(sum(twice.stats.cache_hits.values()))
"""


def _run(tmp_path: Path, **environment: str) -> tuple[str, str]:
    """What a program with a kernel prints on standard output and error."""
    (tmp_path / "kernel.py").write_text(_KERNEL)
    done = subprocess.run(
        [sys.executable, str(tmp_path / "kernel.py")],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip(), done.stderr


def test_compilation_is_announced_where_nothing_is_compiled_yet(tmp_path: Path) -> None:
    warning = "compiling a test; this takes a minute or two, once on this machine\n"
    assert _run(tmp_path) == ("0", warning)
    assert _run(tmp_path) == ("1", "")


def test_another_processor_has_code_of_its_own(tmp_path: Path) -> None:
    other = "x86-64-v2" if os.environ.get("NUMBA_CPU_NAME") == "generic" else "generic"
    _run(tmp_path)
    assert _run(tmp_path, NUMBA_CPU_NAME=other)[0] == "0"
    assert _run(tmp_path, NUMBA_CPU_NAME=other)[0] == "1"
    assert _run(tmp_path)[0] == "1"


def test_no_module_uses_numbas_own_cache(project_root: Path) -> None:
    """Every kernel is decorated by `camnet.compiled`, the only module that may import ``njit``."""
    files = [p for folder in ("camnet", "agents", "worlds") for p in (project_root / folder).rglob("*.py")]
    assert len(files) > 100
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.keyword):
                assert node.arg != "cache", f"{path}, line {node.lineno}"
            if isinstance(node, ast.Constant):
                assert node.value != "cache", f"{path}, line {node.lineno}"
            if isinstance(node, ast.ImportFrom) and node.module == "numba":
                names = {alias.name for alias in node.names}
                assert not names & {"njit", "jit", "vectorize", "guvectorize", "cfunc"}, path


def test_importing_compiles_nothing_and_chooses_no_folder() -> None:
    code = """
import numba.core.event as event
with event.install_recorder("numba:compile") as seen:
    import camnet.agents, camnet.batch.simulation, camnet.cli.main, camnet.env.handoff_v0, camnet.evaluation.evaluate
from camnet import cache_folder
assert not seen.buffer, seen.buffer
assert cache_folder._chosen is None
"""
    subprocess.run([sys.executable, "-c", code], check=True)

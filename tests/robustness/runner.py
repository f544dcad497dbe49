"""Runs commands, each in a process of its own, in a folder of its own.

A case runs in a fork of this process, which has everything imported and compiled already, or as a process of its own
from the start. Memory and time are limited by the operating system.
"""

from __future__ import annotations

import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from robustness.case import Case, Command, Nature
from robustness.outcome import Outcome
from robustness.stage import Stage

__all__ = ["CPU_S", "MEMORY_BYTES", "run_all", "run_words"]

#: limits of one case: processor time, time on the clock (a busy machine), address space
CPU_S, WALL_S, MEMORY_BYTES = 30, 150.0, 4 * 1024**3
_PAUSE_S = 0.01


@dataclass(slots=True)
class _Running:
    """A process at work, its folder and what lay there before."""

    case: Case
    folder: Path
    process: int
    started_s: float
    before: dict[str, str]


def run_all(
    stage: Stage, cases: Iterable[tuple[Case, bool]], jobs: int
) -> Iterator[tuple[Case, bool, Outcome]]:
    """Run cases, ``jobs`` at a time, and yield them as they end; the flag asks for a process from the start."""
    waiting = iter(cases)
    running: list[tuple[_Running, bool]] = []
    with tempfile.TemporaryDirectory(prefix="robustness-") as name:
        root, number, more = Path(name), 0, True
        while running or more:
            while more and len(running) < jobs:
                following = next(waiting, None)
                if following is None:
                    more = False
                    break
                case, real = following
                real = real or "torch" in sys.modules  # its threads do not outlive a fork
                running.append((_start(stage, case, root / str(number), real), real))
                number += 1
            for entry in list(running):
                outcome = _poll(entry[0])
                if outcome is not None:
                    running.remove(entry)
                    yield entry[0].case, entry[1], outcome
            time.sleep(_PAUSE_S)


def run_words(stage: Stage, command: Command) -> Outcome:
    """Run one command on the unchanged stage."""
    case = Case("base", command.name, Nature.HARMLESS, command)
    ((_, _, outcome),) = run_all(stage, [(case, False)], 1)
    return outcome


def _start(stage: Stage, case: Case, folder: Path, real: bool) -> _Running:
    work, logs = folder / "work", folder / "logs"
    work.mkdir(parents=True)
    logs.mkdir()
    stage.write(work, case.command, case.files)
    before = listing(work)
    words = [*case.command.argv, *case.extra]
    started = time.monotonic()
    process = _real(words, work, logs) if real else _forked(words, work, logs)
    return _Running(case, folder, process, started, before)


def _forked(words: Sequence[str], work: Path, logs: Path) -> int:
    process = os.fork()
    if process:
        return process
    status = 70
    try:
        _settle(work, logs)
        from camnet.cli.main import main

        status = main(words)
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
        status = 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _settle(work: Path, logs: Path) -> None:
    """Give the process its folder, its streams and its limits."""
    os.setsid()
    os.chdir(work)
    for number, name in ((1, "stdout"), (2, "stderr")):
        opened = os.open(logs / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(opened, number)
        os.close(opened)
    sys.stdout = open(1, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _limit()


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _real(words: Sequence[str], work: Path, logs: Path) -> int:
    with (logs / "stdout").open("wb") as stdout, (logs / "stderr").open("wb") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-m", "camnet", *words],
            cwd=work,
            stdout=stdout,
            stderr=stderr,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_limit,
        )
    process.returncode = 0  # waited for by its number, below
    return process.pid


def _poll(running: _Running) -> Outcome | None:
    pid, status, usage = os.wait4(running.process, os.WNOHANG)
    wall = time.monotonic() - running.started_s
    if pid == 0:
        if wall < WALL_S:
            return None
        os.killpg(running.process, signal.SIGKILL)
        _, status, usage = os.wait4(running.process, 0)
    work, logs = running.folder / "work", running.folder / "logs"
    name = running.case.command.result
    result = (
        None if name is None or not (work / name).is_file() else (work / name).read_text("utf-8", "replace")
    )
    outcome = Outcome(
        os.waitstatus_to_exitcode(status),
        _text(logs / "stdout"),
        _text(logs / "stderr"),
        wall,
        usage.ru_utime + usage.ru_stime,
        usage.ru_maxrss * 1024,
        running.before,
        listing(work),
        result,
    )
    shutil.rmtree(running.folder, ignore_errors=True)
    return outcome


def _text(path: Path) -> str:
    return path.read_text("utf-8", "backslashreplace") if path.is_file() else ""


def listing(folder: Path) -> dict[str, str]:
    """Return a digest of every file under a folder, by name; folders have an empty one."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in sorted(folder.rglob("*"))
    }

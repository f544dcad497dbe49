"""The one pool of worker processes, for commands that do many independent things.

Workers are fresh processes (``spawn``) that

- end with the process that started them, even if it is killed (`camnet.processes.tied`);
- leave Ctrl-C to it, and stop at SIGTERM: what they do unwinds, so that half-written folders go;
- take nothing more once anything has failed: the first error stops all of them within two seconds;
- use the caches of the process that started them (`camnet.cache_folder`).

A worker that is killed alone, for want of memory say, is an error that says so.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from types import FrameType
from typing import Any, TypeVar

from camnet.cache_folder import CacheFolders, adopt, cache_folders
from camnet.errors import WorkerError
from camnet.processes.crew import Crew
from camnet.processes.tied import die_with_parent

__all__ = ["Workers"]

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
#: from SIGTERM until a worker that does not end is killed, s
_PATIENCE_S = 1.0


class Workers(Crew):
    """Processes for the time of a ``with`` block; leaving it by an error stops them.

    >>> with Workers(2) as workers:
    ...     for k, result in workers.finished(work, tasks):
    ...         keep(tasks[k], result)

    Parameters
    ----------
    jobs : processes at most; with one, or a single task, the work is done in this process
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool: ProcessPoolExecutor | None = None
        self._processes: list[Any] = []

    def finished(
        self, function: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Iterator[tuple[int, _Result]]:
        """Do the tasks; with one job, in this process (`Crew.finished`)."""
        if self._jobs == 1 or len(tasks) <= 1:
            for k, task in enumerate(tasks):
                yield k, function(task)
            return
        indices = self._submit(function, tasks)
        done = 0
        try:
            for future in as_completed(indices):
                yield indices[future], future.result()
                done += 1
            self._end()
        except BrokenProcessPool:
            raise WorkerError(self._epitaph(done, len(tasks))) from None
        finally:
            if done < len(tasks):
                self._stop()

    def _submit(
        self, function: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> dict[Future[_Result], int]:
        self._pool = ProcessPoolExecutor(
            min(self._jobs, len(tasks)),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(os.getpid(), cache_folders()),
        )
        with _interrupts_held():
            futures = {self._pool.submit(_call, function, task): k for k, task in enumerate(tasks)}
        self._processes = list(self._pool._processes.values())
        return futures

    def _end(self) -> None:
        """Let the workers go: all is done."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True)

    def _epitaph(self, done: int, total: int) -> str:
        codes = self._exit_codes()
        signals = [signal.Signals(-code).name for code in codes if code < 0 and code != -signal.SIGTERM]
        how = signals[0] if signals else f"status {codes[0]}" if codes else "a signal"
        memory = (
            "; the system kills processes when memory runs out: try fewer --jobs" if "KILL" in how else ""
        )
        return f"a worker process was ended by {how} with {done} of {total} tasks done{memory}"

    def _exit_codes(self) -> list[int]:
        """Return how those workers ended that have; the pool sends SIGTERM to the others once one is gone."""
        end = time.monotonic() + _PATIENCE_S
        while True:
            codes = [p.exitcode for p in self._processes if p.exitcode is not None]
            if len(codes) == len(self._processes) or time.monotonic() > end:
                return codes
            time.sleep(0.02)

    def _stop(self) -> None:
        """End all workers, whatever they do; nothing that waits is begun."""
        if self._pool is None:
            return
        pool, self._pool = self._pool, None
        manager: Any = pool._executor_manager_thread
        pool.shutdown(wait=False, cancel_futures=True)
        left = [p for p in self._processes if p.is_alive()]
        for process in left:
            process.terminate()
        for process in _wait_for(left):
            process.kill()
        _wait_for(left)
        if manager is not None:  # it frees semaphores; a program that ends meanwhile has Python warn of them
            manager.join(_PATIENCE_S)


def _wait_for(processes: list[Any]) -> list[Any]:
    """Wait until processes have ended, at most `_PATIENCE_S`; return those that have not."""
    end, left = time.monotonic() + _PATIENCE_S, list(processes)
    while left and time.monotonic() < end:
        gone = connection.wait([p.sentinel for p in left], max(0.0, end - time.monotonic()))
        left = [p for p in left if p.sentinel not in gone]
    return left


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold SIGINT back while processes are started: they inherit that, and a Ctrl-C is for this process alone."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # starting it would let the signal in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# --- in the worker ---------------------------------------------------------------------------------------------------


class _Stopped(BaseException):
    """SIGTERM has come; what is under way unwinds."""


_stopping = _working = False


def _begin(parent: int, folders: CacheFolders) -> None:
    die_with_parent(parent)
    adopt(folders)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _on_sigterm)


def _on_sigterm(number: int, frame: FrameType | None) -> None:
    global _stopping
    if not _working:
        os._exit(1)
    if not _stopping:  # what unwinds is not interrupted again
        _stopping = True
        raise _Stopped


def _call(function: Callable[[_Task], _Result], task: _Task) -> _Result:
    global _working
    _working = True
    try:
        result = function(task)
    except BaseException:
        if not _stopping:
            _working = False
            raise
    else:
        _working = False
        if not _stopping:
            return result
    os._exit(1)  # without a word to the pool: it would hand over the next task

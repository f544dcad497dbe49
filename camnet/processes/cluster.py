"""Workers of a Ray cluster, with the manners of the pool (`camnet.processes.pool`).

A task that is lost with its worker or its machine is done again, at most `RETRIES` times: tasks keep nothing outside
what they return. Workers must have the same version of camnet; each looks before it does anything. A task has one
processor, and Ray gives libraries of linear algebra as many threads.

Source: Moritz et al. 2018, Ray: a distributed framework for emerging AI applications (OSDI).
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from camnet import __version__
from camnet.cache_folder import CacheFolders, adopt, cache_folders
from camnet.errors import ConfigError, WorkerError
from camnet.processes.crew import Crew

__all__ = ["RETRIES", "RayWorkers"]

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
#: how often a task is begun again whose worker was lost
RETRIES = 3
#: at most so many tasks a worker are handed over at once; the cluster holds their results until they are fetched
_AHEAD = 2
#: how long a cluster's address may take to answer, s
_REACH_S = 5.0


class RayWorkers(Crew):
    """Workers of a cluster for the time of a ``with`` block; leaving it by an error stops what they do.

    Parameters
    ----------
    jobs : workers at most; of a cluster of this machine, also how many it has
    address : of a cluster that runs; None: one is started on this machine

    Raises
    ------
    ConfigError
        Ray is not installed.
    """

    def __init__(self, jobs: int, address: str | None = None) -> None:
        self._ray = _ray()
        self._jobs = jobs
        self._address = address
        self._folder: str | None = None
        self._connected = False
        self._pending: dict[Any, int] = {}

    def finished(
        self, function: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Iterator[tuple[int, _Result]]:
        """Do the tasks (`Crew.finished`).

        Raises
        ------
        WorkerError
            The cluster cannot be reached, has another version of camnet, or lost a task too often.
        """
        if not tasks:
            return
        self._connect()
        remote = self._ray.remote(num_cpus=1, max_retries=RETRIES)(_call)
        shared = self._ray.put((function, __version__, socket.gethostname(), cache_folders()))
        waiting, done = iter(enumerate(tasks)), 0
        try:
            while True:
                while len(self._pending) < _AHEAD * self._jobs and (following := next(waiting, None)):
                    self._pending[remote.remote(shared, following[1])] = following[0]
                if not self._pending:
                    return
                ready, _ = self._ray.wait(list(self._pending), num_returns=1)
                for reference in ready:
                    result = self._result(reference, done, len(tasks))
                    yield self._pending.pop(reference), result
                    done += 1
        finally:
            self._cancel()

    def _connect(self) -> None:
        if self._connected:
            return
        # no report of use to anybody; the dashboard, logs of workers and accelerators have no part in this
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        options: dict[str, Any] = {"log_to_driver": False}
        if self._address is None:
            # a folder of its own (short: it holds sockets), so that nothing is left behind
            self._folder = tempfile.mkdtemp(prefix="cn-ray-")
            options |= {"num_cpus": self._jobs, "include_dashboard": False, "_temp_dir": self._folder}
        try:
            _look_for(self._address)
            # Ray sets a handler for SIGTERM, which would end the program with another status
            with _handlers_kept():
                self._ray.init(address=self._address or "local", logging_level="ERROR", **options)
        except Exception as error:
            self._stop()
            where = "on this machine" if self._address is None else f"at {self._address!r}"
            raise WorkerError(f"--on ray: no Ray cluster {where}: {_first_line(error)}") from error
        self._connected = True

    def _result(self, reference: Any, done: int, total: int) -> Any:  # noqa: ANN401 - Ray's references and results
        from ray import exceptions

        try:
            return self._ray.get(reference)
        except exceptions.RayTaskError as error:
            cause = getattr(error, "cause", None)
            raise (cause if isinstance(cause, Exception) else error) from None
        except exceptions.RayError as error:
            raise WorkerError(
                f"a task was lost on the cluster with {done} of {total} done, and begun again {RETRIES} times: "
                f"{_first_line(error)}"
            ) from None

    def _cancel(self) -> None:
        """Begin nothing more and stop what runs."""
        pending, self._pending = list(self._pending), {}
        for reference in pending:
            self._ray.cancel(reference, force=True)

    def _stop(self) -> None:
        if self._connected:
            self._cancel()
        if self._connected or self._folder is not None:
            self._ray.shutdown()
        self._connected = False
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None


def _ray() -> Any:  # noqa: ANN401 - an extra, which may be missing
    try:
        import ray
    except ImportError as error:
        raise ConfigError("--on ray: Ray is not installed; pip install 'camnet[ray]'") from error
    return ray


def _look_for(address: str | None) -> None:
    """Raise OSError where nobody listens at ``host:port``; Ray itself would wait for minutes."""
    host, _, port = (address or "").rpartition(":")
    if host and "/" not in host and port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), timeout=_REACH_S).close()


@contextmanager
def _handlers_kept() -> Iterator[None]:
    """Leave SIGTERM and SIGINT with the handlers that they had."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _first_line(error: BaseException) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0]


# --- in the worker ---------------------------------------------------------------------------------------------------


def _call(shared: tuple[Callable[[_Task], _Result], str, str, CacheFolders], task: _Task) -> _Result:
    function, version, host, folders = shared
    if version != __version__:
        raise WorkerError(
            f"a worker on {socket.gethostname()} has camnet {__version__}, this machine {version}; install the same "
            "version on all machines of the cluster"
        )
    if socket.gethostname() == host:
        adopt(folders)
    return function(task)

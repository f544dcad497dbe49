"""Processes that end when the one that started them ends, even if that one is killed.

Linux sends a signal by itself (``prctl(PR_SET_PDEATHSIG)``). Elsewhere, and in case that fails, a thread waits for the
parent's end of a pipe to close, which the system does for a process that is killed, too.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading

__all__ = ["die_with_parent", "set_death_signal"]

_PR_SET_PDEATHSIG = 1


def set_death_signal() -> None:
    """Ask Linux for SIGKILL when the thread that started this process ends; nothing elsewhere.

    It may be called between ``fork`` and ``exec``.
    """
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def die_with_parent(parent: int) -> None:
    """Tie a process that `multiprocessing` started to its parent; called once in the new process.

    Parameters
    ----------
    parent : number of the process that started this one
    """
    set_death_signal()
    started_by = multiprocessing.parent_process()
    if os.name == "posix" and os.getppid() != parent:  # it ended before the signal was asked for
        os._exit(1)
    if started_by is not None:
        threading.Thread(target=_wait, args=(started_by,), name="parent watch", daemon=True).start()


def _wait(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)

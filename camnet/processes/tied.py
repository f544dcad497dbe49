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
from collections.abc import Sequence

__all__ = ["die_with_parent", "set_death_signal", "tied_command"]

_PR_SET_PDEATHSIG = 1
#: asks for the signal, looks whether the parent is still there, and becomes the program. A process of its own: what
#: runs between ``fork`` and ``exec`` in a program with threads may wait for a lock that nobody will release
_BECOME = f"""
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl({_PR_SET_PDEATHSIG}, signal.SIGKILL)
if os.getppid() != int(sys.argv[1]):
    os._exit(1)
os.execv(sys.argv[2], sys.argv[2:])
"""


def set_death_signal() -> None:
    """Ask Linux for SIGKILL when the thread that started this process ends; nothing elsewhere.

    It may be called between ``fork`` and ``exec``.
    """
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def tied_command(command: Sequence[str]) -> list[str]:
    """Return a command that runs ``command`` and is killed when the thread that starts it ends; for `subprocess`.

    Elsewhere than on Linux it is ``command`` as it is.

    Parameters
    ----------
    command : path of a program, and its arguments
    """
    if not sys.platform.startswith("linux") or not sys.executable:
        return list(command)
    return [sys.executable, "-I", "-S", "-c", _BECOME, str(os.getpid()), *command]


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

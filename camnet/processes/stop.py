"""SIGTERM and SIGINT in the main program: everything stops within two seconds.

SIGTERM (and SIGHUP, of a terminal that is closed) raises `TerminatedError` in the main thread, so that folders are
cleaned
and workers stopped on the way out; a second one ends the program at once. SIGINT stays ``KeyboardInterrupt``. Python
runs such handlers between instructions of its own: inside a long compilation a thread waits `PATIENCE_S` for them and
then ends the process. What that leaves half-written, the next run sweeps.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["PATIENCE_S", "TerminatedError", "stop_on_signals"]

#: from the signal until a process that does not react is ended, s
PATIENCE_S = 1.2
_NAMES = ("SIGTERM", "SIGHUP")


class TerminatedError(BaseException):
    """The program was asked to end by a signal; not an `Exception`, so that nothing takes it for a fault."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number

    def __str__(self) -> str:
        return f"stopped by {signal.Signals(self.number).name}"


@contextmanager
def stop_on_signals() -> Iterator[None]:
    """Handle SIGTERM, SIGHUP and SIGINT while a command runs; in another thread than the main one, do nothing.

    Raises
    ------
    TerminatedError
        In the main thread, when SIGTERM or SIGHUP arrives.
    KeyboardInterrupt
        The same for SIGINT.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reacted = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        reacted.set()
        signal.signal(number, signal.SIG_DFL)  # a second one ends the program
        raise TerminatedError(number)

    def interrupt(number: int, frame: FrameType | None) -> None:
        reacted.set()
        raise KeyboardInterrupt

    wanted: dict[int, Any] = {getattr(signal, n): end for n in _NAMES if hasattr(signal, n)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        wanted[signal.SIGINT] = interrupt
    # what is ignored (nohup) stays ignored
    wanted = {n: handler for n, handler in wanted.items() if signal.getsignal(n) is not signal.SIG_IGN}
    before = {number: signal.signal(number, handler) for number, handler in wanted.items()}
    try:
        with _watch(reacted, set(wanted)):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _watch(reacted: threading.Event, numbers: set[int]) -> Iterator[None]:
    """End the process if a signal came and no handler ran for `PATIENCE_S`."""
    ours, pythons = socket.socketpair()
    pythons.setblocking(False)
    before = signal.set_wakeup_fd(pythons.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_listen, args=(ours, reacted, numbers), name="signal watch", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        pythons.close()  # the thread ends


def _listen(ours: socket.socket, reacted: threading.Event, numbers: set[int]) -> None:
    with ours:
        while received := ours.recv(1):
            if received[0] in numbers and not reacted.wait(PATIENCE_S):
                name = signal.Signals(received[0]).name
                sys.stderr.write(f"camnet: ended by {name} inside compiled code\n")
                sys.stderr.flush()
                os._exit(1)
            reacted.clear()

"""The ``camnet`` program as a process: nothing is shown of the inside when it is stopped, and it ends at once.

Freeing everything that is loaded takes Python up to a second of work; a process that a signal stops does without.
"""

from __future__ import annotations

import atexit
import os
import sys
from contextlib import suppress
from typing import NoReturn

__all__ = ["program"]


def program() -> NoReturn:
    """Run one command and end this process with its exit status."""
    try:
        from camnet.cli.main import STOPPED, run

        status = run(sys.argv[1:])
    except KeyboardInterrupt:  # while the program itself was loaded
        print("camnet: interrupted", file=sys.stderr)
        _end_now()
    if status == STOPPED:
        _end_now()
    sys.exit(status)


def _end_now() -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the reader left
            stream.flush()
    try:
        atexit._run_exitfuncs()  # temporary folders go
    finally:
        os._exit(1)

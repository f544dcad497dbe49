"""What the program tells a person: the one place that sets up logging. All of it goes to standard error.

Two loggers: ``camnet`` carries what the library has to say, from ``--log-level`` on (default: warnings and errors);
``camnet.cli.notices`` carries the plain sentences of a command (``wrote runs/first``), which ``--quiet`` drops.
"""

from __future__ import annotations

import logging
import sys
from typing import Any, TextIO

__all__ = ["LEVELS", "configure", "say", "warn"]

#: what ``--log-level`` takes
LEVELS = ("debug", "info", "warning", "error")

_LIBRARY = logging.getLogger("camnet")
_COMMAND = logging.getLogger("camnet.cli")
_NOTICES = logging.getLogger("camnet.cli.notices")


class _StandardError(logging.StreamHandler[TextIO]):
    """Writes to whatever ``sys.stderr`` is at that moment, so that it can be replaced."""

    def __init__(self, layout: logging.Formatter) -> None:
        logging.Handler.__init__(self)
        self.setFormatter(layout)

    @property
    def stream(self) -> Any:  # type: ignore[override] # noqa: ANN401 - an attribute in the standard library
        return sys.stderr


class _Layout(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return f"camnet: {record.levelname.lower()}: {super().format(record)}"


def configure(level: str = "warning", quiet: bool = False) -> None:
    """Set up logging for one command; a second call replaces what the first did.

    Parameters
    ----------
    level : one of ``LEVELS``: the least severe message of the library that is shown
    quiet : whether the plain sentences of commands are dropped
    """
    _LIBRARY.handlers = [_StandardError(_Layout())]
    _LIBRARY.setLevel(level.upper())
    _COMMAND.setLevel(min(logging.WARNING, _LIBRARY.level))
    _NOTICES.handlers = [_StandardError(logging.Formatter())]
    _NOTICES.setLevel(logging.WARNING if quiet else logging.INFO)
    _NOTICES.propagate = False


def say(words: str) -> None:
    """Tell the person at the terminal what was done; not with ``--quiet``."""
    _NOTICES.info("%s", words)


def warn(words: str) -> None:
    """Tell the person at the terminal what is wrong, with ``--quiet`` too."""
    _COMMAND.warning("%s", words)

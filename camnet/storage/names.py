"""Names of temporary files and folders: they carry the process, so that those of dead processes can be told.

A temporary name is ``.partial-<host>-<pid>.<name>``; it ends like the name that it stands for, because programs choose
formats by the ending. ``<host>`` is a digest of the host's name: a process number means nothing on another host.
"""

from __future__ import annotations

import hashlib
import os
import re
import socket
from dataclasses import dataclass

from camnet.alive import is_alive

__all__ = ["Temporary", "parse", "short_name", "temporary_name"]

#: bytes of a name that are kept: with what is put in front, the longest name of every common file system is not reached
_LONGEST = 180
_PATTERN = re.compile(r"\.(partial|replaced)-([0-9a-f]{6})-(\d{1,10})\.(.+)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Temporary:
    """A temporary name taken apart.

    Attributes
    ----------
    purpose : ``partial`` (being written) or ``replaced`` (moved aside, about to be removed)
    host : digest of the host's name
    pid : process that made it
    name : short name of the file or folder that it stands for
    """

    purpose: str
    host: str
    pid: int
    name: str

    def is_stale(self) -> bool:
        """Whether its process ran on this host and is gone."""
        return self.host == _host() and self.pid != os.getpid() and not is_alive(self.pid)


def _host() -> str:
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:6]


def short_name(name: str) -> str:
    """Return ``name``, or where it is long a digest and its end."""
    encoded = os.fsencode(name)
    if len(encoded) <= _LONGEST:
        return name
    end = encoded[-(_LONGEST - 9) :].decode("utf-8", "ignore").lstrip(".")
    return f"{hashlib.sha256(encoded).hexdigest()[:8]}-{end}"


def temporary_name(name: str, purpose: str = "partial") -> str:
    """Return the name under which this process writes ``name``."""
    return f".{purpose}-{_host()}-{os.getpid()}.{short_name(name)}"


def parse(name: str) -> Temporary | None:
    """Take a temporary name apart; None for any other name."""
    match = _PATTERN.fullmatch(name)
    return None if match is None else Temporary(match[1], match[2], int(match[3]), match[4])

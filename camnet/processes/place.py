"""Where the work of a command is done: worker processes of this machine, or a Ray cluster.

| text | work is done |
| --- | --- |
| ``local`` | by processes of this machine (`camnet.processes.pool`) |
| ``ray`` | by a Ray cluster of ``jobs`` workers that is started on this machine and ends with the command |
| ``ray:ADDRESS`` | by the cluster at ``ADDRESS`` (``auto``, ``host:port``, ``ray://host:port``) |

Results do not depend on it: every task has a seed of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from camnet.errors import ConfigError
from camnet.processes.crew import Crew
from camnet.processes.pool import Workers

__all__ = ["LOCAL", "Place", "in_order", "read_place"]

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Place:
    """A place where tasks are done.

    Attributes
    ----------
    ray : whether it is a Ray cluster
    address : of a cluster that runs already; None: one of this machine, for this command
    """

    ray: bool = False
    address: str | None = None

    def workers(self, jobs: int) -> Crew:
        """Return ``jobs`` workers at most of this place.

        Raises
        ------
        ConfigError
            Ray is not installed.
        """
        if not self.ray:
            return Workers(jobs)
        from camnet.processes.cluster import RayWorkers

        return RayWorkers(jobs, self.address)

    @property
    def shares_files(self) -> bool:
        """Whether workers are sure to see the files of this machine."""
        return not self.ray


#: processes of this machine
LOCAL = Place()


def read_place(text: str) -> Place:
    """Read ``local``, ``ray`` or ``ray:ADDRESS``.

    Raises
    ------
    ConfigError
        The text is none of these.
    """
    if text == "local":
        return LOCAL
    if text == "ray":
        return Place(ray=True)
    kind, colon, address = text.partition(":")
    if kind == "ray" and colon and address and not address.isspace():
        # ray://host:port is Ray's own way to write an address
        return Place(ray=True, address=text if address.startswith("//") else address)
    raise ConfigError(
        f"--on {text!r}: unknown; give local, ray, or ray:ADDRESS such as ray:auto or ray:10.0.0.1:6379"
    )


def in_order(
    crew: Crew | None,
    function: Callable[[_Task], _Result],
    tasks: Sequence[_Task],
    progress: Callable[[float], None] | None,
) -> list[_Result]:
    """Return the results of tasks in their order, whoever does them (None: this process)."""
    results: dict[int, _Result] = {}
    for k, result in (Workers(1) if crew is None else crew).finished(function, tasks):
        results[k] = result
        if progress is not None:
            progress(len(results) / len(tasks))
    return [results[k] for k in range(len(tasks))]

"""Whoever does independent tasks: what worker processes and a cluster have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Self, TypeVar

__all__ = ["Crew"]

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


class Crew(ABC):
    """Workers for the time of a ``with`` block; leaving it by an error stops them."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    @abstractmethod
    def finished(
        self, function: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Iterator[tuple[int, _Result]]:
        """Yield the index and the result of every task, as they finish; the order depends on the workers.

        ``function``, the tasks and the results must be picklable.

        Raises
        ------
        WorkerError
            A worker ended before its work was done.
        Exception
            Whatever ``function`` raises first.
        """

    @abstractmethod
    def _stop(self) -> None:
        """End all that still runs; nothing that waits is begun."""

"""Times as files write them."""

from __future__ import annotations

import re
from datetime import UTC, datetime

from camnet.errors import DataError
from camnet.importers._reading import Place, number, quoted

__all__ = ["Clock"]

#: seconds since 1970 that no recording reaches, while milliseconds do
_MOST_S = 1e11
_MOMENT = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}(?::[0-9]{2}(?:[.,][0-9]+)?)?\s*\S*")


class Clock:
    """Reads the times of one file, which must all be of one kind: seconds, or ISO 8601 with or without a zone."""

    def __init__(self) -> None:
        self._kind: str | None = None

    def iso(self, text: str, where: str | Place, field: str = "time") -> float:
        """Read an ISO 8601 date and time as Unix seconds; without a zone it is taken as UTC."""
        try:
            if not _MOMENT.fullmatch(text.strip()):
                raise ValueError
            moment = datetime.fromisoformat(text.strip())
        except ValueError:
            raise DataError(
                f"{where}: {field} is {quoted(text)}; seconds or a time such as 2018-03-11T18:20:06Z was expected"
            ) from None
        self._same("with a time zone" if moment.tzinfo else "without a time zone", where, field, text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()

    def seconds(self, text: str, where: str | Place, field: str) -> float:
        """Read a time given in seconds or as ISO 8601."""
        text = text.strip()
        if "-" in text[1:] and "e-" not in text.lower():
            return self.iso(text, where, field)
        value = number(text, where, field, largest=1e18)
        if abs(value) > _MOST_S:
            raise DataError(
                f"{where}: {field} is {quoted(text)}; seconds were expected: are these milliseconds? Then it is "
                f"{value / 1000.0:.3f} s"
            )
        self._same("in seconds", where, field, text)
        return value

    def _same(self, kind: str, where: str | Place, field: str, text: str) -> None:
        if self._kind is None:
            self._kind = kind
        elif self._kind != kind:
            raise DataError(
                f"{where}: {field} is {quoted(text)}, a time {kind}; the times before it are {self._kind}: "
                "write all of a file in one way"
            )

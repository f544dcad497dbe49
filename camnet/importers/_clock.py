"""Times as files write them."""

from __future__ import annotations

from datetime import UTC, datetime

from camnet.errors import DataError
from camnet.importers._reading import Place, number

__all__ = ["iso_seconds", "seconds"]


def iso_seconds(text: str, where: str | Place, field: str = "time") -> float:
    """Read an ISO 8601 date and time as Unix seconds; without a zone it is taken as UTC."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise DataError(
            f"{where}: {field} is {text!r}; seconds or a time such as 2018-03-11T18:20:06Z was expected"
        ) from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def seconds(text: str, where: str | Place, field: str) -> float:
    """Read a time given in seconds or as ISO 8601."""
    text = text.strip()
    if "-" in text[1:] and "e-" not in text.lower():
        return iso_seconds(text, where, field)
    return number(text, where, field)

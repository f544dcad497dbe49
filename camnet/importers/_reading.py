"""Opening files and reading numbers, with errors that name the place."""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast
from xml.parsers import expat

from camnet.errors import DataError

__all__ = ["Place", "number", "open_binary", "parse_xml", "text_lines"]

#: StartElement handler: local name, attributes, "file, line n"
StartHandler = Callable[[str, dict[str, str], "Place"], None]
#: EndElement handler: local name, the text inside, "file, line n"
EndHandler = Callable[[str, str, "Place"], None]


class Place:
    """Where an XML parser stands; formatted only when a message needs it, since most elements are sound."""

    def __init__(self, path: Path, parser: expat.XMLParserType) -> None:
        self._path, self._parser = path, parser

    def __str__(self) -> str:
        return f"{self._path}, line {self._parser.CurrentLineNumber}"


@contextmanager
def open_binary(path: Path) -> Iterator[BinaryIO]:
    """Open ``path``, unpacking ``.gz``; what the operating system refuses becomes a `DataError`."""
    try:
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as stream:
            yield cast(BinaryIO, stream)
    except FileNotFoundError:
        raise DataError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise DataError(f"{path}: is a folder; name a file in it") from None
    except PermissionError:
        raise DataError(f"{path}: may not be read (permission denied)") from None
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise DataError(f"{path}: not a whole gzip file ({error})") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None


def text_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a UTF-8 text file with their numbers from 1, without line ends."""
    with open_binary(path) as stream:
        for line_number, raw in enumerate(stream, start=1):
            try:
                text = raw.decode("utf-8-sig" if line_number == 1 else "utf-8")
            except UnicodeDecodeError as error:
                raise DataError(
                    f"{path}, line {line_number}: byte {raw[error.start]:#04x} is not UTF-8 text"
                ) from None
            yield line_number, text.rstrip("\r\n")


def number(text: str, where: str | Place, field: str) -> float:
    """Read one finite decimal number; ``where`` is "file, line n"."""
    try:
        value = float(text)
    except ValueError:
        raise DataError(f"{where}: {field} is {text!r}; a decimal number was expected") from None
    if not math.isfinite(value):
        raise DataError(f"{where}: {field} is {text!r}; a finite number was expected")
    return value


def parse_xml(path: Path, root: str, start: StartHandler, end: EndHandler | None = None) -> None:
    """Stream an XML file through handlers that get local names (no namespace) and the place in the file.

    Parameters
    ----------
    path : file, ``.gz`` allowed
    root : local name that the outermost element must have
    start, end : called at every element's start and end
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    place = Place(path, parser)
    text: list[str] = []
    depth = 0

    def on_start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        local = name.rpartition(" ")[2]
        if depth == 0 and local != root:
            raise DataError(f"{place}: the outermost element is <{local}>; <{root}> was expected")
        depth += 1
        text.clear()
        start(local, attributes, place)

    def on_end(name: str) -> None:
        nonlocal depth
        depth -= 1
        if end is not None:
            end(name.rpartition(" ")[2], "".join(text).strip(), place)
        text.clear()

    def on_entity(*declaration: Any) -> None:  # noqa: ANN401 (expat passes seven values; none is used)
        raise DataError(f"{place}: declares the entity {declaration[0]!r}; data files must not")

    parser.StartElementHandler = on_start
    parser.EndElementHandler = on_end
    parser.CharacterDataHandler = text.append
    parser.EntityDeclHandler = on_entity
    try:
        with open_binary(path) as stream:
            parser.ParseFile(stream)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise DataError(f"{path}, line {error.lineno}: not well-formed XML ({reason})") from None

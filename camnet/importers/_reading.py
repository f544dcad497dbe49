"""Opening files and reading numbers, with errors that name the place."""

from __future__ import annotations

import difflib
import gzip
import io
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast
from xml.parsers import expat

from camnet.errors import DataError
from camnet.numerals import LARGEST, read_decimal

__all__ = ["Place", "known_columns", "number", "open_binary", "parse_xml", "quoted", "text_lines"]

#: longest content of a data file, after unpacking, bytes: more would not fit into memory as numbers
_MOST_BYTES = 512_000_000
#: longest line of a text file, bytes
_LONGEST_LINE = 1_000_000
#: deepest nesting of an XML file
_DEEPEST = 200
#: likeness (difflib's ratio) and length from which one name is taken for another misspelt
_ALIKE, _LEAST_ALIKE = 0.8, 4

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


class _Limited(io.RawIOBase):
    """Passes a stream's bytes on, up to a limit: a packed file can unpack to any size, a device has no end."""

    def __init__(self, stream: BinaryIO, path: Path) -> None:
        self._stream, self._path, self._read = stream, path, 0

    def readable(self) -> bool:
        """Return True: it is made to be read."""
        return True

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - any writable buffer
        """Fill a buffer; DataError beyond the limit."""
        data = self._stream.read(len(buffer))
        self._read += len(data)
        if self._read > _MOST_BYTES:
            raise DataError(f"{self._path}: more than {_MOST_BYTES:,} bytes; at most that many are read")
        buffer[: len(data)] = data
        return len(data)


@contextmanager
def open_binary(path: Path) -> Iterator[BinaryIO]:
    """Open ``path``, unpacking ``.gz``; what the operating system refuses becomes a `DataError`."""
    try:
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as stream:
            yield cast(BinaryIO, io.BufferedReader(_Limited(cast(BinaryIO, stream), path)))
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
        for line_number, raw in enumerate(iter(lambda: stream.readline(_LONGEST_LINE + 1), b""), start=1):
            if len(raw) > _LONGEST_LINE:
                raise DataError(f"{path}, line {line_number}: longer than {_LONGEST_LINE:,} bytes")
            try:
                text = raw.decode("utf-8-sig" if line_number == 1 else "utf-8")
            except UnicodeDecodeError as error:
                raise DataError(
                    f"{path}, line {line_number}: byte {raw[error.start]:#04x} is not UTF-8 text"
                ) from None
            if "\0" in text:
                raise DataError(f"{path}, line {line_number}: holds a zero byte; UTF-8 text was expected")
            yield line_number, text.rstrip("\r\n")


def number(text: str, where: str | Place, field: str, largest: float = LARGEST) -> float:
    """Read one finite decimal number; ``where`` is "file, line n"."""
    try:
        return read_decimal(text, largest)
    except ValueError as error:
        raise DataError(f"{where}: {field} is {quoted(text)}; {error}") from None


def quoted(text: str) -> str:
    """Quote a value of a file, shortened where it is long."""
    return repr(text) if len(text) <= 80 else f"{text[:77]!r}..."


def known_columns(names: Sequence[str], known: Sequence[str], where: str | Place) -> None:
    """Refuse an unknown column whose name is nearly that of a known one that is missing.

    Raises
    ------
    DataError
        Such a column, with the name that was probably meant. Other unknown columns are left aside.
    """
    missing = [name for name in known if name not in names]
    for name in names:
        close = difflib.get_close_matches(name, missing, 1, _ALIKE) if name and name not in known else []
        if close and len(name) >= _LEAST_ALIKE:
            raise DataError(f"{where}: unknown column {quoted(name)}; did you mean {close[0]!r}?")


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
        if depth > _DEEPEST:
            raise DataError(f"{place}: elements are nested more than {_DEEPEST} deep")
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
    except (LookupError, ValueError) as error:  # an encoding that Python does not know, or cannot use here
        raise DataError(f"{path}: cannot be read as XML ({error}); UTF-8 text was expected") from None
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise DataError(f"{path}, line {error.lineno}: not well-formed XML ({reason})") from None

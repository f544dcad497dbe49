"""Rows of a CSV table with the lines they stand on."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from camnet.errors import DataError
from camnet.importers._reading import text_lines

__all__ = ["table_rows"]


def table_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that are not blank, each with the number of the line it ends on.

    Fields are parted by commas, semicolons or tabs, whichever the first line has most of.

    Raises
    ------
    DataError
        The file is empty, or a row is not CSV.
    """
    lines = text_lines(path)
    first = next(lines, None)
    if first is None:
        raise DataError(f"{path}: is empty; a header with the names of the columns was expected")
    delimiter = max(",;\t", key=first[1].count)
    reader = csv.reader((text for _, text in chain([first], lines)), delimiter=delimiter, strict=True)
    try:
        for row in reader:
            if any(field.strip() for field in row):
                yield reader.line_num, row
    except csv.Error as error:
        raise DataError(f"{path}, line {reader.line_num}: not a CSV row ({error})") from None

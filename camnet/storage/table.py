"""Tables of 64-bit floats in Parquet, checked against what they must hold before they are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from camnet.errors import DataError
from camnet.storage.reading import open_bounded
from camnet.types import Array

__all__ = ["read_table"]

#: no log is larger, on disk or in memory
LIMIT_BYTES = 2_000_000_000


def read_table(path: Path, columns: Sequence[str], limit_bytes: int = LIMIT_BYTES) -> dict[str, Array]:
    """Return all columns, name -> (rows,), in the order of ``columns``; empty cells are NaN.

    Raises
    ------
    DataError
        The file is absent, damaged or too large, or does not hold exactly ``columns``, as 64-bit floats.
    """
    with open_bounded(path, limit_bytes) as stream:
        try:
            file = pq.ParquetFile(pa.PythonFile(stream, mode="r"))
            _check_schema(path, file, columns, limit_bytes)
            table = file.read()
        except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, MemoryError) as error:
            raise DataError(f"{path}: is not a readable Parquet table ({_first_line(error)})") from error
    return {name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in columns}


def _check_schema(path: Path, file: pq.ParquetFile, columns: Sequence[str], limit_bytes: int) -> None:
    schema, rows = file.schema_arrow, file.metadata.num_rows
    names = schema.names
    missing = [name for name in columns if name not in names]
    unknown = [name for name in names if name not in set(columns)]
    if missing or unknown:
        what = (
            f"column {missing[0]!r} is missing" if missing else f"column {unknown[0]!r} does not belong there"
        )
        raise DataError(f"{path}: {what}")
    if len(names) != len(columns):
        raise DataError(f"{path}: a column stands there twice")
    for name in columns:
        kind = schema.field(name).type
        if kind != pa.float64():
            raise DataError(f"{path}: column {name!r} holds {kind}, expected 64-bit floats")
    size = 8 * rows * len(columns)
    if not 0 <= size <= limit_bytes:
        raise DataError(f"{path}: {rows} rows are {size} bytes, more than the limit of {limit_bytes}")


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__

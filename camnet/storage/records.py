"""Tables of records in Parquet: text, numbers and yes/no, with units and descriptions, checked when they are read."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from camnet.errors import DataError
from camnet.storage.reading import open_bounded
from camnet.storage.whole_file import whole_file

__all__ = ["KEY", "Field", "read_records", "schema_of", "write_records"]

#: of the metadata of a file: JSON with the unit and the description of every column
KEY = b"camnet.columns"
_KINDS = {float: pa.float64(), str: pa.string(), bool: pa.bool_()}
_LIMIT_BYTES = 200_000_000


@dataclass(frozen=True, slots=True)
class Field:
    """One column: its name, the kind of its values (float, str or bool; all may be empty), unit and meaning."""

    name: str
    kind: type
    unit: str
    description: str


def schema_of(fields: Sequence[Field]) -> pa.Schema:
    """Return the schema: each field has the metadata ``unit`` and ``description``, and ``KEY`` has all of them."""
    columns = [
        pa.field(f.name, _KINDS[f.kind], metadata={"unit": f.unit, "description": f.description})
        for f in fields
    ]
    described = {f.name: {"unit": f.unit, "description": f.description} for f in fields}
    return pa.schema(columns, metadata={KEY: json.dumps(described).encode()})


def write_records(path: Path, fields: Sequence[Field], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write Parquet, whole or not at all."""
    schema = schema_of(fields)
    columns = [pa.array([row[f.name] for row in rows], schema.field(f.name).type) for f in fields]
    with whole_file(path) as temporary:
        pq.write_table(pa.Table.from_arrays(columns, schema=schema), temporary, compression="zstd")


def read_records(path: Path, fields: Sequence[Field]) -> list[dict[str, Any]]:
    """Return the rows.

    Raises
    ------
    DataError
        The file is absent, damaged or too large, or has other columns.
    """
    with open_bounded(path, _LIMIT_BYTES) as stream:
        try:
            file = pq.ParquetFile(pa.PythonFile(stream, mode="r"))
            found = [(f.name, f.type) for f in file.schema_arrow]
            if found != [(f.name, _KINDS[f.kind]) for f in fields]:
                raise DataError(f"{path}: its columns are not {', '.join(f.name for f in fields)}")
            size = sum(
                file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups)
            )
            if not 0 <= size <= _LIMIT_BYTES or file.metadata.num_rows * len(fields) > _LIMIT_BYTES // 8:
                raise DataError(f"{path}: is larger than the limit of {_LIMIT_BYTES} bytes")
            rows: list[dict[str, Any]] = file.read().to_pylist()
            for row in rows:
                for name, value in row.items():
                    if isinstance(value, float) and not math.isfinite(value):
                        raise DataError(f"{path}: column {name!r}: {value} is not a finite number")
        except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, MemoryError) as error:
            raise DataError(f"{path}: is not a readable Parquet table") from error
    return rows

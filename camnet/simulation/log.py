"""The log of a run: one wide table, one row per log instant, written as Parquet.

Its columns and what they mean: `camnet.simulation.log_columns`. Units and descriptions are in the file's metadata.
The bytes depend on the logged numbers alone, so equal runs give equal files.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from camnet.simulation.log_columns import LogColumn
from camnet.storage.records import Field, schema_of
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["RunLog"]


class RunLog:
    """A table of float64 columns that grows by rows.

    Parameters
    ----------
    columns : in order
    """

    def __init__(self, columns: Sequence[LogColumn]) -> None:
        self.described = tuple(columns)
        self.columns = tuple(column.name for column in columns)
        self._rows: Array = np.empty((1024, len(self.columns)))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, row: Array) -> None:
        """Add one row, shape (number of columns,)."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1

    @property
    def values(self) -> Array:
        """All rows, shape (rows, columns)."""
        return self._rows[: self._count]

    def table(self) -> pa.Table:
        """Return the log as an Arrow table."""
        # by their bytes: given NumPy's arrays, Arrow would load pandas first, wherever that is installed
        rows = [pa.py_buffer(np.ascontiguousarray(column)) for column in self.values.T]
        columns = [pa.Array.from_buffers(pa.float64(), len(self), [None, row]) for row in rows]
        fields = [Field(c.name, float, c.unit, c.description) for c in self.described]
        return pa.Table.from_arrays(columns, schema=schema_of(fields))

    def write(self, path: Path) -> None:
        """Write Parquet to ``path`` (a temporary name first, then renamed)."""
        with whole_file(path) as temporary:
            pq.write_table(self.table(), temporary, compression="zstd")

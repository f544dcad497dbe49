"""The log opens in pandas, grows, and depends on its numbers alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from camnet.simulation.log import RunLog
from camnet.simulation.log_columns import LogColumn


def filled(rows: int) -> RunLog:
    log = RunLog([LogColumn("t_s", "s", "time"), LogColumn("robot.p_x_m", "m", "x")])
    for k in range(rows):
        log.append(np.array([0.1 * k, np.sin(k)]))
    return log


def test_pandas_reads_every_row(tmp_path: Path) -> None:
    filled(3000).write(tmp_path / "log.parquet")
    frame = pd.read_parquet(tmp_path / "log.parquet")
    assert list(frame.columns) == ["t_s", "robot.p_x_m"]
    np.testing.assert_array_equal(frame["robot.p_x_m"], np.sin(np.arange(3000)))


def test_equal_logs_are_equal_files_and_nothing_else_is_left(tmp_path: Path) -> None:
    for name in ("a", "b"):
        filled(2000).write(tmp_path / f"{name}.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.parquet", "b.parquet"]


def test_one_changed_bit_changes_the_file(tmp_path: Path) -> None:
    log = filled(10)
    log.write(tmp_path / "a.parquet")
    log.values[3, 1] = np.nextafter(log.values[3, 1], 2.0)
    log.write(tmp_path / "b.parquet")
    a, b = (pq.read_table(tmp_path / f"{n}.parquet") for n in "ab")
    assert not a.equals(b)

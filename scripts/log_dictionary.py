"""Write docs/log.md, the dictionary of the log and of the table of events, from the records that make them.

python scripts/log_dictionary.py            write it
python scripts/log_dictionary.py --check    exit status 1 where it is not what it would be
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from camnet.simulation.events import EVENT_COLUMNS, KINDS
from camnet.simulation.log_columns import INSTRUMENT_WORDS, LogColumn, describe_columns

PAGE = Path(__file__).resolve().parents[1] / "docs/log.md"

_HEAD = """# The log of a run

<!-- written by scripts/log_dictionary.py -->

`camnet simulate` leaves two tables, which pandas, polars, DuckDB and others open:

| file | one row for each |
| --- | --- |
| `log.parquet` | instant of the log, `run.log_hz` a second: truth, estimates, cameras, tasks, certificates |
| `events.parquet` | sighting, loss, handoff and collision, at the instant of sensing or of contact |

```bash
camnet log runs/first                                      # what is in it
camnet log runs/first --describe --only 'robot.p_*'        # unit and meaning of some columns
camnet log runs/first --csv --only 't_s,*.p_?_m' --every 10
camnet log runs/first --events --csv --out runs/table      # events.csv in a folder
```

```python
import pyarrow.parquet as pq

log = pq.read_table("runs/first/log.parquet")
print(log.schema.field("robot.p_x_m").metadata)  # unit and description
frame = log.to_pandas()  # extra "analysis"; or pandas.read_parquet
```

Every column carries `unit` and `description` in the metadata of its field; the key `camnet.columns` of the file's
metadata has all of them as one JSON object. The unit `1` stands for what has none. Positions and velocities are in the
world's frame (x east, y north, z up, where it has an origin); quaternions are of unit length, scalar first. An empty
cell of `--csv`, NaN in the log, is unknown. `summary.json` seals both tables. A run from before there was a table of
events is read without it; `--events` says so with exit status 2.
"""


_WHOSE = """Those of each target, of each estimator of each target, and of each agent; `{x,y,z}` stands for three. An
agent's own pose is there where it may lose its pose or leave its region, a target's size where that is unknown, and the
Lyapunov analysis (`V` to `sigma_h`) with `run.instruments: true`."""


def _table(columns: list[LogColumn]) -> str:
    rows = [f"| `{c.name}` | {c.unit} | {c.description} |" for c in columns]
    return "\n".join(["| column | unit | meaning |", "| --- | --- | --- |", *rows])


def _merged(columns: list[LogColumn]) -> list[LogColumn]:
    """Put the parts of a vector into one line."""
    found: dict[str, LogColumn] = {}
    for c in columns:
        name = re.sub(r"_([xyz])_(m|mps)$", r"_{x,y,z}_\2", re.sub(r"_q_[wxyz]$", "_q_{w,x,y,z}", c.name))
        name = re.sub(r"\.q_[wxyz]$", ".q_{w,x,y,z}", name)
        words = re.sub(r"; world frame, [xyz]$", "; world frame", c.description)
        words = re.sub(r"; unit quaternion, part [wxyz]$", "; unit quaternion", words)
        found.setdefault(name, LogColumn(name, c.unit, words))
    return list(found.values())


def page() -> str:
    """Return the page."""
    log = _merged(
        describe_columns(["AGENT"], ["TARGET"], ["ESTIMATOR"], ["AGENT"], ["TARGET"], tuple(INSTRUMENT_WORDS))
    )
    kinds = "\n".join(f"| `{kind}` | {words} |" for kind, words in KINDS.items())
    return (
        f"{_HEAD}\n## Columns of the log\n\n{_WHOSE}\n\n{_table(log)}\n\n## Columns of the table of events\n\n"
        f"{_table(list(EVENT_COLUMNS))}\n\n| event | what it is |\n| --- | --- |\n{kinds}\n"
    )


if __name__ == "__main__":
    if "--check" in sys.argv[1:]:
        sys.exit(0 if PAGE.read_text(encoding="utf-8") == page() else 1)
    PAGE.write_text(page(), encoding="utf-8")

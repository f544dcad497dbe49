"""The part of ``camnet simulate`` that replays a recording: learn from everybody, predict everybody."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from camnet import __version__
from camnet.cli.common import progress_bar, say, warn
from camnet.cli.output import output_folder, print_json, write_json
from camnet.config.recorded import RecordedScenario
from camnet.experiments.recorded import RecordedResult, run_recorded
from camnet.importers.geodesy import Origin
from camnet.report.recorded import write_error_curves, write_recorded_map, write_recorded_report

__all__ = ["run_and_write"]


def run_and_write(args: argparse.Namespace, scenario: RecordedScenario) -> int:
    """Replay, write the folder, print."""
    with output_folder(args, "simulate", f"{scenario.name}-seed{scenario.seed}") as output:
        assert output is not None  # it has a default name
        result, content = _replay(args, scenario)
        write_json(output.path / "summary.json", content)
        pq.write_table(pa.table(result.gaps), output.path / "gaps.parquet", compression="zstd")
        output.results_stand()
        if not args.no_report:
            _draw(result, scenario, output.path)
    if args.json:
        print_json(content)
    else:
        _print(result)
    say(f"wrote {output.folder}")
    if result.interrupted:
        warn("interrupted: the run is partial and marked so")
    return 0


def _replay(args: argparse.Namespace, scenario: RecordedScenario) -> tuple[RecordedResult, dict[str, Any]]:
    """Return the result, and what is written of it."""
    where = scenario.origin
    with progress_bar(1.0, "replaying", "", args.quiet) as advance:
        result = run_recorded(
            scenario.read_cameras(),
            scenario.read_tracks(),
            scenario.crossing,
            scenario.cameras.range_cap_m,
            None if where is None else Origin(where.latitude_deg, where.longitude_deg, where.altitude_m),
            scenario.seed,
            advance,
            near_m=scenario.cameras.near_m,
            target_height_m=scenario.target_height_m,
            max_fix_interval_s=scenario.tracks.max_fix_interval_s,
        )
    content = {
        "summary": {**result.summary, "interrupted": result.interrupted},
        "seed": scenario.seed,
        "version": __version__,
        "config": scenario.model_dump(mode="json"),
    }
    return result, content


def _draw(result: RecordedResult, scenario: RecordedScenario, folder: Path) -> None:
    names = ("learned", "ekf", "last_seen")
    errors = {name: np.asarray(result.gaps[f"{name}_error_m"]) for name in names}
    write_recorded_map(result.map, folder / "map.png")
    write_error_curves(errors, folder / "errors.png")
    write_recorded_report(folder, scenario.name, scenario.description, result.summary)


def _print(result: RecordedResult) -> None:
    gaps = result.summary["gaps"]
    print(f"{gaps['count']} gaps        median error   90 % below   next camera right")
    for name in ("learned", "ekf", "last_seen"):
        row, right = gaps[name], gaps["next_camera_accuracy"][name]
        print(f"  {name:12s} {row['median_error_m']:11.1f} m {row['p90_error_m']:10.1f} m {right:14.1%}")

"""``camnet track``: a target's track from observations of several observers."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import positive
from camnet.cli.common import add_common, progress_bar, say
from camnet.cli.output import output_folder, print_json, write_json
from camnet.errors import ConfigError

__all__ = ["add_parser"]

_DESCRIPTION = """Estimate a target's track from a CSV of positions that one or several observers measured: irregular
times, two or three dimensions, missing observations. AdaTE (li2019) adapts its covariances and names observers that
drift; Kalman filters stand beside it.

columns: t, x, y (z) in metres or lat, lon (alt); observer; sd, or sd_x, sd_y (sd_z), or cov_xx, cov_xy, cov_yy (...);
and true_x, true_y (true_z) to compare with. An empty position is a missing observation.

  camnet track observations.csv --out runs/track
  camnet track fixes.csv --sd 3 --estimators adate,ekf,ukf

Writes track.csv (causal and smoothed positions with covariances), observations.csv (which are outliers or drift),
track.png, report.html and result.json."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "track",
        help="a target's track from observations of several observers",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("observations", type=Path, help="CSV file (.gz too)")
    parser.add_argument(
        "--estimators", default="adate,ekf", metavar="E,E", help="of adate, ekf, ukf (default adate,ekf)"
    )
    parser.add_argument(
        "--sd",
        type=positive,
        metavar="M",
        help="standard deviation of the observations, m, where the file has none",
    )
    add_common(parser, "runs/track-NAME, or a number after it if that is taken")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read, estimate, write."""
    from camnet.experiments.observed_track import ESTIMATORS, follow_observations, summary
    from camnet.importers.observations import read_observations
    from camnet.report.observed_track import write_track_files

    names = [name.strip() for name in args.estimators.split(",")]
    for name in names:
        if name not in ESTIMATORS:
            raise ConfigError(
                f"--estimators {args.estimators!r}: {name!r} is unknown; known are {', '.join(ESTIMATORS)}"
            )
    if len(set(names)) < len(names):
        raise ConfigError(f"--estimators {args.estimators!r}: names one twice")
    data = read_observations(args.observations, args.sd)
    with output_folder(args, "track", f"track-{args.observations.name.partition('.')[0]}") as output:
        assert output is not None  # it has a default name
        followed = {}
        with progress_bar(len(names), "tracking", "", args.quiet) as advance:
            for k, name in enumerate(names):
                followed[name] = follow_observations(name, data, partial(_advance, advance, k))
        content = {**summary(data, followed), "version": __version__}
        write_json(output.path / "result.json", content)
        write_track_files(output.path, data, followed, content)
    if args.json:
        print_json(content)
    else:
        _print(content)
    say(f"wrote {output.folder}; open {output.folder / 'report.html'}")
    return 0


def _advance(advance: Any, done: int, share: float) -> None:  # noqa: ANN401 - as `progress_bar` yields it
    advance(done + share)


def _print(content: dict[str, Any]) -> None:
    for name, figures in content["estimators"].items():
        words = ", ".join(
            f"{key.replace('_', ' ')} {value:.4g}" for key, value in figures.items() if value is not None
        )
        print(f"{name}: {words}")
    for name, figures in content["observers"].items():
        drift = figures.get("drifts_from_s")
        said = f"drifts from t = {drift:.6g} s" if drift is not None else "does not drift"
        print(f"observer {name}: {figures['observations']} observations, {said}")

"""``camnet bench``: speed, always as a ratio against a named baseline in the same run."""

from __future__ import annotations

import argparse
import importlib
import json
from typing import Any

from camnet import __version__
from camnet.cli.common import add_common, progress_bar
from camnet.cli.output import output_folder, print_json, write_json

__all__ = ["BENCHMARKS", "add_parser"]

#: name -> module with ``run(seed=, progress=) -> dict``, and what it measures
BENCHMARKS = {
    "certify": (
        "camnet.certification.benchmark",
        "certificates of generated cities: growth of the cost with size",
    ),
    "env": ("camnet.experiments.bench_env", "handoff environment on both back ends, and peers"),
    "estimator": (
        "camnet.experiments.bench_estimator",
        "updates of the learning estimator against plain NumPy",
    ),
    "history-selection": ("camnet.experiments.bench_history", "choice of stack entries against brute force"),
    "sensing": ("camnet.experiments.bench_sensing", "poses read from features and images of a marker"),
    "simulation": ("camnet.experiments.bench_simulation", "closed loop against real time and raw PyBullet"),
    "structure": (
        "camnet.experiments.bench_structure",
        "bundle adjustment and distance observers against plain ways",
    ),
}


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    listing = "\n".join(f"  {name:18s} {words}" for name, (_, words) in BENCHMARKS.items())
    parser = commands.add_parser(
        "bench",
        help="speed against named baselines",
        description="Measure speed, always against a baseline that runs beside it; prints JSON.\n\n"
        f"{listing}\n\n  camnet bench history-selection --out runs/speed",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("benchmark", choices=BENCHMARKS, metavar="BENCHMARK", help="one of the names above")
    add_common(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run one benchmark."""
    module = importlib.import_module(BENCHMARKS[args.benchmark][0])
    with output_folder(args, "bench") as output:
        with progress_bar(1.0, args.benchmark, "", args.quiet) as advance:
            content = {**module.run(seed=args.seed or 0, progress=advance), "version": __version__}
        if output is not None:
            write_json(output.path / "result.json", content)
    if args.json:
        print_json(content)
    else:
        print(json.dumps(content, indent=2))
    return 0

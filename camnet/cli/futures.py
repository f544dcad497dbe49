"""``camnet futures``: what could be predicted of traffic between views."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import positive
from camnet.cli.common import add_common, add_set, progress_bar, say
from camnet.cli.output import output_folder, print_json, write_json
from camnet.errors import ConfigError

__all__ = ["add_parser"]

_DESCRIPTION = """Which view will see a vehicle next, and when? Branches and travel times are learned from the first
half of a traffic simulation and tested on the second; leaving for good is an outcome too.

  camnet futures configs/bologna.yaml --set data=FOLDER                      SUMO drives for an hour (extra sumo)
  camnet futures configs/bologna.yaml --set data=FOLDER --trace fcd.xml.gz   a trace that is there already
  camnet futures configs/bologna.yaml --set data=FOLDER --hidden 1,5,20      and labels hidden, at vehicles a minute

Views are the busiest places, as in the recipe (traffic.regions). The constant-speed model stands beside.

With --out: futures.json, report.html, and the trace (fcd.xml.gz). Exit status: 0 done, 2 bad input."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "futures",
        help="which view sees a vehicle next, and when? learned from half of a traffic simulation",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("config", help="a recipe with traffic, such as configs/bologna.yaml")
    add_set(parser)
    parser.add_argument(
        "--trace", type=Path, metavar="FILE", help="SUMO's floating-car data, in place of running SUMO"
    )
    parser.add_argument(
        "--length", type=positive, default=3600.0, metavar="S", help="simulated time, s (default: 3600)"
    )
    parser.add_argument(
        "--hidden", metavar="RATES", help="hide labels at these vehicles a minute, such as 1,5,20"
    )
    add_common(parser)
    parser.set_defaults(run=run, duration=None)


def run(args: argparse.Namespace) -> int:
    """Load, run SUMO where needed, learn, test, write."""
    from camnet.report.futures import write_futures_page

    rates = _rates(args.hidden)
    with output_folder(args, "futures") as output:
        content = _compute(args, rates, None if output is None else output.path)
        if output is not None:
            write_json(output.path / "futures.json", content)
            output.results_stand()
            write_futures_page(output.path, content)
    if output is not None:
        say(f"wrote {output.folder}; open {output.folder / 'report.html'}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 0


def _rates(text: str | None) -> list[float]:
    if text is None:
        return []
    try:
        return [positive(part) for part in text.split(",")]
    except argparse.ArgumentTypeError as error:
        raise ConfigError(f"--hidden {text!r}: {error}; give vehicles a minute, such as 1,5,20") from None


def _compute(args: argparse.Namespace, rates: list[float], folder: Path | None) -> dict[str, Any]:
    import tempfile

    from camnet.config.load import load_scenario
    from camnet.config.recorded import RecordedScenario
    from camnet.config.traffic import busy_places
    from camnet.experiments.traffic_futures import hidden_labels, predict_traffic
    from camnet.importers.sumo import run_sumo
    from camnet.importers.tracks import read_tracks

    scenario = load_scenario(args.config, args.overrides, args.seed)
    if isinstance(scenario, RecordedScenario) or scenario.traffic is None:
        raise ConfigError(
            f"config {args.config!r}: has no section traffic: give a recipe such as bologna.yaml"
        )
    with tempfile.TemporaryDirectory() as scratch:
        trace = args.trace
        if trace is None:
            say("SUMO drives; this takes some minutes")
            trace = (folder or Path(scratch)) / "fcd.xml.gz"
            run_sumo(scenario.traffic.sumo_config, trace, args.length, scenario.seed, scenario.traffic.step_s)
        tracks = read_tracks(trace, "fcd")
    end_s = max(float(t.t_s[-1]) for t in tracks)
    begin_s = min(float(t.t_s[0]) for t in tracks)
    half_s = 0.5 * (begin_s + end_s)
    places = busy_places([t for t in tracks if t.t_s[0] < half_s], scenario.traffic.regions)
    content: dict[str, Any] = {"name": scenario.name, "vehicles": len(tracks), "length_s": end_s - begin_s}
    content["places"] = [[*p.min_m, *p.max_m] for p in places]
    content |= predict_traffic(tracks, places, half_s, end_s)
    content["hidden"] = []
    with progress_bar(max(len(rates), 1), "hiding labels", "rates", args.quiet) as advance:
        for k, rate in enumerate(rates):
            content["hidden"].append(hidden_labels(tracks, places, rate, scenario.seed))
            advance(k + 1)
    return {**content, "seed": scenario.seed, "version": __version__}


def _print(content: dict[str, Any]) -> None:
    time, plain = content["time"], content["constant_speed"]
    print(f"{content['vehicles']} vehicles, {content['crossings']['tested']} crossings tested")
    print(
        f"next view right: {content['next_view_top1']:.3f}; log loss {content['log_loss']['learned']:.3f} nat"
    )
    print(
        f"\n{'time away':16s} {'median error':>13s} {'80 % hold':>10s} {'mean width':>11s} {'median width':>13s}"
    )
    for name, row in (("learned", time), ("constant speed", plain)):
        if row["median_error_s"] is not None:
            print(
                f"{name:16s} {row['median_error_s']:11.2f} s {row['held_by_80']:10.3f} "
                f"{row['mean_width_s']:9.1f} s {row['median_width_s']:11.1f} s"
            )
    for row in content["hidden"]:
        alone = row["alone"]
        print(
            f"\nlabels hidden, {row['vehicles_per_minute']:.1f} a minute: rank-1 {row['rank1_at_once']:.3f} at once, "
            f"{row['rank1_revised']:.3f} revised, nearest in time {row['rank1_nearest_in_time']:.3f}; alone, IDF1 "
            f"{alone['learned']['IDF1']:.3f} against {alone['nearest_in_time']['IDF1']:.3f}"
        )

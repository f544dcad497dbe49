"""``camnet identify``: recorded targets with their labels hidden."""

from __future__ import annotations

import argparse
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from camnet import __version__
from camnet.cli.arguments import positive
from camnet.cli.common import add_common, add_set, progress_bar, say
from camnet.cli.output import output_folder, print_json, write_json
from camnet.errors import ConfigError

__all__ = ["add_parser"]

_DESCRIPTION = """Hide the names of recorded targets and find out who it is that a camera sees again.

  camnet identify configs/meva.yaml --set data=FOLDER                     position and time only
  camnet identify configs/meva.yaml --set data=FOLDER --learn earlier     learned from what was before only
  camnet identify configs/meva.yaml --set data=FOLDER --appearance 0.66   and an appearance right so often alone
  camnet identify MY_SITE.yaml --out runs/identity                        any recording of yours (kind: recorded)

Every entry is decided at once, among all gaps that are open then; again, one-to-one, a window later; and by a system
that runs alone and lives with its own decisions (IDF1, HOTA, switches). Probabilities are held against what came true.

With --out: identity.json, entries.parquet (every entry: who it was, what was said, how sure), report.html.
Exit status: 0 done, 2 bad input."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "identify",
        help="who is it that a camera sees again? recorded targets with their names hidden",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("config", help="a recording (kind: recorded), such as configs/meva.yaml")
    add_set(parser)
    parser.add_argument(
        "--learn",
        choices=("others", "earlier"),
        default="others",
        help="from the crossings of other people, or of everybody before (default: others)",
    )
    parser.add_argument(
        "--appearance",
        type=positive,
        metavar="RANK1",
        help="simulate an appearance that alone finds the right one with this share, between 0.01 and 0.99",
    )
    parser.add_argument(
        "--window", type=positive, metavar="S", help="how long a decision may be revised, s (default: 180)"
    )
    add_common(parser)
    parser.set_defaults(run=run, duration=None)


def run(args: argparse.Namespace) -> int:
    """Load, identify, write, print."""
    from camnet.report.identity import write_identity_page

    if args.appearance is not None and not 0.01 <= args.appearance <= 0.99:
        raise ConfigError(f"--appearance {args.appearance:g}: a share between 0.01 and 0.99 was expected")
    with output_folder(args, "identify") as output:
        name, result = _identify(args)
        content = {"name": name, **result.summary, "version": __version__}
        if output is not None:
            write_json(output.path / "identity.json", content)
            pq.write_table(pa.table(result.rows), output.path / "entries.parquet", compression="zstd")
            output.results_stand()
            write_identity_page(output.path, content)
    if output is not None:
        say(f"wrote {output.folder}; open {output.folder / 'report.html'}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 0


def _identify(args: argparse.Namespace) -> tuple[str, Any]:
    from camnet.association.settings import IdentitySettings
    from camnet.config.load import load_scenario
    from camnet.config.recorded import RecordedScenario
    from camnet.experiments.identify import identify
    from camnet.experiments.recorded import camera_views
    from camnet.experiments.recorded_replay import collect

    scenario = load_scenario(args.config, args.overrides, args.seed)
    if not isinstance(scenario, RecordedScenario):
        raise ConfigError(f"config {args.config!r}: kind is not 'recorded': give a recording with tracks")
    views = camera_views(
        scenario.read_cameras(),
        scenario.target_height_m,
        scenario.cameras.range_cap_m,
        scenario.cameras.near_m,
    )
    fixes = collect(scenario.read_tracks(), views, scenario.tracks.max_fix_interval_s)
    settings = IdentitySettings() if args.window is None else IdentitySettings(window_s=args.window)
    with progress_bar(1.0, "identifying", "", args.quiet) as advance:
        result = identify(fixes, settings, args.learn, args.appearance, scenario.seed, advance)
    return scenario.name, result


def _print(content: dict[str, Any]) -> None:
    rank1, intervals = content["rank1"], content["ci95"]
    print(
        f"{content['entries']} times seen again, {content['candidates_mean']:.1f} candidates on average; "
        f"chance {rank1['chance']:.3f}, last seen place {rank1['last_seen_place']:.3f}"
    )
    print(f"\n{'decided':12s} {'right':>6s} {'95 %':>15s} {'log loss':>9s} {'calibration error':>18s}")
    for name in ("at_once", "one_to_one", "revised"):
        low, high = intervals[name]
        error = content["calibration"][name]["ece_chosen"]
        print(
            f"{name:12s} {rank1[name]:6.3f}  {low:.3f} to {high:.3f} {content['log_loss'][name]:9.3f} {error:18.3f}"
        )
    low, high = intervals["revised_above_at_once"]
    print(f"revised above at once: 95 % within {low:+.3f} to {high:+.3f} (bootstrap over people)")
    print(f"\n{'running alone':18s} {'rank-1':>6s} {'IDF1':>6s} {'HOTA':>6s} {'AssA':>6s} {'switches':>9s}")
    for name, row in content["alone"].items():
        print(
            f"{name:18s} {row['rank1']:6.3f} {row['IDF1']:6.3f} {row['HOTA']:6.3f} {row['AssA']:6.3f} "
            f"{row['switches']:9.0f}"
        )

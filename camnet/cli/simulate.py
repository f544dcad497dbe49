"""``camnet simulate``: run a network and write its report."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cache_folder import cache_folder
from camnet.cli.arguments import whole
from camnet.cli.common import (
    add_common,
    add_place,
    add_scenario,
    add_seeds,
    overrides,
    progress_bar,
    say,
    warn,
)
from camnet.cli.output import Output, output_folder, print_json

__all__ = ["add_parser"]

_DESCRIPTION = """Simulate a camera network: agents fly, the target moves, its motion is learned while it is seen and
predicted while it is not, agents hand it over. Writes one folder: summary.json, handoffs.json, log.parquet and
events.parquet (camnet log shows both; pandas.read_parquet opens them), map.png, estimates.png, video.mp4, report.html.
Ctrl-C ends a run early and leaves a valid partial one, marked as such, without pictures (camnet report draws them);
SIGTERM ends it and leaves nothing.

  camnet simulate quickstart                              a shipped world (list them: camnet worlds)
  camnet simulate my_world.yaml --out runs/mine           a world or a recipe of your own
  camnet simulate quickstart --duration 60 --set targets.robot.motion.speed_mps=0.5
  camnet simulate quickstart --seeds 1-10 --out runs/ten  ten runs, with a table over all of them"""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "simulate",
        help="run a network and write its report",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_scenario(parser)
    add_common(parser, "runs/NAME-seedN, or a number after it if that is taken; with --seeds runs/NAME-seeds")
    add_seeds(parser, "run many seeds; a second call goes on where the first stopped")
    parser.add_argument("--jobs", type=whole(1, 256), metavar="N", help="processes for --seeds (default: 2)")
    add_place(parser)
    parser.add_argument(
        "--model", metavar="FILE", help="start from learned models that --save-model wrote (run.model)"
    )
    parser.add_argument("--save-model", type=Path, metavar="FILE", help="write what was learned (.npz)")
    parser.add_argument(
        "--instruments",
        action="store_true",
        help="also log and plot V, the norm of the weights, lambda_min(Psi) and the switching signals",
    )
    parser.add_argument("--no-video", action="store_true", help="write no video (about half of the time)")
    parser.add_argument("--no-report", action="store_true", help="write figures and log only, no pictures")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Load, run, write."""
    from camnet.config.load import load_scenario
    from camnet.config.models import Scenario
    from camnet.config.traffic import expand_traffic
    from camnet.errors import ConfigError

    # JSON is YAML: quotes keep any file name whole
    model = [] if args.model is None else [f"run.model={json.dumps(args.model)}"]
    wanted = ["run.instruments=true"] if args.instruments else []
    scenario = load_scenario(args.config, [*overrides(args), *model, *wanted], seed=args.seed)
    if isinstance(scenario, Scenario) and scenario.traffic is not None:
        say("preparing the traffic (kept for the next run) ...")
        scenario = expand_traffic(scenario, cache_folder())
    if args.seeds is not None:
        return _many(args, scenario)
    if args.jobs is not None:
        raise ConfigError(f"--jobs {args.jobs}: one run is one process; add --seeds for many")
    if args.on.ray:
        raise ConfigError("--on ray: one run is done on this machine; add --seeds for many")
    if isinstance(scenario, Scenario):
        return _network(args, scenario)
    from camnet.cli.simulate_recorded import run_and_write

    if args.save_model is not None:
        raise ConfigError(f"--save-model {args.save_model}: a recording's predictor keeps no such model")
    return run_and_write(args, scenario)


def _many(args: argparse.Namespace, scenario: Any) -> int:  # noqa: ANN401 - imported late
    from camnet.cli.simulate_many import run_and_write
    from camnet.config.models import Scenario
    from camnet.errors import ConfigError

    if not isinstance(scenario, Scenario):
        raise ConfigError(
            f"--seeds {args.seeds.text}: a recording is replayed once; its predictions have no seed"
        )
    if args.save_model is not None:
        raise ConfigError(f"--save-model {args.save_model}: with --seeds there is no one model to save")
    return run_and_write(
        args, scenario, Path(f"runs/{scenario.name}-seeds" if args.out is None else args.out)
    )


def _network(args: argparse.Namespace, scenario: Any) -> int:  # noqa: ANN401 - imported late
    from camnet.report import REPORT_FILES
    from camnet.simulation.models import check_saving
    from camnet.simulation.run import run_network

    if args.save_model is not None:
        check_saving(args.save_model, scenario.run.estimators)
    with output_folder(args, "simulate", f"{scenario.name}-seed{scenario.seed}", REPORT_FILES) as output:
        assert output is not None  # it has a default name
        with progress_bar(scenario.run.duration_s, "simulating", "s", args.quiet) as advance:
            result = run_network(
                scenario, scenario.seed, progress=advance, keep_models=args.save_model is not None
            )
        content = {
            "summary": result.summary,
            "seed": scenario.seed,
            "version": __version__,
            "config": scenario.model_dump(mode="json"),
        }
        _write(args, output, result, content)
    if args.json:
        print_json(content)
    else:
        _print_figures(result.summary)
    folder = output.folder
    drawn = not args.no_report and not result.interrupted
    say(f"wrote {folder}" + (f"; open {folder / 'report.html'}" if drawn else ""))
    if result.summary["dwell"]["broken"]:
        warn(
            f"in {result.summary['dwell']['broken']} intervals a certificate's condition was met and the error "
            "exceeded its level all the same; an assumption of the certificate does not hold here"
        )
    if result.interrupted:
        warn(f"interrupted after {result.summary['simulated_s']:.1f} s: the run is partial and marked so")
    return 0


def _write(args: argparse.Namespace, output: Output, result: Any, content: dict[str, Any]) -> None:  # noqa: ANN401
    """Write the results first; what is drawn or kept elsewhere comes after, and loses none of them when it fails."""
    from camnet.estimation.persistence import save_models
    from camnet.simulation.run_files import write_run

    write_run(output.path, content, result.handoffs, result.log, result.events)
    output.results_stand()
    if args.save_model is not None:
        save_models(args.save_model, result.learned)
    if not args.no_report and not result.interrupted:
        from camnet.report.write import write_all

        with progress_bar(1.0, "drawing", "", args.quiet) as advance:
            write_all(output.path, video=not args.no_video, progress=lambda k, n: advance(k / n))


def _print_figures(summary: dict[str, Any]) -> None:
    done, delay = summary["handoffs"], summary["reacquisition_delay_s"]
    print(f"time in view             {summary['time_in_view']:8.1%}")
    print(f"handoffs completed       {done['completed']:5d} of {done['attempted']}")
    print(f"reacquisition delay      {_number(delay['mean'])} s mean, {_number(delay['p95'])} s 95 %")
    print("position RMSE (m)            seen  unseen lap 1  unseen lap 3 on")
    for name, row in {summary["estimator_in_charge"]: summary, **summary["baselines"]}.items():
        rmse = row["position_rmse_m"]
        figures = f"{_number(rmse['seen'])}      {_number(rmse['unseen_first_lap'])}         {_number(rmse['unseen'])}"
        print(f"  {name:22s} {figures}")
    print(f"real-time factor         {summary['real_time_factor']:8.1f}")


def _number(value: float | None) -> str:
    return "     –  " if value is None else f"{value:8.3f}"

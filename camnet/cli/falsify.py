"""``camnet falsify``: hostile targets try to break the certificates of a world."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import whole
from camnet.cli.certify_options import check_learning
from camnet.cli.common import add_common, add_place, positive, progress_bar, say
from camnet.cli.falsify_closed import EPILOG, add_closed_loop, refuse_closed_options, run_closed
from camnet.cli.inputs import learned_model, world_of
from camnet.cli.output import output_folder, print_json, write_json

__all__ = ["add_parser"]

_DESCRIPTION = """Simulate targets that are as hostile as their class allows: random, bang-bang, and optimised by
differential evolution. A certificate that is right is never broken: every violation is an error (exit status 1).
The closest approach says how much of the bound such targets use up; near 1 means a sharp bound.

  camnet falsify quickstart --learn --trials 10000
  camnet falsify patrol --model-error 0.05

These attack the abstraction that the certificate was computed from. With --closed-loop the whole system flies instead:
agents, wind, noise, several targets at once, and what is judged is what the cameras saw.
Exit status: 0 nothing broken, 1 a promise is broken, 2 bad input."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "falsify",
        help="adversarial simulation against the certificates",
        description=_DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("config", help="a world file, a folder with world.yaml, or a shipped world's name")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides", help="change one setting"
    )
    parser.add_argument(
        "--duration",
        type=positive,
        metavar="S",
        help="length of the run that --learn simulates, and of a flight of the closed loop, s",
    )
    parser.add_argument(
        "--trials",
        type=whole(1, 10_000_000),
        metavar="N",
        help="simulated targets, or flights of the closed loop (default 1000)",
    )
    parser.add_argument("--learn", action="store_true", help="learn the motion in simulation first")
    parser.add_argument(
        "--model", metavar="FILE", type=Path, help="a model that camnet certify --learn saved"
    )
    parser.add_argument(
        "--model-error", type=positive, metavar="MPS", help="stated velocity error of the model, m/s"
    )
    parser.add_argument(
        "--jobs", type=whole(1, 1024), metavar="J", help="processes (default 1); figures do not change"
    )
    add_place(parser)
    add_closed_loop(parser)
    add_common(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Load, attack, write."""
    if args.closed_loop:
        return run_closed(args)
    from camnet.experiments.falsify import falsify_world
    from camnet.experiments.learned_model import save_models

    refuse_closed_options(args)
    check_learning(args)
    trials = 1000 if args.trials is None else args.trials
    scenario = world_of(args)
    with output_folder(args, "falsify") as output:
        model = learned_model(args, scenario)
        with (
            progress_bar(1.0, "attacking", "", args.quiet) as advance,
            args.on.workers(args.jobs or 1) as crew,
        ):
            result = falsify_world(scenario, trials, scenario.seed, model, args.model_error, advance, crew)
        content = {"world": scenario.name, **result, "version": __version__}
        if output is not None:
            write_json(output.path / "result.json", content)
            if model:
                save_models(model, output.path)
    if output is not None:
        say(f"wrote {output.folder}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 1 if any(content["violations"].values()) else 0


def _print(content: dict[str, Any]) -> None:
    print(f"{content['world']}: {content['trials']} hostile targets")
    for name, count in content["violations"].items():
        closest = content["closest_fraction"][name]
        words = "claims nothing here" if closest is None else f"closest approach {closest:.3f} of the bound"
        print(f"  {name:8s} {count} violations, {words}")
    if content["lost"]:
        print(
            f"  {content['lost']} targets stayed out of view for longer than allowed (after exits not certified)"
        )
    for e in content.get("exits", []):
        print(
            f"    from {e['from']:12s} {e['verdict']:14s} closest {e['closest_fraction']:.3f} of {e['bound_m']:.3f} m "
            f"after {e['at_s']:.1f} s, lost {e['lost']} of {e['trials']}"
        )
    real = content.get("estimator")
    if real and real["gaps"]:
        print(
            f"  real estimator: {real['gaps']} gaps after the first lap, {real['violations']} beyond the bound, "
            f"closest {real['closest_fraction']:.3f}"
        )

"""The part of ``camnet falsify`` that flies the whole system against hostile targets."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import non_negative, positive, whole
from camnet.cli.common import progress_bar, say
from camnet.cli.inputs import learned_model, world_of
from camnet.cli.output import output_folder, print_json, write_json
from camnet.processes.place import LOCAL

__all__ = ["EPILOG", "add_closed_loop", "refuse_closed_options", "run_closed"]

EPILOG = """In the closed loop:

  camnet falsify patrol --closed-loop --out runs/attack
  camnet falsify patrol --closed-loop --replay runs/attack/attack.json
  camnet falsify mobile_certified --closed-loop --learn
  camnet falsify two_vehicles --closed-loop --model-error 0.15
  camnet falsify WORLD --closed-loop --promise certificate.json
  camnet falsify patrol --closed-loop --violate speed=-20%

They attack the promise that certify makes now, fly the worst attack again, learn the motion first (agents need
it, or a stated model error on roads), attack an old promise, and fly a world in which one assumption is false.

The attacker chooses start, direction, turns, speeds, stops and offset of every target, the wind's direction, and the
seed of noise and gusts. The judge is the truth alone: which target was in some camera's view when.

--promise takes a certificate.json, or a JSON object with some of these keys:
  unseen_max_m, unseen_max_s    longest stretch out of view
  error                         bound of the estimate's error when a target is seen again: an object with some of
                                initial_m, growth_mps, max_m: initial_m + growth_mps x time, at most max_m
  targets_at_once               for how many targets at the same time it holds (default: any number)
  into_first_view               false: the stretch before the first view does not count
  after_laps, after_s           from when on it holds
  error_after_laps              from when on the bound of the error holds, if that is later
  world, note                   of which world it is, and words
With --out: report.html, result.json, and attack.json, the worst attack."""

#: options that only the closed loop uses
_OWN = ("promise", "time_limit", "violate", "replay", "targets", "stop_s", "keep_going")


def _violation(text: str) -> tuple[str, float]:
    from camnet.experiments.closed_loop.arena import parse_violation

    try:
        return parse_violation(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_closed_loop(parser: argparse.ArgumentParser) -> None:
    """Add the options of the closed loop."""
    group = parser.add_argument_group("closed loop")
    group.add_argument(
        "--closed-loop", action="store_true", help="fly the whole system; the truth is the judge"
    )
    group.add_argument(
        "--promise", metavar="FILE", type=Path, help="certificate.json or a promise of one's own to attack"
    )
    group.add_argument("--time-limit", type=positive, metavar="S", help="stop searching after this long, s")
    group.add_argument(
        "--targets",
        type=whole(1, 1000),
        metavar="N",
        help="targets at the same time (default: as many as the world has and the promise speaks of)",
    )
    group.add_argument(
        "--stop-s", type=non_negative, metavar="S", help="longest time that targets stand still (default 0)"
    )
    group.add_argument(
        "--violate",
        action="append",
        type=_violation,
        metavar="WHAT",
        help="falsify an assumption: speed=+20%%, footprint=-30%%, wind=x2, promise=-20%% (repeatable)",
    )
    group.add_argument(
        "--keep-going", action="store_true", help="go on after a violation: count them, look for the worst"
    )
    group.add_argument("--replay", metavar="FILE", type=Path, help="fly an attack of an earlier --out again")


def refuse_closed_options(args: argparse.Namespace) -> None:
    """Refuse options of the closed loop without it (ConfigError)."""
    from camnet.errors import ConfigError

    for name in _OWN:
        if getattr(args, name) not in (None, False):
            raise ConfigError(f"--{name.replace('_', '-')}: is about the closed loop; add --closed-loop")


def run_closed(args: argparse.Namespace) -> int:
    """Attack, or replay, and write; 1 if the promise is broken."""
    from camnet.report.falsify import write_attack_page

    _refuse_unused(args)
    with output_folder(args, "falsify") as output:
        content = _replay(args) if args.replay is not None else _attack(args)
        content["version"] = __version__
        if output is not None:
            write_json(output.path / "result.json", content)
            if content.get("attack") is not None:
                write_json(output.path / "attack.json", content["attack"])
            output.results_stand()
            write_attack_page(output.path / "report.html", content)
    if output is not None:
        say(f"wrote {output.folder}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 1 if content["violations"] else 0


def _refuse_unused(args: argparse.Namespace) -> None:
    from camnet.errors import ConfigError

    if args.replay is not None:
        used = (
            "promise",
            "time_limit",
            "violate",
            "targets",
            "stop_s",
            "keep_going",
            "learn",
            "model",
            "jobs",
            "on",
        )
        for name in (*used, "trials", "model_error", "duration", "overrides", "seed"):
            if getattr(args, name) not in (None, False, [], LOCAL):
                option = "set" if name == "overrides" else name.replace("_", "-")
                raise ConfigError(f"--{option}: the attack of --replay is fixed already; leave it out")
    if args.promise is not None:
        for name in ("learn", "model", "model_error"):
            if getattr(args, name) not in (None, False):
                option = name.replace("_", "-")
                raise ConfigError(f"--{option} and --promise: the promise is given already; leave one out")


def _attack(args: argparse.Namespace) -> dict[str, Any]:
    from camnet.errors import ConfigError
    from camnet.experiments.closed_loop.attack import falsify_closed_loop, prepare
    from camnet.experiments.closed_loop.claims import read_claims

    scenario = world_of(args)
    if args.promise is not None:
        claims, world = read_claims(args.promise)
        if world is not None and world != scenario.name:
            raise ConfigError(f"--promise {args.promise}: is of world {world!r}, not of {scenario.name!r}")
    else:
        claims = _certified_now(args, scenario)
    changes: dict[str, float] = dict(args.violate or [])
    attack = prepare(scenario, claims, changes, args.targets, args.stop_s or 0.0)
    trials = 1000 if args.trials is None else args.trials
    with progress_bar(trials, "flying", "flights", args.quiet) as advance:
        found = falsify_closed_loop(
            attack,
            trials,
            scenario.seed,
            jobs=args.jobs or 1,
            place=args.on,
            time_limit_s=args.time_limit,
            stop_when_broken=not args.keep_going,
            progress=lambda f: advance(f.flown, "" if f.outcome is None else f"worst {f.outcome.share:.3f}"),
        )
    return {"world": scenario.name, **found}


def _certified_now(args: argparse.Namespace, scenario: Any) -> Any:  # noqa: ANN401 - imported late
    """Return what the certificate of the world promises now."""
    from camnet.experiments.certify_world import certify_world
    from camnet.experiments.closed_loop.claims import claims_of_report
    from camnet.experiments.closed_loop.error_bounds import with_error_bounds

    model = learned_model(args, scenario)
    served = args.targets
    report = certify_world(scenario, model, model_error_mps=args.model_error, at_once=served).report
    return with_error_bounds(claims_of_report(report), report, scenario, model, args.model_error)


def _replay(args: argparse.Namespace) -> dict[str, Any]:
    from camnet.errors import ConfigError
    from camnet.experiments.closed_loop.attack import read_attack, replay

    attack, plan, before = read_attack(args.replay)
    name = world_of(args).name
    if name != attack.scenario.name:
        raise ConfigError(f"--replay {args.replay}: is of world {attack.scenario.name!r}, not of {name!r}")
    figures = replay(attack, plan).as_dict()
    return {
        "world": name,
        "replayed": os.fspath(args.replay),
        "same": figures == before,
        "violations": int(bool(figures["broken"])),
        "broken": figures["broken"],
        "closest_fraction": figures["share"],
        "worst": figures["worst"],
        "plan": plan.as_dict(),
    }


_FIGURES = {
    "unseen_m": ("out of view", "m"),
    "unseen_s": ("out of view", "s"),
    "unseen_way_m": ("out of view between two regions", "m"),
    "error_m": ("error", "m"),
}


def _print(content: dict[str, Any]) -> None:
    if "replayed" in content:
        print(f"{content['world']}: replayed; " + ("same figures" if content["same"] else "OTHER FIGURES"))
    else:
        end = ", out of time" if content["out_of_time"] else ""
        print(
            f"{content['world']}: {content['trials']} flights{end}, {content['stretches']} stretches out of view, "
            f"{content['violations']} flights break the promise"
        )
    for name, w in content["worst"].items():
        words, unit = _FIGURES[name]
        promised = "nothing promised" if w["promised"] is None else f"promised {w['promised']:.2f} {unit}"
        margin = "" if w["margin"] is None else f", margin {w['margin']:.2f} {unit}"
        print(
            f"  {words} {w['value']:.2f} {unit}: {promised}{margin} ({w['target']} from {w['from_s']:.1f} s)"
        )
    for name, used in content.get("assumptions", {}).items():
        print(f"  {name}: {used:.2f} of what is assumed")
    if content.get("nearest_to_breaking"):
        print(f"  nearest to breaking: {content['nearest_to_breaking']}")

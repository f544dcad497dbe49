"""``camnet evaluate``: agents against each other on common seeds, with confidence intervals."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet.cli.arguments import whole
from camnet.cli.common import add_common, add_place, add_set, positive, progress_bar, say
from camnet.cli.output import print_json, resumed_folder, write_json

__all__ = ["add_parser"]

_DESCRIPTION = """Play agents on worlds and compare them.

Every agent plays the same seeds on every world, and so does a blind team (cameras off). `normalised` is 0 for that team
and 1 for a bound: all targets seen while they are in a region, every entry at once, no effort. The table has means with
95 % bootstrap intervals; each agent is compared with --reference seed by seed (sign-flip permutation test). Agents are
built-in names (learned, learned_shared, adate, ekf, planner, planner_oracle, oracle, auction, nearest, static, random)
or policy files that `camnet train` wrote (*.npz).

  camnet evaluate --world quickstart --agents learned,ekf,nearest --episodes 20
  camnet evaluate --world quickstart,loop_8 --agents learned,runs/train/policy.npz --episodes 200 --out runs/scores
  camnet evaluate --world camnet/Handoff-Failures-v0 --agents learned,auction,ekf --episodes 50

With --out: result.json, table.md, report.html, scores_WORLD.png, episodes/ (one line an episode; the same command
goes on where it was stopped), and with --videos the best and worst episode of the reference on each world."""


_FILES = ("result.json", "table.md", "report.html", "scores_*.png", "*-seed*.mp4", "episodes/*.jsonl")


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "evaluate",
        help="score agents on worlds, on common seeds, with confidence intervals",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--world",
        default="quickstart",
        metavar="W,W",
        help="worlds, or registered ids such as camnet/Handoff-Failures-v0, comma-separated (default quickstart)",
    )
    parser.add_argument(
        "--agents",
        default="learned,ekf,nearest",
        metavar="A,A",
        help="agents, comma-separated (default learned,ekf,nearest)",
    )
    parser.add_argument(
        "--episodes", type=whole(1, 100_000), default=20, metavar="N", help="episodes a world (default 20)"
    )
    parser.add_argument(
        "--cycles",
        type=whole(1, 1_000_000),
        default=1200,
        metavar="N",
        help="decisions an episode (default 1200: 120 s at 10 Hz)",
    )
    parser.add_argument(
        "--reference", metavar="A", help="compared with the others (default: the first agent)"
    )
    parser.add_argument(
        "--back-end",
        choices=("auto", "pybullet", "batch"),
        default="auto",
        help="physics (default auto: the batch back end where it has everything that is asked for)",
    )
    parser.add_argument("--jobs", type=whole(1, 256), default=2, metavar="N", help="processes (default 2)")
    add_place(parser)
    parser.add_argument(
        "--cutoff", type=positive, default=2.0, metavar="M", help="cutoff of OSPA and GOSPA, m (default 2)"
    )
    parser.add_argument(
        "--score",
        choices=("v0", "v1"),
        help="handoffs that count: v1 every entry into a region, by the truth; v0 only those of targets that were seen "
        "before (default v1; v0 for ids that end so)",
    )
    add_set(parser)
    parser.add_argument("--videos", action="store_true", help="film the reference's best and worst episode")
    add_common(parser, "runs/evaluate-seedN; the same command goes on there")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Play, compare, write."""
    from camnet.evaluation.evaluate import evaluate
    from camnet.evaluation.table import markdown, write_tables

    plan = _plan(args)
    # one folder for one seed, so that the same command goes on; episodes of other settings are told apart there
    out = f"runs/evaluate-seed{args.seed or 0}" if args.out is None else args.out
    with resumed_folder(out, "evaluate", _FILES, args.force) as folder:
        with progress_bar(100, "evaluate", "%", args.quiet) as advance:
            content = evaluate(plan, folder, lambda share: advance(100 * share))
        write_json(folder / "result.json", content)
        write_tables(folder, content, {})  # the films may fail
        if args.videos:
            write_tables(folder, content, _films(args, plan, folder, content))
    if args.json:
        print_json(content)
    else:
        print(markdown(content))
    say(f"wrote {folder}; open {folder / 'report.html'}")
    return 0


def _plan(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.agents import estimator_of
    from camnet.errors import ConfigError
    from camnet.evaluation.evaluate import Plan
    from camnet.evaluation.play import Match

    worlds, agents = _names(args.world, "--world"), _names(args.agents, "--agents")
    for agent in agents:
        estimator_of(agent)
    reference = args.reference or agents[0]
    if reference not in agents:
        raise ConfigError(f"--reference {reference!r}: is not among --agents {args.agents}")
    played = agents if "blind" in agents else [*agents, "blind"]
    matches = [
        Match(
            agent, world, args.cycles, args.cutoff, tuple(args.overrides), (("score", _score(args, world)),)
        )
        for world in worlds
        for agent in played
    ]
    for world in worlds:
        next(m for m in matches if m.world == world).environment().close()
    start = 1000 * ((args.seed or 0) + 1)
    seeds = tuple(range(start, start + args.episodes))
    return Plan(tuple(matches), seeds, reference, args.back_end, args.jobs, args.seed or 0, args.on)


def _score(args: argparse.Namespace, world: str) -> str:
    """Return which entries count as handoffs on a world."""
    return str(args.score or ("v0" if world.startswith("camnet/") and world.endswith("-v0") else "v1"))


def _names(text: str, option: str) -> list[str]:
    from camnet.errors import ConfigError

    names = [part.strip() for part in text.split(",") if part.strip()]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"{option} {text!r}: give different names with commas between them")
    return names


def _films(
    args: argparse.Namespace,
    plan: Any,  # noqa: ANN401 - imported late
    folder: Path,
    content: dict[str, Any],
) -> dict[str, list[Path]]:
    """Film the best and the worst episode of the reference on every world."""
    import numpy as np

    from camnet.evaluation.evaluate import returns_of
    from camnet.evaluation.films import film_episode

    films: dict[str, list[Path]] = {}
    for entry in content["worlds"]:
        match = next(m for m in plan.matches if m.world == entry["world"] and m.agent == plan.reference)
        returns = returns_of(plan, folder, match)
        for word, index in (("best", int(np.argmax(returns))), ("worst", int(np.argmin(returns)))):
            path = folder / f"{Path(entry['world']).stem}-{word}-seed{plan.seeds[index]}.mp4"
            say(f"filming {path.name}")
            film_episode(match, plan.seeds[index], path)
            films.setdefault(entry["world"], []).append(path)
    return films

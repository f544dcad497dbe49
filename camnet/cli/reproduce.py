"""``camnet reproduce``: published and recorded experiments, with their tables and figures."""

from __future__ import annotations

import argparse
import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import whole
from camnet.cli.common import add_common, add_place, add_seeds, named_seeds, progress_bar, say
from camnet.cli.output import output_folder, print_json, write_json
from camnet.errors import ConfigError

__all__ = ["EXPERIMENTS", "Experiment", "add_parser"]


@dataclass(frozen=True)
class Experiment:
    """One experiment: where its ``run(seeds=, out_dir=, seed=, progress=[, data=])`` lives and what it shows.

    ``takes_images``: its ``run`` has ``images=``, for rendered input; ``takes_place``: ``jobs=`` and ``place=``.
    The module has ``print_table(result)`` too; ``function`` names its ``run`` where that is something else.
    """

    module: str
    words: str
    seeds: int = 1
    needs_data: bool = False
    function: str = "run"
    takes_data: bool = False
    one_run: bool = False
    takes_images: bool = False
    takes_place: bool = False


EXPERIMENTS = {
    "certified-layout": Experiment(
        "camnet.experiments.certified_layout",
        "a layout that the learned certificate holds for, over 100 runs",
        100,
    ),
    "certified-mobile": Experiment(
        "camnet.experiments.certified_layout",
        "a network of quadrotors that the learned certificate holds for, over 30 runs",
        30,
        function="run_mobile",
    ),
    "motion-learning": Experiment(
        "camnet.experiments.motion_learning",
        "a robot seen now and then by a fixed camera (parikh2018, VII-A)",
        10,
    ),
    "road-network": Experiment(
        "camnet.experiments.road_network",
        "one quadrotor, two robots that turn at random, one shared memory (parikh2018, VII-B)",
        5,
    ),
    "gap-remedies": Experiment(
        "camnet.experiments.gap_remedies",
        "remedies of the gap problem alone and combined, on four worlds (--data for the recorded one)",
        3,
        takes_data=True,
    ),
    "distance-observers": Experiment(
        "camnet.experiments.distance_observers",
        "distances to a checkerboard's corners from a moving camera (bell2019, ch. 3)",
        15,
        takes_images=True,
        takes_place=True,
    ),
    "key-frame-position": Experiment(
        "camnet.experiments.key_frame_position",
        "a camera's position over 250 m, a landmark once a loop (bell2019, ch. 4)",
        5,
        takes_images=True,
        takes_place=True,
    ),
    "moving-target": Experiment(
        "camnet.experiments.moving_target",
        "a target of unknown size that moves, seen now and then (bell2019, ch. 5)",
        6,
        takes_place=True,
    ),
    "gps-denied": Experiment(
        "camnet.experiments.gps_denied",
        "handoffs to and from agents that dead-reckon in outages of 60 s",
        11,
    ),
    "unknown-size": Experiment(
        "camnet.experiments.unknown_size",
        "the size of a vehicle that an agent follows, by the agent's own motion",
        10,
    ),
    "pedestrians": Experiment(
        "camnet.experiments.pedestrians",
        "real people, ETH/UCY: 3.2 s seen, 4.8 s predicted (--data)",
        needs_data=True,
        one_run=True,
    ),
    "adate-visual": Experiment(
        "camnet.experiments.adate_visual",
        "a correlation tracker with AdaTE's prediction fed back (li2019; --data SEQUENCE)",
        needs_data=True,
        function="reproduce",
        one_run=True,
    ),
    "adate-navigation": Experiment(
        "camnet.experiments.adate_navigation", "plans around obstacles through timed waypoints (li2019)", 200
    ),
    "adate-table": Experiment(
        "camnet.experiments.adate_table", "AdaTE beside Kalman filters, six groups (li2019)", 20
    ),
}


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    listing = "\n".join(f"  {name:18s} {experiment.words}" for name, experiment in EXPERIMENTS.items())
    parser = commands.add_parser(
        "reproduce",
        help="published experiments: tables and figures",
        description=f"Run a published experiment again and set our figures beside the published ones.\n\n{listing}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "experiment", choices=EXPERIMENTS, metavar="EXPERIMENT", help="one of the names above"
    )
    add_seeds(parser, "seeds of the runs (default: as many as were published)")
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="folder of recorded inputs, where one is needed"
    )
    parser.add_argument(
        "--images", action="store_true", help="rendered images as input, where an experiment has them"
    )
    parser.add_argument(
        "--jobs",
        type=whole(1, 256),
        metavar="N",
        help="workers, where an experiment's runs can be shared (default: 2)",
    )
    add_place(parser)
    add_common(parser, "runs/reproduce-EXPERIMENT, or a number after it if that is taken")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run one experiment and write its folder."""
    experiment = EXPERIMENTS[args.experiment]
    options: dict[str, Any] = _seeds(args, experiment)
    if experiment.needs_data or (experiment.takes_data and args.data is not None):
        if args.data is None:
            raise ConfigError(f"{args.experiment} replays recorded inputs: give their folder with --data DIR")
        if not args.data.is_dir():
            raise ConfigError(f"--data {args.data}: no such folder; give that of the recorded inputs")
        options["data"] = args.data
    elif args.data is not None and not experiment.takes_data:
        raise ConfigError(f"--data {args.data}: {args.experiment} reads no recorded inputs; leave it out")
    if args.images:
        if not experiment.takes_images:
            raise ConfigError(f"--images: {args.experiment} has no rendered input; leave it out")
        options["images"] = True
    options |= _place(args, experiment)
    module = importlib.import_module(experiment.module)
    with output_folder(args, "reproduce", f"reproduce-{args.experiment}") as output:
        assert output is not None  # it has a default name
        with progress_bar(1.0, args.experiment, "", args.quiet) as advance:
            result = getattr(module, experiment.function)(out_dir=output.path, progress=advance, **options)
        content = {**result, "version": __version__}
        write_json(output.path / "result.json", content)
    if args.json:
        print_json(content)
    else:
        module.print_table(result)
    say(f"wrote {output.folder}")
    return 0


def _place(args: argparse.Namespace, experiment: Experiment) -> dict[str, Any]:
    """Return who does the runs, where that can be said."""
    if experiment.takes_place:
        return {"jobs": args.jobs or 2, "place": args.on}
    able = ", ".join(name for name, one in EXPERIMENTS.items() if one.takes_place)
    if args.on.ray:
        raise ConfigError(f"--on ray: {args.experiment} is done on this machine; shared can be {able}")
    if args.jobs is not None:
        raise ConfigError(f"--jobs {args.jobs}: {args.experiment} has no such choice; shared can be {able}")
    return {}


def _seeds(args: argparse.Namespace, experiment: Experiment) -> dict[str, int]:
    """Return the number of seeds and the first one."""
    if args.seeds is None:
        return {"seeds": experiment.seeds, "seed": args.seed or 0}
    if experiment.one_run:
        raise ConfigError(f"--seeds {args.seeds.text}: {args.experiment} is one run; its data have no seeds")
    numbers = named_seeds(args)
    if numbers[-1] - numbers[0] >= len(numbers):
        raise ConfigError(
            f"--seeds {args.seeds.text}: experiments take consecutive seeds; give a range such as "
            f"{numbers[0]}-{numbers[0] + len(numbers) - 1}, or a count"
        )
    return {"seeds": len(numbers), "seed": numbers[0]}

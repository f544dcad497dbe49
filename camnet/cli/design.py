"""``camnet design``: the fewest cameras that certify a road network, and the smallest repairs of one that exists."""

from __future__ import annotations

import argparse
import csv
import math
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import whole
from camnet.cli.common import add_common, positive, progress_bar, say
from camnet.cli.design_world import add_world_options, run_world
from camnet.cli.inputs import read_tracks
from camnet.cli.output import Output, output_folder, print_json, write_json
from camnet.cli.target_arguments import add_pixel_class, add_target_class
from camnet.cli.traffic import kept, print_check
from camnet.storage.whole_file import whole_file

__all__ = ["add_parser"]

_DESCRIPTION = """Design a network of cameras over roads, over recorded ways of people, or on the walls of a site.

  camnet design --roads NET.xml --unseen-max-m 600       the fewest cameras: nobody drives more than 600 m out of view
  camnet design --roads NET.xml --off-max 120            the same for 120 s, at --v-lo m/s at least while moving
  camnet design --roads NET.xml --poles POLES.csv        the same on given poles (name,x,y[,cost]): the cheapest set
  camnet design --roads NET.xml --count 60               60 cameras: the shortest time out of view
  camnet design --roads NET.xml --repair CAMERAS.csv     single changes that certify each uncertified transition
  camnet design --tracks people.csv --off-max 20         nobody of a track set (CSV, or ETH/UCY .txt) unseen for 20 s
  camnet design WORLD --mounts walls:2,5 --off-max 30    cameras on a site's walls, the cheapest of a catalogue
  camnet design --repair WORLD --off-max 30              which cameras of a world to turn, move or add, the cheapest way

A world's targets are followed along all their ways, as camnet certify does; the result is a world file, certified anew.
Roads are read lane by lane, with the turning paths over junctions: a way counts as seen only where one camera sees its
whole width. The lower bound says how many cameras any choice among the same candidates needs; --effort goes into a
better choice and a better bound (integer programming; above 3000 candidates linear programming alone)."""

#: options by the kinds of design that use them; elsewhere they are refused by name
_USED_BY: dict[str, tuple[str, ...]] = {
    "origin": ("tracks", "world"),
    "objective": ("roads", "tracks", "world"),
    "poles": ("roads", "tracks"),
    "repair": ("repair",),
    "spacing": ("roads", "repair", "tracks"),
    "count": ("roads", "tracks", "world"),
    "footprint": ("roads", "repair", "tracks"),
    "most": ("repair",),
    "mounts": ("world",),
    "catalogue": ("world",),
    "existing": ("world",),
    "turn_price": ("world",),
    "move_price": ("world",),
    "budget": ("world",),
    "aim_step": ("world",),
    "survive": ("world",),
    "detections": ("world",),
    "private": ("world",),
    "mount_tolerance": ("world",),
    "overrides": ("world",),
    "v_lo": ("roads", "repair", "world"),
    "v_max": ("roads", "repair", "world"),
    "unseen_max_m": ("roads", "repair", "world"),
    "check": ("roads",),
    "stop_s": ("roads", "repair"),
    "on_min": ("roads", "repair"),
    "model_error": (),
    "initial_error": (),
}
_OPTION = {"overrides": "--set"}
_KINDS = {
    "roads": "--roads NET",
    "repair": "--roads NET --repair",
    "tracks": "--tracks FILE",
    "world": "a world file",
}


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "design",
        help="place the fewest cameras that certify a road network; repair one",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "config",
        nargs="?",
        metavar="WORLD",
        help="a world file, a folder with world.yaml, or a shipped world's name",
    )
    source.add_argument("--roads", metavar="NET", type=Path, help="SUMO network of the roads")
    source.add_argument(
        "--tracks", metavar="FILE", type=Path, help="recorded tracks: .csv, .csv.gz or ETH/UCY .txt"
    )
    parser.add_argument(
        "--origin", metavar="LAT,LON,ALT", help="local frame of tracks or world, degrees and m"
    )
    parser.add_argument(
        "--objective",
        choices=("fewest", "margin", "cheapest"),
        help="fewest cameras; largest margin in time (with --count, or with the fewest); cheapest (poles with costs)",
    )
    parser.add_argument(
        "--poles", metavar="CSV", type=Path, help="candidate places (default: junctions and roadsides)"
    )
    parser.add_argument(
        "--repair",
        metavar="FILE",
        type=Path,
        help="with --roads the cameras that stand, .csv or SUMO .add.xml; alone a world file: its fixed cameras are "
        "turned, moved and added to until it is certified",
    )
    parser.add_argument(
        "--spacing",
        type=positive,
        metavar="M",
        help="of candidates, m (default: 50 along roads, half a view on tracks)",
    )
    parser.add_argument(
        "--count", type=whole(1, 100_000), metavar="K", help="use at most K cameras, with the largest margin"
    )
    parser.add_argument(
        "--footprint", type=positive, metavar="M", help="side of a camera's view, m (default 30)"
    )
    parser.add_argument(
        "--most",
        type=whole(0, 100_000),
        metavar="N",
        help="--repair: look for changes of poses at N transitions (default 10)",
    )
    add_pixel_class(parser, "a world's targets count as seen with the pixels of this class (default: detect)")
    parser.add_argument(
        "--time-limit",
        type=positive,
        metavar="S",
        help="end the solver early after this much processor time, s (default: none; the answer may then differ from "
        "machine to machine)",
    )
    parser.add_argument(
        "--effort",
        type=positive,
        default=1.0,
        metavar="N",
        help="of the solver, counted in steps, as a multiple of the usual one (default 1)",
    )
    add_world_options(parser)
    add_target_class(parser)
    add_common(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Load, place or repair, write."""
    args = _of_world(args)
    _refuse_unused(args)
    if args.config is not None:
        return run_world(args)
    with output_folder(args, "design") as output:
        with progress_bar(1.0, "placing", "", args.quiet) as advance:
            content, designed = _design(args, advance)
        content = {**content, "version": __version__}
        if output is not None:
            _write(output, args, content, designed)
    if output is not None:
        say(f"wrote {output.folder}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 0 if content["certified"] and kept(content) else 1


def _of_world(args: argparse.Namespace) -> argparse.Namespace:
    """Take a world file that is to be repaired for the world."""
    from camnet.errors import ConfigError

    args.repair_world = args.config is None and args.roads is None and args.tracks is None
    if not args.repair_world:
        return args
    if args.repair is None:
        raise ConfigError(
            "give a world file, --roads NET, --tracks FILE or --repair WORLD: what is to be designed"
        )
    if args.existing not in (None, "movable"):
        raise ConfigError(
            f"--existing {args.existing}: --repair turns and moves the cameras that stand; leave it out"
        )
    args.config, args.repair, args.existing = str(args.repair), None, "movable"
    return args


def _refuse_unused(args: argparse.Namespace) -> None:
    """Refuse options that the kind of design does not use."""
    from camnet.errors import ConfigError

    if args.pixel_class is not None and args.config is None:
        raise ConfigError(
            f"--class {args.pixel_class}: over --roads and on --tracks cameras are square footprints without "
            "intrinsics, so they have no pixels per metre; give --footprint"
        )
    kind = "world" if args.config is not None else ("tracks" if args.tracks is not None else "roads")
    if kind == "roads" and args.repair is not None:
        kind = "repair"
    for name, kinds in _USED_BY.items():
        value = getattr(args, name)
        if value is None or kind in kinds:
            continue
        option = _OPTION.get(name, "--" + name.replace("_", "-"))
        given = value[0] if isinstance(value, list) else value
        if not kinds:
            raise ConfigError(
                f"{option} {given}: is about estimates, which a design does not ask for; leave it out"
            )
        where = ", ".join(_KINDS[k] for k in kinds)
        raise ConfigError(
            f"{option} {given}: does not apply to {_KINDS[kind]}, only to {where}; leave it out"
        )


def _design(args: argparse.Namespace, advance: Any) -> tuple[dict[str, Any], Any]:  # noqa: ANN401
    """Return the report, and the design with its map (None for repairs)."""
    from camnet.certification.transitions import RoadTargetClass
    from camnet.experiments.design_roads import design_roads
    from camnet.experiments.design_tracks import design_tracks
    from camnet.experiments.repair_roads import repair_roads

    shared: dict[str, Any] = {
        "footprint_m": args.footprint or 30.0,
        "effort": args.effort,
        "time_limit_s": math.inf if args.time_limit is None else args.time_limit,
        "progress": advance,
        "seed": args.seed or 0,
    }
    aim: dict[str, Any] = {"poles": args.poles, "count": args.count, "objective": args.objective}
    if args.tracks is not None:
        tracks = read_tracks(args)
        limits = {
            "off_max_s": args.off_max or 20.0,
            "extent_m": args.extent or 0.3,
            "spacing_m": args.spacing,
        }
        designed = design_tracks(tracks, **limits, **shared, **aim)
        return designed.report, designed
    v_lo = args.v_lo or 5.0
    target = RoadTargetClass(v_lo, args.v_max or max(14.0, v_lo), args.extent or 1.0, args.stop_s or 0.0)
    roads: dict[str, Any] = {
        "off_max_s": args.off_max or (None if args.unseen_max_m else 120.0),
        "unseen_max_m": args.unseen_max_m,
        "on_min_s": args.on_min or 0.0,
        "spacing_m": args.spacing or 50.0,
    }
    most = 10 if args.most is None else args.most
    if args.repair is not None:
        return repair_roads(
            args.roads,
            args.repair,
            target,
            **roads,
            **shared,
            most_poses=most,
        ), None
    own = args.v_max is None
    designed = design_roads(args.roads, target, **roads, **shared, **aim, traffic=args.check, own_limits=own)
    return designed.report, designed


def _write(output: Output, args: argparse.Namespace, content: dict[str, Any], designed: Any) -> None:  # noqa: ANN401
    from camnet.report.certificate import write_certificate

    write_json(output.path / "design.json", content)
    if designed is None:
        return
    with (
        whole_file(output.path / "cameras.csv") as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("name", "x", "y"))
        writer.writerows((c["name"], f"{c['x']:.3f}", f"{c['y']:.3f}") for c in content["cameras"])
    output.results_stand()
    verdict = "certified" if content["certified"] else "not certified"
    reason = f"{content['count']} cameras, at least {content['lower_bound']} are needed"
    page = {
        "network": {
            "name": (args.roads or args.tracks).name,
            "cameras": content["count"],
            "regions": 0,
        },
        "target_class": content["target_class"],
        "certificates": {"sound": {"verdict": verdict, "reason": reason}},
        "transitions": [],
    }
    write_certificate(output.path, page, designed.views, designed.lines)


def _print(content: dict[str, Any]) -> None:
    if "promise" in content:
        print(content["promise"]["sentence"])
    for words in content.get("warnings", []):
        say(f"warning: {words}")
    if "repairs" in content:
        print(f"{content['count']} cameras; {len(content['repairs'])} transitions are not certified")
        for r in content["repairs"]:
            length = "endless" if r["longest_m"] is None else f"{r['longest_m']:.0f} m"
            best = r["changes"][0]
            print(
                f"  {r['from']} > {r['to']} ({length}): {best['change']} {best['amount']:.3g} {best['unit']}"
            )
            for other in (c for c in r["changes"][1:] if "pose" in c):
                print(f"      or {other['change']} {other['amount']:.3g} {other['unit']}")
        if content["additions"]:
            print(f"{len(content['additions'])} more cameras certify the whole network:")
            for c in content["additions"]:
                print(f"  {c['name']} at ({c['x']:.1f}, {c['y']:.1f})")
        return
    what = f"{content['tracks']} tracks" if "tracks" in content else "roads"
    print(
        f"{content['count']} cameras of {content['candidates']} candidates certify {content['roads_km']:.1f} km of "
        f"{what} for {_out_of_view(content)} out of view"
    )
    print(f"  lower bound {content['lower_bound']}, gap {content['gap']:.1%}, {content['seconds']:.1f} s")
    print(f"  checked by the certifier: {'certified' if content['certified'] else 'NOT certified'}")
    if "check" in content:
        print_check(content["check"])


def _out_of_view(content: dict[str, Any]) -> str:
    seconds = f"{content['off_max_s']:.4g} s"
    return f"{content['unseen_max_m']:.4g} m, {seconds}" if "unseen_max_m" in content else seconds

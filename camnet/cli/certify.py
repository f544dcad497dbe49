"""``camnet certify``: which gaps of a network a target can cross without being lost."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import non_negative, numbers
from camnet.cli.common import add_common, overrides, positive, progress_bar, say, warn
from camnet.cli.output import output_folder, print_json, write_json

__all__ = ["add_parser", "add_target_class", "learned_model", "read_tracks"]

_DESCRIPTION = """Certify a network before it is built.

published  the conditions of harris2020 to the letter; Theorem 3.1, which would certify a layout of fixed cameras as a
           whole, cannot be met by views that do not overlap, and the report says so and why
sound      the same argument with its errors repaired; every inequality holds under the stated assumptions
learned    error growth along the learned motion model, sharp enough to design with (--learn or --model)

Three kinds of input:
  camnet certify quickstart                              a world: fixed or mobile cameras
  camnet certify mobile_certified --learn                the same, with the motion learned first
  camnet certify --cameras DIR_OF_KRTD                   surveyed cameras, targets that go anywhere
  camnet certify --cameras DIR_OF_KRTD --tracks people.csv
  camnet certify --roads NET.xml --cameras CAMERAS.csv   cameras over a city's roads (CSV name,x,y or SUMO detectors)

With --out: certificate.json, map.png, report.html and, after --learn, model.npz."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "certify",
        help="which gaps a target can cross without being lost, and why",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "config", nargs="?", help="a world file, a folder with world.yaml, or a shipped world's name"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides", help="change one setting"
    )
    parser.add_argument(
        "--duration", type=positive, metavar="S", help="length of the run that --learn simulates, s"
    )
    add_common(parser)
    model = parser.add_argument_group("learned motion model")
    model.add_argument("--learn", action="store_true", help="learn the motion in simulation first")
    model.add_argument("--model", metavar="FILE", type=Path, help="a model that an earlier --learn saved")
    site = parser.add_argument_group("cameras that stand already")
    site.add_argument(
        "--cameras", metavar="PATH", type=Path, help="folder of *.krtd; with --roads a .csv or .add.xml"
    )
    site.add_argument("--roads", metavar="NET", type=Path, help="SUMO network of the roads")
    site.add_argument(
        "--tracks", metavar="CSV", type=Path, help="recorded people, checked against the reachable sets"
    )
    site.add_argument(
        "--fix-error",
        type=non_negative,
        metavar="M",
        help="bound of a recorded fix's error, m (default: calibrated by the earliest quarter of the fixes)",
    )
    site.add_argument("--origin", metavar="LAT,LON,ALT", help="local frame of the tracks, degrees and m")
    site.add_argument("--image", metavar="WxH", default="1920x1080", help="size of the cameras' images, px")
    site.add_argument(
        "--range", type=positive, default=80.0, metavar="M", help="cap of the cameras' range, m"
    )
    site.add_argument(
        "--footprint", type=positive, default=30.0, metavar="M", help="side of a road camera's view, m"
    )
    add_target_class(parser)
    parser.set_defaults(run=run)


def add_target_class(parser: argparse.ArgumentParser) -> None:
    """Add the target class and the dwell times that a designer states."""
    group = parser.add_argument_group("target class and dwell times (defaults: the world's)")
    group.add_argument("--v-max", type=positive, metavar="MPS", help="bound of the targets' speed, m/s")
    group.add_argument("--v-lo", type=positive, metavar="MPS", help="least speed on roads, m/s")
    group.add_argument("--extent", type=positive, metavar="M", help="radius of the targets' extent, m")
    group.add_argument("--off-max", type=positive, metavar="S", help="longest time out of view allowed, s")
    group.add_argument("--on-min", type=positive, metavar="S", help="least time in view needed, s")
    group.add_argument(
        "--model-error", type=positive, metavar="MPS", help="stated velocity error of the model, m/s"
    )
    group.add_argument(
        "--initial-error", type=positive, metavar="M", help="position error when a target is lost, m"
    )


def run(args: argparse.Namespace) -> int:
    """Load, certify, write."""
    from camnet.experiments.learned_model import save_models
    from camnet.report.certificate import write_certificate

    with output_folder(args, "certify") as output:
        certified, model = _certify(args)
        content = _content(args, certified)
        if output is not None:
            write_json(output.path / "certificate.json", content)
            if model:
                save_models(model, output.path)
            output.results_stand()
            write_certificate(output.path, content, certified.views, certified.lines)
    if output is not None:
        say(f"wrote {output.folder}; open {output.folder / 'report.html'}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 0


def _content(args: argparse.Namespace, certified: Any) -> dict[str, Any]:  # noqa: ANN401 - imported late
    """Return the report, with what stands in the place of a certificate that was not asked for; print warnings."""
    content: dict[str, Any] = {**certified.report, "version": __version__}
    content["certificates"].setdefault(
        "learned",
        {
            "verdict": "not certified",
            "reason": "no motion model was given: add "
            + ("--model-error" if args.config is None else "--learn, --model or --model-error"),
        },
    )
    for words in content.get("warnings", []):
        warn(words)
    return content


def _certify(args: argparse.Namespace) -> tuple[Any, Any]:
    from camnet.errors import ConfigError

    if args.config is None and args.cameras is None:
        raise ConfigError("nothing to certify: name a world, or give --cameras (see camnet certify --help)")
    if args.config is not None and (args.cameras is not None or args.roads is not None):
        raise ConfigError(f"{args.config!r} and --cameras: give a world or cameras, not both")
    if args.config is not None:
        return _world(args)
    return (_city(args) if args.roads is not None else _open_site(args)), None


def _world(args: argparse.Namespace) -> tuple[Any, Any]:
    from camnet.experiments.certify_world import certify_world

    scenario = world_of(args)
    if args.initial_error is not None:
        certificate = scenario.certificate.model_copy(update={"initial_error_m": args.initial_error})
        scenario = scenario.model_copy(update={"certificate": certificate})
    model = learned_model(args, scenario)
    certified = certify_world(scenario, model, off_max_s=args.off_max, model_error_mps=args.model_error)
    return certified, model


def world_of(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Load the world of the command line, its traffic expanded."""
    from camnet.cache_folder import cache_folder
    from camnet.config.load import load_scenario
    from camnet.config.models import Scenario
    from camnet.config.traffic import expand_traffic
    from camnet.errors import ConfigError

    scenario = load_scenario(args.config, overrides(args), seed=args.seed)
    if not isinstance(scenario, Scenario):
        raise ConfigError(
            f"{args.config}: kind 'recorded' is no network; give a network, or --cameras DIR_OF_KRTD"
        )
    return scenario if scenario.traffic is None else expand_traffic(scenario, cache_folder())


def learned_model(args: argparse.Namespace, scenario: Any) -> Any:  # noqa: ANN401 - imported late
    """Return the models that the command line asks for by target, learned now or loaded; None without any."""
    from camnet.experiments.learned_model import learn_models, load_models

    if args.model is not None:
        return load_models(args.model, [t.name for t in scenario.targets])
    if not args.learn:
        return None
    seconds = scenario.run.duration_s
    with progress_bar(seconds, "learning", "s", args.quiet) as advance:
        return learn_models(scenario, seconds, scenario.seed, advance)


def _growth(args: argparse.Namespace, e0_m: float) -> Any:  # noqa: ANN401 - imported late
    from camnet.certification.transitions import GrowthModel

    return None if args.model_error is None else GrowthModel(e0_m, args.model_error)


def _open_site(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.certification.free_network import FreeTargetClass
    from camnet.experiments.certify_site import certify_cameras
    from camnet.experiments.recorded_people import check_recorded

    target = FreeTargetClass(args.v_max or 2.0, args.extent or 0.3)
    e0 = args.initial_error or 3.0
    certified, views, names, _ = certify_cameras(
        args.cameras,
        target,
        image_px=_image(args.image),
        range_m=args.range,
        e0_m=e0,
        growth=_growth(args, e0),
        off_max_s=args.off_max,
        on_min_s=args.on_min,
    )
    certified.report["network"]["name"] = str(args.cameras.name)
    if args.tracks is not None:
        found = check_recorded(read_tracks(args), views, names, target, 0.0, args.fix_error)
        certified.report["recorded"] = found
        certified.report["target_class"] += (
            f"; recorded fixes off by at most {found['fix_error_m']:.3g} m ({found['fix_error_source']})"
        )
    return certified


def _image(text: str) -> tuple[int, int]:
    from camnet.errors import ConfigError
    from camnet.numerals import read_whole

    parts = text.lower().split("x")
    try:
        width, height = (read_whole(part, 1, 20_000) for part in parts)
    except ValueError as error:
        raise ConfigError(
            f"--image {text!r}: width x height in pixels was expected, such as 1920x1080 ({error})"
        ) from None
    return width, height


def read_tracks(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Read ``--tracks``: ETH/UCY text, or a CSV table."""
    from camnet.importers.csv_tracks import read_csv_tracks
    from camnet.importers.eth_tracks import read_eth_tracks
    from camnet.importers.fixes import TrackOptions
    from camnet.importers.geodesy import Origin

    origin = None
    if args.origin is not None:
        names = ("latitude", "longitude", "altitude")
        origin = Origin(*numbers("--origin", args.origin, names, "39.05,-85.53,205"))
    read = read_eth_tracks if args.tracks.suffix == ".txt" else read_csv_tracks
    return read(args.tracks, TrackOptions(origin=origin))


def _city(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.certification.transitions import RoadTargetClass
    from camnet.errors import ConfigError
    from camnet.experiments.certify_site import certify_road_cameras

    if args.cameras is None:
        raise ConfigError(
            "--roads: give --cameras too (a CSV with name,x,y or a SUMO .add.xml), or use camnet design"
        )
    target = RoadTargetClass(args.v_lo or 5.0, args.v_max or 14.0, args.extent or 1.0)
    certified = certify_road_cameras(
        args.roads,
        args.cameras,
        target,
        footprint_m=args.footprint,
        off_max_s=args.off_max or 60.0,
        on_min_s=args.on_min or 0.0,
        growth=_growth(args, args.initial_error or 0.5),
    )
    certified.report["network"]["name"] = str(args.roads.name)
    return certified


def _print(content: dict[str, Any]) -> None:
    network = content["network"]
    print(
        f"{network.get('name', 'network')}: {network['cameras']} cameras, {network['regions']} operating regions"
    )
    print(f"targets: {content['target_class']}")
    for name, certificate in content["certificates"].items():
        print(f"\n{name}: {certificate['verdict']}\n  {certificate['reason']}")
        if "dwell_times" in certificate and certificate["dwell_times"] != certificate["reason"]:
            print(f"  dwell times of the estimator: {certificate['dwell_times']}")
    _print_transitions(content["transitions"])
    if "recorded" in content:
        _print_recorded(content["recorded"])


def _print_recorded(r: dict[str, Any]) -> None:
    later, rides = r["held_out"], r["rides"]
    print(
        f"\nrecorded people: {r['people']} with {r['fixes']} fixes, {r['faster_than_v_max']} steps between them are "
        f"faster than {r['v_max_mps']:g} m/s\n"
        f"  error of a fix: at most {r['fix_error_m']:.3g} m ({r['fix_error_source']})\n"
        f"  out of their reachable set: {later['outside']} of {later['unseen']} unseen fixes"
        f"{'' if r['fix_error_source'] == 'stated' else ' recorded later'}, {r['outside']} of all {r['unseen']}\n"
        f"  nobody leaves from an error of {r['least_fix_error_m']:.4g} m on (exact fixes: v_max "
        f"{r['least_v_max_mps']:.3g} m/s)\n"
        f"  longest jump beyond v_max {r['longest_jump_m']:.0f} m; {rides['count']} stretches of three steps or more "
        f"above {1.5 * r['v_max_mps']:g} m/s, median {rides['median_mps']:.1f}, most {rides['fastest_mps']:.1f} m/s\n"
        "  error m  fixes outside  people outside"
    )
    for row in r["table"]:
        print(f"  {row['fix_error_m']:7g}  {row['outside']:13d}  {row['people_outside']:14d}")


_MOST_ROWS = 40


def _print_transitions(transitions: list[dict[str, Any]]) -> None:
    if not transitions:
        print("\nno transition between two views was found")
        return
    print(
        f"\n{'transition':32s} {'gap m':>8s}  {'sound':15s} {'learned':15s} {'margin m':>9s} {'trust s':>8s}  binding"
    )
    worst = sorted(transitions, key=_margin)
    for t in worst[:_MOST_ROWS]:
        best = t.get("learned", t.get("sound", {}))
        print(
            f"{t['from'] + ' > ' + str(t['to']):32.32s} {t['gap_m']:8.2f}  {_verdict(t, 'sound'):15s} "
            f"{_verdict(t, 'learned'):15s} {_text(best.get('margin_m')):>9s} "
            f"{_text(best.get('trust_horizon_s')):>8s}  {best.get('binding', '')}"
        )
    if len(transitions) > _MOST_ROWS:
        print(f"... the worst {_MOST_ROWS} of {len(transitions)}; --json or --out give all")


def _margin(transition: dict[str, Any]) -> float:
    part = transition.get("learned", transition.get("sound", {}))
    value = part.get("margin_m")
    return -1e9 if value is None else float(value)


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _verdict(transition: dict[str, Any], name: str) -> str:
    return str(transition.get(name, {}).get("verdict", "-"))

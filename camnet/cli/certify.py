"""``camnet certify``: which gaps of a network a target can cross without being lost."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import non_negative
from camnet.cli.camera_arguments import add_camera_files, add_cameras, surveyed_cameras
from camnet.cli.certify_options import refuse_unused
from camnet.cli.certify_print import print_certificate
from camnet.cli.common import add_common, positive, say, warn
from camnet.cli.inputs import learned_model, read_tracks, world_of
from camnet.cli.output import output_folder, print_json, write_json
from camnet.cli.target_arguments import add_detections, add_pixel_class, add_target_class, detections
from camnet.cli.traffic import kept, print_check

__all__ = ["CLAIMS", "add_parser", "claimed"]

_DESCRIPTION = """Certify a network before it is built.

The promise comes first: which targets, how many at once, how far and how long out of view at most, from entering the
site to leaving it. Two claims stand apart:

unseen     no target of the class is out of view for longer than allowed (--off-max, --unseen-max-m, or the world's)
estimate   the estimate of a target survives that, by three certificates:
  published  the conditions of harris2020 to the letter; Theorem 3.1, which would certify a layout of fixed cameras as
             a whole, cannot be met by views that do not overlap, and the report says so and why
  sound      the same argument with its errors repaired; every inequality holds under the stated assumptions
  learned    error growth along the learned motion model, sharp enough to design with (--learn or --model)

Three kinds of input:
  camnet certify quickstart                              a world: fixed or mobile cameras
  camnet certify mobile_certified --learn                the same, with the motion learned first
  camnet certify --cameras DIR_OF_KRTD                   surveyed cameras (KRTD, OpenCV, ...), targets that go anywhere
  camnet certify --cameras DIR_OF_KRTD --tracks people.csv
  camnet certify --roads NET.xml --cameras CAMERAS.csv   cameras over a city's roads (CSV name,x,y or SUMO detectors)

With --out: certificate.json, map.png, report.html and, after --learn, model.npz.
Exit status: 0 every claim of --require is certified, 1 one is not, 2 bad input."""

#: claims that --require may name
CLAIMS = ("unseen", "published", "sound", "learned")


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
    parser.add_argument(
        "--require",
        type=_claims,
        default=("unseen",),
        metavar="CLAIMS",
        help="claims that decide the exit status, of " + ", ".join(CLAIMS) + " (default: unseen)",
    )
    add_common(parser)
    model = parser.add_argument_group("learned motion model")
    model.add_argument("--learn", action="store_true", help="learn the motion in simulation first")
    model.add_argument("--model", metavar="FILE", type=Path, help="a model that an earlier --learn saved")
    site = parser.add_argument_group("cameras that stand already")
    add_cameras(site)
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
    add_camera_files(site)
    site.add_argument(
        "--range", type=positive, metavar="M", help="cap of the cameras' range, m (default: 80)"
    )
    site.add_argument(
        "--footprint", type=positive, metavar="M", help="side of a road camera's view, m (default: 30)"
    )
    add_pixel_class(site, "cameras see as far as they have the pixels of this class, in place of --range")
    promise = parser.add_argument_group("the promise")
    add_detections(promise)
    promise.add_argument(
        "--targets",
        type=_count,
        metavar="N",
        help="targets at the same time (default: as many as the world has)",
    )
    add_target_class(parser)
    parser.set_defaults(run=run)


def _claims(text: str) -> tuple[str, ...]:
    """Parse a list of claims, for argparse."""
    names = tuple(part.strip() for part in text.split(","))
    wrong = [name for name in names if name not in CLAIMS]
    if wrong:
        raise argparse.ArgumentTypeError(f"{wrong[0]!r} is no claim: give some of {', '.join(CLAIMS)}")
    return names


def _count(text: str) -> int:
    """Parse a whole number >= 1, for argparse."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number of at least 1 was expected")
    return int(text)


def run(args: argparse.Namespace) -> int:
    """Load, certify, write."""
    from camnet.experiments.learned_model import save_models
    from camnet.report.certificate import write_certificate

    refuse_unused(args)
    with output_folder(args, "certify") as output:
        certified, model = _certify(args)
        content = _content(args, certified)
        if output is not None:
            write_json(output.path / "certificate.json", content)
            if model:
                save_models(model, output.path)
            output.results_stand()
            write_certificate(output.path, content, certified.views, certified.lines, certified.solids)
    if output is not None:
        say(f"wrote {output.folder}; open {output.folder / 'report.html'}")
    if args.json:
        print_json(content)
    else:
        print_certificate(content)
        if "check" in content:
            print_check(content["check"])
    return 0 if content["required"]["reached"] and kept(content) else 1


def _content(args: argparse.Namespace, certified: Any) -> dict[str, Any]:  # noqa: ANN401 - imported late
    """Return the report with what was required of it; print warnings."""
    verdicts = claimed(certified.report)
    missed = [name for name in args.require if verdicts[name] != "certified"]
    required = {"claims": list(args.require), "missed": missed, "reached": not missed}
    content: dict[str, Any] = {**certified.report, "required": required, "version": __version__}
    for words in content.get("warnings", []):
        warn(words)
    return content


def claimed(report: dict[str, Any]) -> dict[str, str]:
    """Return the verdict of every claim of a report."""
    claims = report["claims"]
    estimate = {name: str(part["verdict"]) for name, part in claims["estimate"].items()}
    return {"unseen": str(claims["unseen"]["verdict"]), **estimate}


def _certify(args: argparse.Namespace) -> tuple[Any, Any]:
    from camnet.errors import ConfigError

    if args.config is None and args.cameras is None:
        raise ConfigError("nothing to certify: name a world, or give --cameras (see camnet certify --help)")
    if args.config is not None and (args.cameras is not None or args.roads is not None):
        raise ConfigError(f"{args.config!r} and --cameras: give a world or cameras, not both")
    if args.config is not None:
        return _world(args)
    return (_city(args) if args.roads is not None else _open_site(args)), None


def _asked_error(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Return e_v as ``certify_world`` takes it."""
    from camnet.certification.model_error import Conformal
    from camnet.errors import ConfigError

    if args.model_error == "conformal":
        return Conformal(0.95 if args.confidence is None else args.confidence)
    if args.confidence is not None:
        raise ConfigError(
            f"--confidence {args.confidence:g}: is of --model-error conformal; add that or leave it out"
        )
    return args.model_error


def _world(args: argparse.Namespace) -> tuple[Any, Any]:
    from camnet.errors import ConfigError
    from camnet.experiments.certify_world import certify_world
    from camnet.experiments.restate import restate_class, restate_detection, restate_pixels
    from camnet.motion.settings import RoadTarget

    scenario = world_of(args)
    if args.pixel_class is not None:
        scenario = restate_pixels(scenario, args.pixel_class)
    scenario = restate_class(scenario, v_lo_mps=args.v_lo, v_max_mps=args.v_max, extent_m=args.extent)
    if args.detections is not None:
        scenario = restate_detection(scenario, detections(args.detections))
    roads = any(isinstance(t.motion, RoadTarget) for t in scenario.targets)
    if args.model_error is not None and not (roads or args.learn or args.model):
        raise ConfigError(
            f"--model-error {args.model_error}: is the error of a motion model; add --learn or --model FILE"
        )
    if args.initial_error is not None:
        certificate = scenario.certificate.model_copy(update={"initial_error_m": args.initial_error})
        scenario = scenario.model_copy(update={"certificate": certificate})
    model = learned_model(args, scenario)
    certified = _extent_named(
        args,
        certify_world,
        scenario,
        model,
        off_max_s=args.off_max,
        off_max_m=args.unseen_max_m,
        on_min_s=args.on_min,
        model_error_mps=_asked_error(args),
        at_once=args.targets,
    )
    return certified, model


def _extent_named(args: argparse.Namespace, certify: Any, *given: Any, **asked: Any) -> Any:  # noqa: ANN401
    """Certify; an error that a restated extent causes names the option."""
    from camnet.errors import CertificateError

    try:
        return certify(*given, **asked)
    except CertificateError as error:
        if args.extent is None or "extent" not in str(error):
            raise
        raise CertificateError(f"--extent {args.extent:g}: {error}") from None


def _growth(args: argparse.Namespace, e0_m: float) -> Any:  # noqa: ANN401 - imported late
    from camnet.certification.transitions import GrowthModel
    from camnet.errors import ConfigError

    if args.model_error == "conformal":
        raise ConfigError(
            "--model-error conformal: is from the gaps of a world's learned model; state m/s here"
        )
    return None if args.model_error is None else GrowthModel(e0_m, args.model_error)


def _open_site(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.certification.free_network import FreeTargetClass
    from camnet.experiments.certify_site import certify_cameras
    from camnet.experiments.recorded_people import check_recorded

    target = FreeTargetClass(args.v_max or 2.0, args.extent or 0.3)
    e0 = args.initial_error or 3.0
    certified, views, names, _ = certify_cameras(
        surveyed_cameras(args),
        target,
        range_m=args.range or 80.0,
        pixel_class=args.pixel_class,
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


def _city(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.certification.transitions import RoadTargetClass
    from camnet.errors import ConfigError
    from camnet.experiments.certify_site import certify_road_cameras

    if args.cameras is None:
        raise ConfigError(
            "--roads: give --cameras too (a CSV with name,x,y or a SUMO .add.xml), or use camnet design"
        )
    v_lo = args.v_lo or 5.0
    target = RoadTargetClass(v_lo, args.v_max or max(14.0, v_lo), args.extent or 1.0, args.stop_s or 0.0)
    certified = certify_road_cameras(
        args.roads,
        args.cameras,
        target,
        footprint_m=args.footprint or 30.0,
        off_max_s=args.off_max or (None if args.unseen_max_m else 60.0),
        off_max_m=args.unseen_max_m,
        limit_source="as asked for" if args.off_max or args.unseen_max_m else "default of --off-max",
        traffic=args.check,
        own_limits=args.v_max is None,
        on_min_s=args.on_min or 0.0,
        growth=_growth(args, args.initial_error or 0.5),
    )
    certified.report["network"]["name"] = str(args.roads.name)
    return certified

"""``camnet coverage``: how much of a site its cameras see, and how well."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import non_negative, numbers
from camnet.cli.camera_arguments import CAMERA_OPTIONS, add_camera_files, add_cameras, surveyed_cameras
from camnet.cli.certify_options import refuse_two_ranges
from camnet.cli.common import add_common, add_set, positive, say, warn
from camnet.cli.inputs import world_of
from camnet.cli.output import output_folder, print_json, write_json
from camnet.cli.target_arguments import add_pixel_class

__all__ = ["add_parser"]

_DESCRIPTION = """Count what the cameras of a site see: of the ground and of its roads, by how many cameras, behind
occluders not, and with how many pixels per metre (classes of EN 62676-4:2015: monitor 12.5, detect 25, observe 62.5,
recognise 125, identify 250). What no camera sees is listed and drawn.

  camnet coverage stationary_certified                      the fixed cameras of a world
  camnet coverage stationary_certified --class recognise    only what they see well enough to recognise
  camnet coverage --cameras DIR_OF_KRTD                     surveyed cameras (KRTD, OpenCV, ROS, Kalibr, KITTI, COLMAP)
  camnet coverage --roads NET.xml --cameras CAMERAS.csv     cameras over a city's roads (CSV name,x,y or SUMO detectors)
  camnet coverage --cameras DIR_OF_KRTD --area AREAS.geojson --origin 39.05,-85.53,205

With --out: coverage.json, places.npz (every place: cameras that see it, pixels per metre), map.png, pixels.png,
report.html and, with --origin, coverage.geojson (RFC 7946) with cameras, views, classes and blind spots.
Exit status: 0 counted, 2 bad input."""

#: options by the inputs that use them; elsewhere they are refused by name
_USED_BY = {
    "overrides": ("world",),
    "seed": ("world",),
    **dict.fromkeys(CAMERA_OPTIONS, ("site",)),
    "range": ("site",),
    "footprint": ("roads",),
}
_INPUTS = {"world": "a world file", "site": "--cameras DIR_OF_KRTD", "roads": "--roads NET"}


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "coverage",
        help="how much of a site its cameras see, how well, and the blind spots",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "config", nargs="?", help="a world file, a folder with world.yaml, or a shipped world's name"
    )
    add_set(parser)
    site = parser.add_argument_group("cameras that stand already")
    add_cameras(site)
    site.add_argument("--roads", metavar="NET", type=Path, help="SUMO network of the roads")
    add_camera_files(site)
    site.add_argument(
        "--range", type=positive, metavar="M", help="cap of the cameras' range, m (default: 80)"
    )
    site.add_argument(
        "--footprint", type=positive, metavar="M", help="side of a road camera's view, m (default: 30)"
    )
    counted = parser.add_argument_group("what counts")
    counted.add_argument(
        "--area",
        metavar="FILE",
        type=Path,
        help="GeoJSON polygons to count in: longitude and latitude with --origin, else the site's metres "
        "(default: the box about cameras, roads and occluders)",
    )
    counted.add_argument(
        "--margin",
        type=non_negative,
        metavar="M",
        help="around that box, m (default: 10; 50 around surveyed cameras)",
    )
    counted.add_argument(
        "--origin",
        metavar="LAT,LON,ALT",
        help="of the site's metres (x east, y north), degrees and m: writes GeoJSON",
    )
    counted.add_argument(
        "--height",
        type=non_negative,
        default=0.0,
        metavar="M",
        help="of what is to be seen above the ground, m (default: 0)",
    )
    counted.add_argument(
        "--resolution",
        type=positive,
        metavar="M",
        help="side of a place, m (default: 0.1, coarser for more than a million places)",
    )
    add_pixel_class(counted, "only what a camera sees with the pixels of this class counts")
    add_common(parser)
    parser.set_defaults(run=run, duration=None)


def run(args: argparse.Namespace) -> int:
    """Load, count, write."""
    from camnet.report.coverage_page import headline

    _refuse_unused(args)
    with output_folder(args, "coverage") as output:
        covered, origin = _cover(args)
        content = {**covered.report, "version": __version__}
        for words in content["warnings"]:
            warn(words)
        if output is not None:
            _write(output, covered, content, origin)
    if output is not None:
        say(f"wrote {output.folder}; open {output.folder / 'report.html'}")
    if args.json:
        print_json(content)
    else:
        print(headline(content))
        _print(content)
    return 0


def _refuse_unused(args: argparse.Namespace) -> None:
    """Refuse options that the kind of input does not use, and inputs that contradict each other."""
    from camnet.errors import ConfigError

    if args.config is None and args.cameras is None:
        raise ConfigError("nothing to count: name a world, or give --cameras (see camnet coverage --help)")
    if args.config is not None and (args.cameras is not None or args.roads is not None):
        raise ConfigError(f"{args.config!r} and --cameras or --roads: give a world or cameras, not both")
    kind = "world" if args.config is not None else ("roads" if args.roads is not None else "site")
    for name, kinds in _USED_BY.items():
        value = getattr(args, name)
        if value not in (None, []) and kind not in kinds:
            option = "--set" if name == "overrides" else "--" + name.replace("_", "-")
            given = value[0] if isinstance(value, list) else value
            where = " and ".join(_INPUTS[k] for k in kinds)
            raise ConfigError(f"{option} {given}: applies to {where}, not to {_INPUTS[kind]}; leave it out")
    refuse_two_ranges(args)
    if args.margin is not None and args.area is not None:
        raise ConfigError(f"--margin {args.margin:g}: is around the default area; leave it out with --area")


def _cover(args: argparse.Namespace) -> tuple[Any, Any]:
    from camnet.experiments.coverage import cover_site
    from camnet.importers.geodesy import Origin
    from camnet.importers.geojson_areas import read_areas

    origin = None
    if args.origin is not None:
        names = ("latitude", "longitude", "altitude")
        origin = Origin(*numbers("--origin", args.origin, names, "39.05,-85.53,205"))
    areas = () if args.area is None else read_areas(args.area, origin)
    covered = cover_site(
        _site(args),
        areas,
        height_m=args.height,
        resolution_m=args.resolution,
        margin_m=args.margin,
        pixel_class=args.pixel_class,
    )
    return covered, origin


def _site(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.experiments import coverage_site

    if args.config is not None:
        return coverage_site.world_site(world_of(args))
    if args.roads is not None:
        return coverage_site.road_camera_site(args.roads, args.cameras, args.footprint or 30.0)
    name = args.cameras.resolve().name
    return coverage_site.surveyed_site(name, surveyed_cameras(args), args.range or 80.0, args.pixel_class)


def _write(output: Any, covered: Any, content: dict[str, Any], origin: Any) -> None:  # noqa: ANN401
    from camnet.experiments.coverage_files import drawing_of, geo_features, write_places
    from camnet.report.coverage_map import write_blind_map, write_pixel_map
    from camnet.report.coverage_page import write_coverage_page
    from camnet.report.geojson import feature_collection

    folder = output.path
    if origin is not None:
        collection = feature_collection(geo_features(covered), origin, content["height_m"])
        write_json(folder / "coverage.geojson", collection)
    write_json(folder / "coverage.json", content)
    write_places(folder / "places.npz", covered)
    output.results_stand()
    drawing = drawing_of(covered)
    words = f"{content['site']}: {content['ground']['seen_share']:.1%} of the ground seen"
    write_blind_map(folder / "map.png", drawing, words)
    if drawing.px_per_m is not None:
        write_pixel_map(folder / "pixels.png", drawing, f"{content['site']}: pixels per metre")
    write_coverage_page(folder, content)


def _print(content: dict[str, Any]) -> None:
    print(f"\n{'cameras':>8s} {'ground m2':>12s} {'share':>7s}")
    for row in content["ground"]["by_cameras"]:
        print(f"{row['cameras']:8d} {row['m2']:12.1f} {row['share']:7.1%}")
    if content["roads"] is not None:
        print(f"\n{'cameras':>8s} {'road m':>12s} {'share':>7s}")
        for row in content["roads"]["by_cameras"]:
            print(f"{row['cameras']:8d} {row['m']:12.1f} {row['share']:7.1%}")
    if content["classes"] is not None:
        print(f"\n{'class':10s} {'px/m':>6s} {'ground':>7s} {'road':>7s}")
        for row in content["classes"]:
            road = "-" if row["road_share"] is None else f"{row['road_share']:.1%}"
            print(f"{row['class']:10s} {row['px_per_m']:6g} {row['ground_share']:7.1%} {road:>7s}")
    for row in content["areas"]:
        print(f"\narea {row['name']}: {row['seen_share']:.1%} of {row['m2']:,.1f} m2 seen")
    if content["blind_spots"]:
        count = content["blind_spots_count"]
        print(f"\n{count} blind spot{'' if count == 1 else 's'}; the largest:")
        for spot in content["blind_spots"][:5]:
            print(f"  {spot['m2']:10.1f} m2 about ({spot['x_m']:.1f}, {spot['y_m']:.1f})")

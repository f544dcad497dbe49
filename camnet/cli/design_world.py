"""``camnet design WORLD``: cameras on walls, poles and masts of a site."""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import numbers, positive, whole
from camnet.cli.common import progress_bar, say
from camnet.cli.output import Output, output_folder, print_json, write_json
from camnet.cli.target_arguments import add_detections, detections
from camnet.errors import ConfigError
from camnet.numerals import read_decimal
from camnet.storage.whole_file import whole_file, write_text

__all__ = ["add_world_options", "run_world"]

_COLUMNS = ("name", "change", "camera", "mount", "x", "y", "z", "pan_deg", "tilt_deg", "price")


def add_world_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that only a design for a world file has."""
    group = parser.add_argument_group("a world file")
    group.add_argument(
        "--mounts",
        action="append",
        metavar="WHERE",
        help="where cameras may be: a CSV (name,x,y,z[,pan_min,pan_max,tilt_min,tilt_max,cost]; m, degrees), "
        "a GeoJSON of points, lines and polygons with name and height and the same properties (longitude and latitude "
        "with --origin), "
        "walls:SPACING,HEIGHT along walls as high as that, or outline:SPACING,HEIGHT for masts around the site, m; "
        "repeatable",
    )
    group.add_argument(
        "--catalogue",
        type=Path,
        metavar="YAML",
        help="cameras to choose from: name, width_px, height_px, fov_deg, price (default: the one that ships)",
    )
    group.add_argument(
        "--existing",
        choices=("keep", "movable", "replace"),
        help="fixed cameras of the world: keep them (default), turn or move them where that is cheaper than a further "
        "camera, or design without them",
    )
    group.add_argument(
        "--turn-price", type=positive, metavar="PRICE", help="of turning a camera that stands (default 25)"
    )
    group.add_argument(
        "--move-price",
        type=positive,
        metavar="PRICE",
        help="of taking a camera that stands to another mount, besides what the mount costs (default 75)",
    )
    add_detections(group)
    group.add_argument(
        "--budget", type=positive, metavar="PRICE", help="most that the added cameras may cost"
    )
    group.add_argument(
        "--survive",
        type=whole(0, 3),
        metavar="K",
        help="keep the promise after any K cameras fail, those that stand too (at most 3)",
    )
    group.add_argument(
        "--private",
        type=Path,
        metavar="GEOJSON",
        help="areas that no camera may see, from the ground to 2 m: longitude and latitude with --origin, else metres",
    )
    group.add_argument(
        "--mount-tolerance",
        metavar="M,DEG",
        help="keep the promise however the added cameras are installed: this far off their places, m, and turned by "
        "this much about any axis, degrees, at most; cameras that stand count as they are",
    )
    group.add_argument(
        "--aim-step",
        type=positive,
        metavar="DEG",
        help="between two directions that are tried at a mount, degrees (default 15)",
    )
    group.add_argument(
        "--set",
        action="append",
        metavar="KEY=VALUE",
        dest="overrides",
        help="change one setting of the world",
    )


def run_world(args: argparse.Namespace) -> int:
    """Load, place, certify, write."""
    from camnet.errors import ConfigError

    if args.mounts is None and not args.repair_world:
        raise ConfigError(
            f"{args.config}: give --mounts: where cameras may be, such as walls:2,5 (every 2 m along the walls, "
            "5 m high)"
        )
    origin = _origin(args)
    with output_folder(args, "design") as output:
        with progress_bar(1.0, "placing", "", args.quiet) as advance:
            designed = _design(args, origin, advance)
        content = {**designed.report, "version": __version__}
        if output is not None:
            _write(output, content, designed, origin)
    if output is not None:
        say(f"wrote {output.folder}; certify it: camnet certify {output.folder / 'world.yaml'}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 0 if content["certified"] else 1


def _design(args: argparse.Namespace, origin: Any, advance: Any) -> Any:  # noqa: ANN401 - imported late
    from camnet.config.catalogue import load_catalogue
    from camnet.experiments.design_world import design_world
    from camnet.experiments.restate import restate_class, restate_detection
    from camnet.importers.geojson_areas import read_areas

    tolerance = _tolerance(args.mount_tolerance)
    catalogue = load_catalogue(args.catalogue)
    scenario = _world(args)
    scenario = restate_class(scenario, v_lo_mps=args.v_lo, v_max_mps=args.v_max, extent_m=args.extent)
    if args.detections is not None:
        scenario = restate_detection(scenario, detections(args.detections))
    return design_world(
        scenario,
        _mounts(args.mounts or _usual_mounts(scenario), scenario, tolerance, origin),
        catalogue,
        pixel_class=args.pixel_class,
        off_max_s=args.off_max,
        unseen_max_m=args.unseen_max_m,
        keep=args.existing != "replace",
        movable=_prices(args),
        objective=args.objective,
        count=args.count,
        budget=args.budget,
        survive=args.survive or 0,
        private=() if args.private is None else read_areas(args.private, origin),
        tolerance=tolerance,
        aim_step_deg=args.aim_step or 15.0,
        effort=args.effort,
        time_limit_s=math.inf if args.time_limit is None else args.time_limit,
        seed=args.seed or 0,
        progress=advance,
    )


def _prices(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Return what a change of a camera that stands costs, None where none may be touched."""
    from camnet.experiments.design_changes import Prices

    if args.existing != "movable":
        for option, value in (("--turn-price", args.turn_price), ("--move-price", args.move_price)):
            if value is not None:
                raise ConfigError(f"{option} {value:g}: goes with --existing movable, or with --repair")
        return None
    usual = Prices()
    return Prices(args.turn_price or usual.turn, args.move_price or usual.move)


#: highest that a camera looks, where targets fly, degrees below the horizon
_UP_DEG = -75.0
#: where a repair may put cameras unless it is told: masts about the site, and walls that are as high
_MASTS, _WALLS, _WALLS_M = "outline:8,5", "walls:4,5", 5.0


def _usual_mounts(scenario: Any) -> list[str]:  # noqa: ANN401 - imported late
    from camnet.geometry.regions import build_region

    tops = [float(build_region(o.name, o.shape).height[1]) for o in scenario.occluders]
    return [_MASTS, _WALLS] if max(tops, default=0.0) >= _WALLS_M else [_MASTS]


def _world(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from camnet.config.load import load_scenario
    from camnet.config.models import Scenario

    scenario = load_scenario(args.config, args.overrides or [], seed=args.seed)
    if not isinstance(scenario, Scenario) or scenario.traffic is not None:
        kind = "traffic" if isinstance(scenario, Scenario) else "kind 'recorded'"
        raise ConfigError(
            f"{args.config}: a world of {kind} is no site with walls and ways; give a network, or --roads or --tracks"
        )
    return scenario


def _tolerance(text: str | None) -> Any:  # noqa: ANN401 - imported late
    """Return the tolerance of ``--mount-tolerance``, None without one."""
    from camnet.geometry.mount_tolerance import MountTolerance

    if text is None:
        return None
    position_m, angle_deg = numbers("--mount-tolerance", text, ("metres", "degrees"), "0.05,1")
    if not (0.0 <= position_m <= 10.0 and 0.0 <= angle_deg < 45.0):
        raise ConfigError(
            f"--mount-tolerance {text}: 0 to 10 m and 0 to below 45 degrees were expected, such as 0.05,1"
        )
    return MountTolerance(position_m, angle_deg)


def _mounts(texts: Sequence[str], scenario: Any, tolerance: Any, origin: Any) -> list[Any]:  # noqa: ANN401
    """Return the mounts of ``--mounts``.

    Raises
    ------
    ConfigError
        A text is neither a file nor one of the rules, or two mounts have one name.
    """
    from camnet.experiments.design_mounts import BRACKET_M, outline_mounts, wall_mounts
    from camnet.experiments.site_ways import flies, places_of
    from camnet.geometry.regions import build_region
    from camnet.importers.geojson_mounts import read_geojson_mounts
    from camnet.importers.mounts import read_mounts

    solids = [build_region(o.name, o.shape) for o in scenario.occluders]
    # a camera that is installed off its place does not stand in the wall
    bracket_m = max(BRACKET_M, 0.0 if tolerance is None else tolerance.position_m + 0.5 * BRACKET_M)
    found = []
    for text in texts:
        rule, colon, rest = text.partition(":")
        if colon and rule in ("walls", "outline"):
            lengths = _two_lengths(text, rest)
            along = (
                wall_mounts(solids, *lengths, bracket_m)
                if rule == "walls"
                else outline_mounts(places_of(scenario), solids, *lengths)
            )
            up = flies(scenario)  # cameras look up where a target does not stay on the ground
            found += [replace(m, tilt_deg=(_UP_DEG, m.tilt_deg[1])) for m in along] if up else along
        elif text.lower().endswith((".geojson", ".json")):
            found += read_geojson_mounts(Path(text), origin)
        else:
            found += read_mounts(text)
    names = [m.name for m in found]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise ConfigError(f"--mounts {' '.join(texts)}: the mount {twice!r} is there twice; names are unique")
    return found


def _two_lengths(text: str, rest: str) -> tuple[float, float]:
    try:
        spacing, height = (read_decimal(part) for part in rest.split(","))
        if spacing > 0.0 and height > 0.0:
            return spacing, height
    except ValueError:
        pass
    raise ConfigError(
        f"--mounts {text}: spacing and height in metres were expected, both above 0, such as walls:2,5"
    )


def _origin(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Return where the world's frame sits, None where that is not said."""
    from camnet.importers.geodesy import Origin

    if args.origin is None:
        return None
    names = ("latitude", "longitude", "altitude")
    return Origin(*numbers("--origin", args.origin, names, "39.05,-85.53,205"))


def _features(content: dict[str, Any], designed: Any) -> list[Any]:  # noqa: ANN401 - imported late
    """Return each added camera as a point, and the ground that each camera sees as polygons."""
    import numpy as np
    import shapely

    from camnet.report.geojson import GeoFeature

    points = [
        GeoFeature(np.array([c["x"], c["y"], c["z"]]), {"what": "camera", **c}) for c in content["cameras"]
    ]
    views: dict[str, list[Any]] = {}
    for name, outline in designed.certified.views:
        views.setdefault(name, []).append(shapely.Polygon(outline))
    return points + [
        GeoFeature(polygons, {"what": "view on the ground", "name": n}) for n, polygons in views.items()
    ]


def _write(
    output: Output,
    content: dict[str, Any],
    designed: Any,  # noqa: ANN401 - imported late
    origin: Any,  # noqa: ANN401 - imported late
) -> None:
    from camnet.config.load import dump_scenario
    from camnet.report.certificate import write_certificate
    from camnet.report.design import design_section
    from camnet.report.geojson import feature_collection

    write_json(output.path / "design.json", content)
    write_text(output.path / "world.yaml", dump_scenario(designed.scenario))
    with (
        whole_file(output.path / "cameras.csv") as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        writer = csv.DictWriter(stream, _COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(content["cameras"])
    if origin is not None:
        collection = feature_collection(_features(content, designed), origin, 0.0)
        write_json(output.path / "cameras.geojson", collection)
    else:
        say("no cameras.geojson: its longitudes and latitudes need --origin, where the world's frame sits")
    output.results_stand()
    made = designed.certified
    section = design_section(_words(content), content["cameras"])
    write_certificate(output.path, made.report, made.views, made.lines, made.solids, section)


def _words(content: dict[str, Any]) -> list[str]:
    """Return what was found, a sentence each."""
    done = {k: sum(c["change"] == k for c in content["cameras"]) for k in ("add", "turn", "move")}
    parts = [f"{done['add']} cameras added"]
    parts += [f"{n} {w}" for n, w in ((done["turn"], "turned"), (done["move"], "moved")) if n]
    if content["standing"]:
        parts.append(f"{len(content['standing'])} stay as they are")
    words = [
        f"{', '.join(parts)}; price {content['price']:g}, of {content['candidates']} candidates at "
        f"{content['mounts']} mounts"
    ]
    if not content["count"]:
        words.append("the cameras that stand are enough: nothing has to be changed")
    words.append(
        f"lower bound {content['lower_bound']:g} ({content['minimised']}), gap {content['gap']:.1%}, "
        f"{content['seconds']:.1f} s"
    )
    if content["after_failures"] is not None:
        worst = content["after_failures"]
        words.append(
            f"after any {content['survive']} fail: at most {worst['unseen_max_m']:.1f} m, "
            f"{worst['unseen_max_s']:.1f} s out of view (without {', '.join(worst['failed'])})"
        )
    if content["with_installation_error"] is not None:
        held = content["with_installation_error"]
        words.append(
            f"installed up to {held['position_m']:g} m and {held['angle_deg']:g} degrees off: at most "
            f"{held['unseen_max_m']:.1f} m, {held['unseen_max_s']:.1f} s out of view"
        )
    return [*words, "certified anew from the world as written"]


def _print(content: dict[str, Any]) -> None:
    print(content["promise"]["sentence"])
    first, *more = _words(content)
    print(first)
    for c in content["cameras"]:
        print(
            f"  {c['change']:4s} {c['name']:24s} {c['camera']:16s} at ({c['x']:.1f}, {c['y']:.1f}, {c['z']:.1f}) m, "
            f"pan {c['pan_deg']:.0f}, tilt {c['tilt_deg']:.0f} degrees, price {c['price']:g}"
        )
    for sentence in more:
        print(f"  {sentence}")

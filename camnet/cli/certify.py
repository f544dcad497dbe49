"""``camnet certify``: how long a target may stay unseen, and must stay seen, in a network."""

from __future__ import annotations

import argparse
from typing import Any

from camnet import __version__
from camnet.cli.common import add_common, add_scenario, overrides, say
from camnet.cli.output import choose_folder, print_json, whole_folder, write_json

__all__ = ["add_parser"]

_DESCRIPTION = """Certify a network before it is built.

published  the dwell-time conditions of harris2020 to the letter
sound      the same argument with its errors repaired; every inequality holds under the stated assumptions

Dwell times: a target may stay unseen at most 'off' and must stay seen at least 'on' for the estimate to remain
usable. Theorem 3.1, which would certify a stationary layout as a whole, cannot be met by views that do not overlap;
the report says so and why."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "certify",
        help="dwell times that keep a target's estimate usable",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_scenario(parser)
    add_common(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Load, certify, write."""
    from camnet.config.load import load_scenario
    from camnet.config.models import Scenario
    from camnet.errors import ConfigError
    from camnet.simulation.certificates import network_report
    from camnet.simulation.network import build_network

    scenario = load_scenario(args.config, overrides(args), seed=args.seed)
    if not isinstance(scenario, Scenario):
        raise ConfigError(f"{args.config}: kind 'recorded' has no dwell times; give a network of cameras")
    folder = None if args.out is None else choose_folder(args.out, "", args.force)
    network = build_network(scenario)
    report = network_report(network)
    content = {
        "network": {"name": scenario.name, "cameras": len(network.cameras), "regions": len(scenario.regions)},
        "certificates": {name: report[name] for name in ("published", "sound")},
        "gaps": report["gaps"],
        "assumptions": report["assumptions"],
        "version": __version__,
    }
    if folder is not None:
        with whole_folder(folder) as temporary:
            write_json(temporary / "certificate.json", content)
        say(f"wrote {folder}")
    if args.json:
        print_json(content)
    else:
        _print(content)
    return 0


def _print(content: dict[str, Any]) -> None:
    network = content["network"]
    print(f"{network['name']}: {network['cameras']} cameras, {network['regions']} operating regions")
    for name, certificate in content["certificates"].items():
        print(f"\n{name}: {certificate['verdict']}")
        print(f"  {certificate['reason']}")
        print(f"  levels: V_hi = {certificate['v_hi']:.4g}, V_lo = {certificate['v_lo']:.4g}")
        for what in ("off_max_s", "on_min_s"):
            for case, value in certificate[what].items():
                print(f"  {what} {case}: {_text(value)}")


def _text(value: Any) -> str:  # noqa: ANN401 - a number or a record with a reason
    if isinstance(value, dict):
        seconds = value.get("seconds")
        return f"{seconds:.4g}" if seconds is not None else f"none ({value.get('reason', '')})"
    return "none" if value is None else f"{value:.4g}"

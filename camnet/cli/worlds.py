"""``camnet worlds``: what ships with camnet, what is in a world, and the schema of world files."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import Any

from camnet.cli.common import add_messages
from camnet.cli.output import print_json
from camnet.errors import ConfigError

__all__ = ["add_parser"]

_DESCRIPTION = """List the worlds that ship with camnet, or describe one: what is in it, where its file is, and the
settings that --set changes.

  camnet worlds                       the table
  camnet worlds quickstart            one world
  camnet worlds quickstart --yaml     its file, to start a world of your own from
  camnet worlds --schema              the JSON schema of world files, for an editor"""

#: names of one kind that a description shows
_MOST_NAMES = 8


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "worlds", help="list and describe the worlds that ship with camnet", description=_DESCRIPTION
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="a shipped world (default: all of them)")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    form.add_argument("--yaml", action="store_true", help="print the file of NAME")
    form.add_argument(
        "--schema", action="store_true", help="print the JSON schema of world files and recipes"
    )
    add_messages(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List, describe, or print the schema."""
    from camnet import worlds
    from camnet.config.schema import json_schema

    if args.name is not None and args.schema:
        raise ConfigError(
            f"{args.name!r} and --schema: the schema is the same for all worlds; give one of them"
        )
    if args.schema:
        print_json(json_schema())
    elif args.name is not None:
        _one(args)
    elif args.yaml:
        raise ConfigError(f"--yaml: name the world: one of {', '.join(worlds.names())}")
    else:
        found = [worlds.describe(name) for name in worlds.names()]
        if args.json:
            print_json({"worlds": {world.name: _plain(world) for world in found}})
        else:
            _table(found)
    return 0


def _plain(world: Any) -> dict[str, Any]:  # noqa: ANN401 - imported late
    return {**asdict(world), "path": str(world.path)}


def _one(args: argparse.Namespace) -> None:
    from camnet import worlds
    from camnet.config.load import load_scenario

    world = worlds.describe(args.name)
    if args.yaml:
        print(world.path.read_text(encoding="utf-8"), end="")
        return
    if args.json:
        print_json({**_plain(world), "config": load_scenario(world.path).model_dump(mode="json")})
        return
    scenario: Any = load_scenario(world.path)
    print(f"{world.name}: {world.description}\n")
    print(f"kind      {world.kind}, {_size(world)}")
    for word in ("agents", "fixed_cameras", "regions", "targets", "occluders", "roads"):
        names = [item.name for item in getattr(scenario, word)]
        if names:
            shown = names if len(names) <= _MOST_NAMES else [*names[:_MOST_NAMES], "..."]
            label = "cameras" if word == "fixed_cameras" else word
            print(f"{label:9s} {len(names)}: {', '.join(shown)}")
    print(f"length    {scenario.run.duration_s:g} s (run.duration_s)")
    print(f"file      {world.path}\n")
    print(f"  camnet simulate {world.name}")
    for key in _settings(scenario):
        print(f"  camnet simulate {world.name} --set {key}")


def _settings(scenario: Any) -> list[str]:  # noqa: ANN401 - imported late
    """Return some settings of the world as they are, written for ``--set``."""
    keys = [
        f"run.duration_s={scenario.run.duration_s:g}",
        f"sensing.position_noise_m={scenario.sensing.position_noise_m:g}",
    ]
    for target in scenario.targets[:1]:
        speed = target.motion.model_dump(mode="json").get("speed_mps")
        keys += (
            []
            if speed is None
            else [f"targets.{target.name}.motion.speed_mps={json.dumps(speed).replace(' ', '')}"]
        )
    return keys


def _size(world: Any) -> str:  # noqa: ANN401 - imported late
    return " x ".join(f"{length:.3g}" for length in world.size_m) + " m"


def _table(found: list[Any]) -> None:
    width = max(len(world.name) for world in found)
    print(f"{'name':{width}s}  {'kind':8s}  agents  cameras  targets  {'size':16s}  description")
    for w in found:
        print(
            f"{w.name:{width}s}  {w.kind:8s}  {w.agents:6d}  {w.agents + w.fixed_cameras:7d}  {w.targets:7d}  "
            f"{_size(w):16s}  {w.description}"
        )
    print("\ncamnet worlds NAME describes one; camnet simulate NAME runs it")

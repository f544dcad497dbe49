"""``camnet worlds``: what ships with camnet, and the schema of world files."""

from __future__ import annotations

import argparse
from typing import Any

from camnet.cli.output import print_json

__all__ = ["add_parser"]


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "worlds",
        help="list the worlds that ship with camnet",
        description="List the worlds that ship with camnet, or print the JSON schema of world files for an editor.",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON schema of world files and recipes"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List, or print the schema."""
    from camnet import worlds
    from camnet.config.schema import json_schema

    if args.schema:
        print_json(json_schema())
        return 0
    descriptions = {name: worlds.describe(name) for name in worlds.names()}
    if args.json:
        print_json({"worlds": descriptions})
        return 0
    width = max(map(len, descriptions))
    for name, words in descriptions.items():
        print(f"{name:{width}s}  {words}")
    return 0

"""``camnet warm-up``: compile everything once, visibly, before the first real run."""

from __future__ import annotations

import argparse
import logging
import time
from typing import Any

from camnet.cli.common import add_messages, progress_bar, say, warn
from camnet.cli.output import print_json
from camnet.cli.parser import suggestion

__all__ = ["add_parser"]

_GROUPS = ("quickstart", "simulate", "environment", "evaluate", "train", "certify")
_DESCRIPTION = """Compile what the commands need and keep it, so that the first real run starts at once; a second call
finds everything there. Without any words all is compiled; with words the parts that are named.

  camnet warm-up                      everything
  camnet warm-up quickstart           what camnet simulate quickstart needs
  camnet warm-up simulate certify     what these two need

Compiled code is kept in CAMNET_CACHE, else XDG_CACHE_HOME/camnet, else ~/.cache/camnet, and shared by all versions of
camnet there; what was not used for 60 days goes. The code is for this processor: warm up each kind of machine.
Exit status 1 if there is no folder where it can be kept."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "warm-up",
        help="compile everything once, before the first run",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "parts",
        nargs="*",
        type=_part,
        metavar="PART",
        help=f"of {', '.join(_GROUPS)} (default: all)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    add_messages(parser)
    parser.set_defaults(run=run)


def _part(text: str) -> str:
    if text not in _GROUPS:
        raise argparse.ArgumentTypeError(f"{text!r}: no such part; {suggestion(text, _GROUPS)}")
    return text


def run(args: argparse.Namespace) -> int:
    """Compile, and say where it is kept."""
    from camnet.cache_folder import cache_folders
    from camnet.compiled.store import held
    from camnet.warm_up import warm_up

    start, done = time.perf_counter(), []
    logging.getLogger("camnet.compiled").setLevel(logging.ERROR)  # that something is compiled is no news here
    with progress_bar(1.0, "compiling", "", args.quiet) as advance:
        for finished in warm_up(args.parts or _GROUPS, lambda k, n, words: advance(k / n, words)):
            done.append(finished)
    folders = cache_folders()
    files, size_bytes = held()
    content = {
        "folder": None if folders.write is None else str(folders.write),
        "lasting": folders.lasting,
        "compiled": sum(d.compiled for d in done),
        "kept_functions": files,
        "kept_bytes": size_bytes,
        "wall_s": time.perf_counter() - start,
        "workloads": [d.as_dict() for d in done],
    }
    if args.json:
        print_json(content)
    else:
        print(f"compiled {content['compiled']} functions in {content['wall_s']:.0f} s")
        print(f"kept {files} functions, {size_bytes / 1e6:.1f} MB, in {content['folder']}")
    if not folders.lasting:
        warn("nothing of this lasts: no folder can be written where later runs look")
        return 1
    say("ready")
    return 0

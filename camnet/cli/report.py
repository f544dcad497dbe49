"""``camnet report``: draw the report of a run again."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet.cli.common import add_messages, progress_bar, say
from camnet.cli.output import print_json
from camnet.storage.whole_file import sweep_files

__all__ = ["add_parser"]


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "report",
        help="draw the report of a run again",
        description="""Draw map, estimates, video and report.html of a run folder again, from its log.

  camnet report runs/first --no-video""",
    )
    parser.add_argument("folder", type=Path, help="folder that camnet simulate wrote")
    parser.add_argument("--no-video", action="store_true", help="leave the video as it is")
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    add_messages(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draw again."""
    from camnet.report.write import write_all

    if args.folder.is_dir():
        sweep_files(args.folder)  # what a killed report left behind
    with progress_bar(1.0, "drawing", "", args.quiet) as advance:
        write_all(args.folder, video=not args.no_video, progress=lambda k, n: advance(k / n))
    if args.json:
        written = sorted(p.name for p in args.folder.iterdir() if p.suffix in (".html", ".png", ".mp4"))
        print_json({"folder": str(args.folder), "files": written})
    say(f"wrote {args.folder / 'report.html'}")
    return 0

"""``camnet report``: draw the report of a run again."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet.cli.common import progress_bar, say

__all__ = ["add_parser"]


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "report",
        help="draw the report of a run again",
        description="Draw map, estimates, video and report.html of a run folder again, from its log.",
    )
    parser.add_argument("folder", type=Path, help="folder of a run")
    parser.add_argument("--no-video", action="store_true", help="leave the video as it is")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draw again."""
    from camnet.report.write import write_all

    with progress_bar(1.0, "drawing", "", args.quiet) as advance:
        write_all(args.folder, video=not args.no_video, progress=lambda k, n: advance(k / n))
    say(f"wrote {args.folder / 'report.html'}")
    return 0

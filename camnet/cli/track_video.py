"""``camnet track-video``: follow a target without a marker through a video or a folder of images."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.arguments import numbers
from camnet.cli.common import add_common, progress_bar, say
from camnet.cli.output import output_folder, print_json, write_json
from camnet.errors import ConfigError

__all__ = ["add_parser"]

_DESCRIPTION = """Follow a target through a video, or a folder of images, from its box in the first image: a correlation
tracker finds it, AdaTE filters it and its prediction is where the tracker looks next (li2019).
Writes tracking.mp4 (annotated), overlap.png (where there is ground truth), boxes.csv and result.json.

  camnet track-video walking.mp4 --box 51,53,87,290 --out runs/walking
  camnet track-video SEQUENCE_FOLDER"""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "track-video",
        help="follow a target through a video or images",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "sequence", type=Path, help="a video file, or a folder with img/ (and groundtruth_rect.txt)"
    )
    parser.add_argument(
        "--box", metavar="X,Y,W,H", help="the target in the first image, px; needed without ground truth"
    )
    add_common(parser, "runs/track-NAME, or a number after it if that is taken")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track and write."""
    from camnet.experiments import adate_visual
    from camnet.sensing.visual import Box

    first = None if args.box is None else Box(*_numbers(args.box))
    with output_folder(args, "track-video", f"track-{args.sequence.stem}") as output:
        assert output is not None  # it has a default name
        with progress_bar(1.0, "tracking", "", args.quiet) as advance:
            result = adate_visual.run(args.sequence, output.path, args.seed or 0, advance, first=first)
        content = {**result, "version": __version__}
        write_json(output.path / "result.json", content)
    if args.json:
        print_json(content)
    else:
        adate_visual.print_table(result)
    say(f"wrote {output.folder}")
    return 0


def _numbers(text: str) -> list[float]:
    values = numbers("--box", text, ("x", "y", "width", "height"), "51,53,87,290")
    if min(values[2:]) <= 0.0:
        raise ConfigError(f"--box {text!r}: width and height are pixels above 0, such as 51,53,87,290")
    return values

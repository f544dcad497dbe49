"""``camnet structure``: camera path and points from a video or images, with metres from odometry."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.cli.common import add_common, positive, progress_bar, say
from camnet.cli.output import output_folder, print_json, write_json
from camnet.errors import ConfigError

__all__ = ["add_parser"]

_DESCRIPTION = """Find the path of a camera and the points that it saw, by bundle adjustment. With odometry lengths are
metres and their uncertainty is stated; without it the size is arbitrary, and the output says so.
Writes points.ply, path_tum.txt, path_kitti.txt, structure.mp4 (annotated) and result.json.

  camnet structure drive.mp4 --camera camera.yaml --odometry wheels.txt
  camnet structure PHOTOGRAPHS --board 9x6
  camnet structure PHOTOGRAPHS --board 9x6 --mask MASKS --odometry relative_to_the_board.txt

--odometry is in TUM's format, a line "t x y z qx qy qz qw" a camera pose: for a video at any times that cover it, for a
folder a line an image. Exit status 1 if odometry and images do not fit each other."""


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "structure",
        help="camera path and points from a video or images",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("source", type=Path, help="a video file, or a folder of numbered images")
    parser.add_argument(
        "--odometry", type=Path, metavar="FILE", help="the odometry's camera poses, TUM's format"
    )
    parser.add_argument("--camera", type=Path, metavar="FILE", help="intrinsics, OpenCV's YAML or XML")
    parser.add_argument(
        "--mask",
        type=Path,
        metavar="IMAGE|FOLDER",
        help="points are only where it is not zero; a folder: a mask for each image, in their order",
    )
    parser.add_argument(
        "--board", metavar="COLSxROWS", help="the points are a checkerboard's inner corners, such as 9x6"
    )
    parser.add_argument(
        "--noise-px", type=positive, default=0.5, metavar="PX", help="noise of a corner (default: 0.5)"
    )
    parser.add_argument(
        "--step-noise",
        type=positive,
        default=0.1,
        metavar="SHARE",
        help="noise of odometry's steps (default: 0.1)",
    )
    parser.add_argument(
        "--turn-noise",
        type=positive,
        default=0.02,
        metavar="RAD",
        help="noise of odometry's turns (default: 0.02)",
    )
    parser.add_argument(
        "--scale-sd",
        type=positive,
        default=0.1,
        metavar="SHARE",
        help="SD of odometry's scale (default: 0.1)",
    )
    add_common(parser, "runs/structure-NAME, or a number after it if that is taken")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Reconstruct and write."""
    from camnet.estimation.structure.reconstruct import ReconstructionSettings
    from camnet.experiments import structure_video

    given = structure_video.StructureInput(
        args.source,
        args.odometry,
        args.camera,
        args.mask,
        None if args.board is None else _board(args.board),
        ReconstructionSettings(
            noise_px=args.noise_px,
            step_share=args.step_noise,
            step_turn_rad=args.turn_noise,
            scale_sd=args.scale_sd,
        ),
    )
    with output_folder(args, "structure", f"structure-{args.source.stem}") as output:
        assert output is not None  # it has a default name
        with progress_bar(1.0, "structure", "", args.quiet) as advance:
            result = structure_video.run(given, output.path, advance)
        content = {**result, "version": __version__}
        write_json(output.path / "result.json", content)
    if args.json:
        print_json(content)
    else:
        structure_video.print_table(result)
    if not result["metric"]:
        say("no odometry: lengths have no unit")
    say(f"wrote {output.folder}")
    return 0 if result["consistent"] else 1


def _board(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([0-9]{1,3})x([0-9]{1,3})", text)
    if found is None or min(int(found[1]), int(found[2])) < 3:
        raise ConfigError(f"--board {text!r}: inner corners across and down, at least 3 each, such as 9x6")
    return int(found[1]), int(found[2])

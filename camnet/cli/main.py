"""The ``camnet`` program. Exit status: 0 success, 1 failure, 2 bad input."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress

# Numerical libraries must see these before they load: one thread keeps sums in one order on every machine.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from camnet import __version__  # noqa: E402 - the thread counts above come first
from camnet.cli import (  # noqa: E402
    bench,
    certify,
    completion,
    coverage,
    design,
    evaluate,
    falsify,
    futures,
    identify,
    log,
    report,
    reproduce,
    simulate,
    structure,
    track,
    track_video,
    train,
    warm_up,
    worlds,
)
from camnet.cli.messages import configure  # noqa: E402
from camnet.cli.output_place import plain_words  # noqa: E402
from camnet.cli.parser import Parser  # noqa: E402
from camnet.errors import CamnetError, OutputError, SimulationError, WorkerError  # noqa: E402
from camnet.processes.stop import TerminatedError, stop_on_signals  # noqa: E402

__all__ = ["STOPPED", "build_parser", "main", "run"]

#: what `run` returns when a signal stopped it; the exit status is 1
STOPPED = -1

_EPILOG = """examples:
  camnet worlds                                     what ships with camnet
  camnet simulate quickstart --out runs/first       simulate, learn, hand off; writes a report
  camnet report runs/first                          draw the report again
  camnet certify quickstart                         how long may the target stay unseen?
  camnet coverage stationary_certified              how much do its cameras see, and how well?
  camnet design --roads city.net.xml --off-max 120  the fewest cameras that certify a city
  camnet evaluate --episodes 20                     agents against each other on the same episodes

camnet COMMAND --help teaches a command. Exit status: 0 success, 1 failure, 2 bad input.
"""


def build_parser() -> Parser:
    """Return the parser of the whole program."""
    parser = Parser(
        prog="camnet",
        description="Simulate, certify and train camera networks that hand targets over.",
        epilog=_EPILOG,
    )
    parser.add_argument("--version", action="version", version=f"camnet {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in (
        simulate,
        certify,
        coverage,
        falsify,
        identify,
        futures,
        design,
        train,
        evaluate,
        worlds,
        log,
        report,
        reproduce,
        track,
        track_video,
        structure,
        bench,
        warm_up,
        completion,
    ):
        module.add_parser(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status; without any words, show the help."""
    status = run(list(sys.argv[1:] if argv is None else argv))
    return 1 if status == STOPPED else status


def run(words: list[str]) -> int:
    """Run one command and return its exit status, or `STOPPED`."""
    parser = build_parser()
    if not words:
        parser.print_help()
        return 0
    try:
        args = parser.parse_args(words)
        if args.quiet and args.log_level in ("debug", "info"):
            parser.error(f"--quiet and --log-level {args.log_level}: give one of them")
    except SystemExit as end:  # help, version, or words that cannot be read
        return int(end.code or 0)
    configure(args.log_level, args.quiet)
    try:
        with stop_on_signals():
            status = int(args.run(args))
        sys.stdout.flush()  # a full disk shows here, not when the interpreter ends
        return status
    except (SimulationError, OutputError, WorkerError) as error:
        print(f"camnet: {error}", file=sys.stderr)
        return 1
    except CamnetError as error:
        print(f"camnet: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("camnet: interrupted", file=sys.stderr)
        return STOPPED
    except TerminatedError as error:
        print(f"camnet: {error}", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:  # the reader of our output left
        _close_output()
        return 1
    except MemoryError as error:
        print(f"camnet: out of memory ({error or 'no more could be had'}): ask for less", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"camnet: {plain_words(error)}", file=sys.stderr)
        _close_output()
        return 1


def _close_output() -> None:
    """Send what standard output cannot take to nowhere: the interpreter would try again when it ends."""
    try:
        sys.stdout.flush()
        return
    except (OSError, ValueError):
        pass
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


if __name__ == "__main__":
    from camnet.cli.program import program

    program()

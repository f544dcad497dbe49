"""Output folders that are whole or absent, folders that are gone on with, and the JSON object on standard output."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from camnet.cli.output_place import clear, close_to, open_place, plain_words
from camnet.errors import CamnetError, OutputError
from camnet.storage.lock import FolderBusyError, folder_lock
from camnet.storage.marker import MARKER, files_in, write_marker
from camnet.storage.partial import (
    keep_failed,
    make_partial,
    put_in_place,
    remove_partial,
    sweep_beside,
    sweep_inside,
)
from camnet.storage.whole_file import write_json

__all__ = [
    "Output",
    "output_folder",
    "print_json",
    "resumed_folder",
    "write_json",
]


@dataclass(slots=True)
class Output:
    """A folder that is being written.

    Attributes
    ----------
    path : where its files go for now
    folder : where they will be
    complete : whether the results are all there
    """

    path: Path
    folder: Path
    complete: bool = False

    def results_stand(self) -> None:
        """State that the results are written: whatever fails from here on (pictures, a page) loses none of them."""
        self.complete = True


@contextmanager
def output_folder(
    args: argparse.Namespace, kind: str, default_name: str | None = None, more_files: Sequence[str] = ()
) -> Iterator[Output | None]:
    """Yield a folder to write that becomes ``--out`` at the end; None if no folder is asked for.

    It is made, under a temporary name, before anything is computed, so that a place that cannot be written shows at
    once. It is locked: a second run on the same folder is refused. On success it is renamed to its name; what it
    replaces (``--force``) is moved aside first. When something fails, what was written is kept and the message says
    where, unless the input was wrong or the run was stopped: then nothing is left, except results that stand.

    Parameters
    ----------
    args : with ``out`` and ``force``
    kind : what writes it, for the marker
    default_name : of the folder in ``runs`` when there is no ``--out``, with a number if that is taken; None: no folder
    more_files : files that later commands add to the folder

    Raises
    ------
    ConfigError
        ``--out`` cannot be a folder of its own, holds something, or is being written by another run.
    OutputError
        The folder could not be written.
    """
    if args.out is None and default_name is None:
        yield None
        return
    with ExitStack() as stack:
        with _writable(args.out or f"runs/{default_name}"):
            folder = _lock_first_free(stack, args, default_name or "")
            sweep_beside(folder)
            output = Output(make_partial(folder, kind), folder)
        try:
            yield output
        except BaseException as error:
            _fail(output, kind, more_files, error)
            raise
        _finish(output, kind, more_files)


@contextmanager
def _writable(out: str | Path) -> Iterator[None]:
    """Say which folder cannot be written, whatever file showed it (OutputError)."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"folder {str(out)!r} cannot be written: {plain_words(error)}") from error


def _lock_first_free(stack: ExitStack, args: argparse.Namespace, default_name: str) -> Path:
    """Lock ``--out``, or the first folder of the default name that is free."""
    if args.out is not None:
        folder = open_place(stack, args.out, True)
        stack.enter_context(folder_lock(folder))
        clear(folder, args.force)
        return folder
    for number in range(1, 10_000):
        name = default_name if number == 1 else f"{default_name}-{number}"
        with suppress(FolderBusyError), ExitStack() as attempt:
            folder = open_place(attempt, Path("runs") / name, False)
            if os.path.lexists(folder):
                continue
            attempt.enter_context(folder_lock(folder))
            if not os.path.lexists(folder):
                stack.push(attempt.pop_all())
                return folder
    raise OutputError(f"runs/{default_name}: 10,000 folders of this name are there already; remove some")


def _finish(output: Output, kind: str, more_files: Sequence[str]) -> None:
    try:
        write_marker(output.path, kind, [*map(close_to, files_in(output.path)), *more_files])
        put_in_place(output.path, output.folder)
    except (OSError, CamnetError) as error:
        kept = keep_failed(output.path, output.folder)
        raise OutputError(f"{output.folder}: {plain_words(error)}; what was written is in {kept}") from error


def _fail(output: Output, kind: str, more_files: Sequence[str], error: BaseException) -> None:
    """Keep what is worth keeping of a run that failed; expected failures say where it is."""
    if output.complete:
        _finish(output, kind, more_files)
        if isinstance(error, Exception):
            raise OutputError(
                f"the results are in {output.folder}, but then: {plain_words(error)}"
            ) from error
        return
    if isinstance(error, CamnetError) or not isinstance(error, Exception):
        remove_partial(output.path)
        return
    kept = keep_failed(output.path, output.folder)
    where = "" if kept is None else f"; what was written before is in {kept}"
    if isinstance(error, OSError):
        what = str(output.folder) if error.filename is None else "stopped"
        raise OutputError(f"{what}: {plain_words(error)}{where}") from error
    if kept is not None:
        print(f"camnet: what was written before the failure is in {kept}", file=sys.stderr)


@contextmanager
def resumed_folder(out: str | Path, kind: str, files: Sequence[str], anew: bool) -> Iterator[Path]:
    """Yield the folder ``out``, in which a run goes on where an earlier one stopped, under its lock.

    Two runs never write it at once: the second is refused. Files of killed runs that were not finished are removed.

    Parameters
    ----------
    kind : what writes the folder; a folder of another kind is refused
    files : patterns of the files that this command writes there
    anew : remove those of an earlier run first (``--force``)

    Raises
    ------
    ConfigError
        The folder holds something that is not of this kind, or another run is writing it.
    OutputError
        It cannot be written.
    """
    with ExitStack() as stack:
        with _writable(out):
            folder = open_place(stack, out, True)
            stack.enter_context(folder_lock(folder))
            sweep_beside(folder)
            folder.mkdir(exist_ok=True)
            clear(folder, anew, kind)
        try:
            with _writable(out):
                write_marker(folder, kind, files)
                sweep_inside(folder)
            yield folder
        finally:
            with suppress(OSError):
                if [p.name for p in folder.iterdir()] == [MARKER]:
                    (folder / MARKER).unlink()
                    folder.rmdir()


def print_json(content: object) -> None:
    """Print one JSON object on standard output."""
    json.dump(content, sys.stdout, allow_nan=False)
    sys.stdout.write("\n")
    sys.stdout.flush()

"""Single runs of an experiment: in two processes or on a cluster, kept on disk as they finish.

A run's result is a file in ``.EXPERIMENT-runs`` beside the output folder; the name of the file's folder is a digest of
the settings and of the package's sources. So an experiment that was stopped goes on where it was, more seeds add to
those there, and nothing of an older program is taken for a result.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import camnet
from camnet.errors import DataError
from camnet.processes.place import LOCAL, Place
from camnet.settings import Settings
from camnet.storage.archive import read_archive, write_archive
from camnet.storage.plain import from_plain, to_plain

__all__ = ["KeptRuns", "digest"]

_LOG = logging.getLogger(__name__)
_FORM, _VERSION, _WORKERS = "camnet run", 1, 2
_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def digest(settings: Settings) -> str:
    """Return a short digest of settings and of every source file of the package."""
    total = hashlib.sha256(settings.model_dump_json().encode())
    for path in sorted(Path(camnet.__file__).parent.rglob("*.py")):
        total.update(path.read_bytes())
    return total.hexdigest()[:16]


class KeptRuns(Generic[_Job, _Result]):
    """Does the jobs of an experiment, each once.

    Parameters
    ----------
    experiment : its name
    settings : what all jobs have in common
    function : ``function(settings, job)`` does one job; a function of a module, since workers import it
    classes : of the records that results consist of
    """

    def __init__(
        self,
        experiment: str,
        settings: Settings,
        function: Callable[[Any, _Job], _Result],
        classes: Sequence[type],
    ) -> None:
        self._experiment, self._settings = experiment, settings
        self._function, self._classes = function, tuple(classes)

    def results(
        self,
        jobs: Sequence[_Job],
        name: Callable[[_Job], str],
        out_dir: Path | str | None,
        progress: Callable[[float], None] | None = None,
        workers: int = _WORKERS,
        place: Place = LOCAL,
    ) -> list[_Result]:
        """Results in the order of the jobs.

        Parameters
        ----------
        jobs : what to do; each has generators of its own, so results do not depend on the number of processes
        name : of a job, for its file
        out_dir : folder of the experiment, beside which results are kept; None: they are not kept
        progress : told the share of the jobs that is done
        workers : processes at most
        place : where the jobs are done; results are kept by this machine
        """
        folder = None
        if out_dir is not None:
            folder = Path(out_dir).parent / f".{self._experiment}-runs" / digest(self._settings)
            folder.mkdir(parents=True, exist_ok=True)
        done: dict[int, _Result] = {}
        for k, job in enumerate(jobs):
            kept = None if folder is None else _kept(folder / f"{name(job)}.npz", self._classes)
            if kept is not None:
                done[k] = kept
        left = [k for k in range(len(jobs)) if k not in done]
        if done:
            _LOG.info("%s: %d of %d runs are there already", self._experiment, len(done), len(jobs))
        if progress is not None and jobs:
            progress(len(done) / len(jobs))
        with place.workers(workers) as pool:
            for i, result in pool.finished(partial(self._function, self._settings), [jobs[k] for k in left]):
                done[left[i]] = result
                if folder is not None:
                    _keep(folder / f"{name(jobs[left[i]])}.npz", result)
                if progress is not None:
                    progress(len(done) / len(jobs))
        return [done[k] for k in range(len(jobs))]


def _keep(path: Path, result: object) -> None:
    arrays: dict[str, Any] = {}
    form = to_plain(result, arrays)
    write_archive(path, _FORM, _VERSION, {"result": form}, arrays)


def _kept(path: Path, classes: Sequence[type]) -> Any:  # noqa: ANN401 - of any experiment
    """Return the result of a job done before; None, with a message if its file is damaged, where it is to be done."""
    if not os.path.lexists(path):
        return None
    try:
        archive = read_archive(path, _FORM, _VERSION)
        return from_plain(archive.header.get("result"), archive.arrays, classes)
    except DataError as error:
        _LOG.warning("%s: %s; it is run again", path, error)
        return None

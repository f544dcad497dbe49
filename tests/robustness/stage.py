"""The valid files that cases start from, and the commands that read them."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from robustness import inputs
from robustness.case import Command
from robustness.formats import write_gpx, write_krtd, write_network

__all__ = ["COMMANDS", "Stage", "build_stage"]

_QUIET = ("--json", "--quiet")
_RUN = ("--no-report", "--out", "out", *_QUIET)
_PLAY = ("--episodes", "2", "--cycles", "4", "--jobs", "1", "--out", "kept", *_QUIET)
_CITY = ("certify", "--roads", "city.net.xml", "--off-max", "60", *_QUIET)

#: every command that cases are run with, by name
COMMANDS = {
    command.name: command
    for command in (
        Command("certify world", ("certify", "world.yaml", *_QUIET), ("world.yaml",)),
        Command("simulate world", ("simulate", "world.yaml", *_RUN), ("world.yaml",)),
        Command("simulate track", ("simulate", "track.yaml", *_RUN), ("track.yaml", "walk.csv")),
        Command("simulate gpx", ("simulate", "gpx.yaml", *_RUN), ("gpx.yaml", "walk.gpx")),
        Command("design tracks", ("design", "--tracks", "people.csv", "--off-max", "4", *_QUIET), ("people.csv",)),
        Command("certify cameras", ("certify", "--cameras", "cameras", *_QUIET), ("cameras/",)),
        Command("certify city", (*_CITY, "--cameras", "city.csv"), ("city.net.xml", "city.csv")),
        Command("simulate model", ("simulate", "world.yaml", "--model", "learned.npz", *_RUN), ("world.yaml", "learned.npz")),
        Command("certify model", ("certify", "world.yaml", "--model", "model.npz", *_QUIET), ("world.yaml", "model.npz")),
        Command("evaluate policy", ("evaluate", "--world", "world.yaml", "--agents", "policy.npz", *_PLAY), ("world.yaml", "policy.npz")),
        Command("evaluate again", ("evaluate", "--world", "world.yaml", "--agents", "nearest", *_PLAY), ("world.yaml", "kept/")),
        Command("report run", ("report", "run", "--no-video", "--quiet"), ("run/",), "run/report.html"),
    )
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stage:
    """Contents of all valid files, by name."""

    files: Mapping[str, bytes]

    def write(self, folder: Path, command: Command, instead: Mapping[str, bytes | None]) -> None:
        """Write what a command needs into a folder, with some files changed, added or (None) left out."""
        wanted = {
            name: content
            for name, content in self.files.items()
            if any(name == part or (part.endswith("/") and name.startswith(part)) for part in command.files)
        }
        for name, content in {**wanted, **instead}.items():
            if content is not None:
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)


def build_stage(saved: bool = True) -> Stage:
    """Make all valid files; what commands write is written by them, which also compiles what they need.

    Without ``saved`` nothing is there that an earlier run has left behind.
    """
    content = {name: text.encode() for name, text in _texts().items()}
    with tempfile.TemporaryDirectory(prefix="robustness-stage-") as name, _inside(Path(name)) as folder:
        Stage(content).write(folder, Command("all", (), tuple(content)), {})
        if saved:
            content |= _left_behind(folder)
        for command in COMMANDS.values():  # once in this process, so that its forks find everything compiled
            if all(any(name.startswith(part) for name in content) for part in command.files):
                Stage(content).write(folder, command, {})
                _run(
                    *(
                        word if word not in ("out", "kept") else f"warm {command.name}"
                        for word in command.argv
                    )
                )
    return Stage(content)


def _texts() -> dict[str, str]:
    return {
        "world.yaml": inputs.dump(inputs.WORLD),
        "track.yaml": inputs.dump(inputs.TRACK_WORLD),
        "gpx.yaml": inputs.dump(inputs.GPX_WORLD),
        "walk.csv": inputs.table(inputs.fixes()),
        "people.csv": inputs.table(inputs.fixes()),
        "walk.gpx": write_gpx(inputs.gpx()),
        "cameras/north.krtd": write_krtd(*inputs.krtd(*inputs.NORTH)),
        "cameras/south.krtd": write_krtd(*inputs.krtd(*inputs.SOUTH)),
        "city.net.xml": write_network(inputs.network()),
        "city.csv": inputs.CAMERAS,
    }


def _left_behind(folder: Path) -> dict[str, bytes]:
    """Learned models, a run's folder, kept episodes and a policy."""
    drawn = ("--duration", "1", "--no-video", "--quiet", "--out")
    _run("simulate", "world.yaml", *drawn, "run", "--save-model", "learned.npz")
    _run("certify", "world.yaml", "--learn", "--duration", "90", "--out", "learned", *_QUIET)
    _run(*COMMANDS["evaluate again"].argv)
    found = {"policy.npz": inputs.policy()}
    for made in ("learned.npz", "run", "kept", "learned/model.npz"):
        found |= _collected(folder, made)
    found["model.npz"] = found.pop("learned/model.npz")
    return found


def _collected(folder: Path, name: str) -> dict[str, bytes]:
    path = folder / name
    found = [path] if path.is_file() else [p for p in sorted(path.rglob("*")) if p.is_file()]
    return {str(p.relative_to(folder)): p.read_bytes() for p in found}


def _run(*words: str) -> None:
    from camnet.cli.main import main

    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        status = main(words)
    if status not in (0, 1):  # 1: a verdict that is not reached
        raise RuntimeError(f"camnet {' '.join(words)}: exit {status}: {said.getvalue()[-2000:]}")


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[Path]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield folder
    finally:
        os.chdir(before)

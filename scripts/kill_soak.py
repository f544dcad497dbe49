"""Kill commands at random times, run them again, and compare with runs that were left alone.

For every round a command is started and killed (SIGKILL, the main process alone) one to three times, then run to its
end. Every other kill comes at a random time, the others just when a file or folder has appeared or vanished beside or
in the output folder (a random one of the changes that an undisturbed run makes), so that writes are hit too. Then must
hold:

- five seconds after a kill no process of that run is alive (found by a mark in its environment, in /proc);
- the results are those of a run that was left alone, bit for bit; wall times and what is named in `TIMES` apart;
- the folder holds the same files, and nothing is left beside it: no partial folder, lock, or temporary name, and in the
  folder for temporary files nothing that a run that was left alone does not leave (PyTorch keeps a cache there).

    python scripts/kill_soak.py --kills 60 --seed 1
    python scripts/kill_soak.py --kills 6 --commands simulate,evaluate

Linux only. ``train`` needs the extra of that name in the interpreter. Exit status 1 if anything fails.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
#: keys of JSON that hold wall times
TIMES = {"wall_s", "real_time_factor", "ms_per_plan"}
#: files that no result is read from: event logs with times, markers, the learner's state (its policy is compared)
NOT_COMPARED = ("tensorboard/", ".camnet", "checkpoint.pt")
_MARK = "CAMNET_KILL_SOAK"
_SMALL = (
    *("estimator=ekf", "environments=2", "max_cycles=12", "imitation_steps=100", "imitation_epochs=1"),
    *("rollout_steps=16", "chunk_steps=128", "minibatch=64", "hidden=[8]", "threads=1"),
)
COMMANDS: dict[str, tuple[str, ...]] = {
    "simulate": ("simulate", "quickstart", "--seeds", "1-3", "--duration", "4", "--jobs", "2"),
    "evaluate": (
        *("evaluate", "--world", "quickstart", "--agents", "ekf,nearest", "--episodes", "10"),
        *("--cycles", "40", "--back-end", "pybullet", "--jobs", "2"),
    ),
    "train": ("train", "--steps", "1024", *(word for text in _SMALL for word in ("--set", text))),
    # it starts anew, also where a run ended before it was killed
    "reproduce": ("reproduce", "adate-navigation", "--seeds", "2", "--force"),
    "report": ("report",),
}


@dataclass
class Run:
    """A command on a folder, started as a process of its own."""

    command: tuple[str, ...]
    mark: str
    process: subprocess.Popen[str]

    def wait(self) -> str:
        """Wait for its end; return what is wrong with it."""
        said, _ = self.process.communicate()
        return "" if self.process.returncode == 0 else f"exit status {self.process.returncode}: {said[-500:]}"


def temporary(folder: Path) -> Path:
    """Return the folder for temporary files of the runs of an output folder."""
    return folder.parent.with_name(f"{folder.parent.name}-temporary")


def start(name: str, folder: Path, python: str) -> Run:
    """Start a command on a folder."""
    mark = uuid.uuid4().hex
    temporary(folder).mkdir(exist_ok=True)
    words = COMMANDS[name]
    # a name without its place: results that hold it are the same everywhere
    command = (*words, folder.name) if name == "report" else (*words, "--out", folder.name)
    process = subprocess.Popen(
        [python, "-m", "camnet.cli.main", *command, "--quiet"],
        cwd=folder.parent,
        env={**os.environ, _MARK: mark, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary(folder))},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    return Run(command, mark, process)


def alive(mark: str) -> list[int]:
    """Return the processes that have a mark in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                if f"{_MARK}={mark}".encode() in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except OSError:  # it is gone, or another user's
                pass
    return found


def listing(place: Path) -> set[str]:
    """Return all names in a folder and in its folders; what vanishes meanwhile may be missing."""
    return {os.path.join(root, name) for root, dirs, files in os.walk(place) for name in [*dirs, *files]}


def watch(run: Run, place: Path, changes: int | None) -> int:
    """Wait until so many changes of names in a folder were seen, or the run's end; return how many there were."""
    seen, before = 0, listing(place)
    while run.process.poll() is None and (changes is None or seen < changes):
        time.sleep(0.001)
        now = listing(place)
        seen, before = seen + (now != before), now
    return seen


def kill(run: Run) -> list[str]:
    """Kill a run now; return what is wrong five seconds later."""
    run.process.send_signal(signal.SIGKILL)
    run.process.communicate()
    end = time.monotonic() + 5.0
    while (left := alive(run.mark)) and time.monotonic() < end:
        time.sleep(0.1)
    for process in left:
        os.kill(process, signal.SIGKILL)
    return [f"{len(left)} processes alive 5 s after the kill"] if left else []


def _plain(value: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if k not in TIMES}
    return [_plain(v) for v in value] if isinstance(value, list) else value


def _content(path: Path) -> bytes:
    if path.suffix == ".json":
        return json.dumps(_plain(json.loads(path.read_text(encoding="utf-8")))).encode()
    if path.suffix == ".jsonl":  # lines come in the order in which workers finish
        return b"\n".join(sorted(line for line in path.read_bytes().splitlines() if line))
    return path.read_bytes()


def results(folder: Path) -> dict[str, str]:
    """Digest of every file that holds results."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    names = {p: str(p.relative_to(folder)) for p in files}
    return {
        names[p]: hashlib.sha256(_content(p)).hexdigest()
        for p in files
        if not any(part in f"{names[p]}" for part in NOT_COMPARED)
    }


def differing(one: dict[str, str], other: dict[str, str]) -> str:
    """Return the names of files that are not the same."""
    return ", ".join(sorted(n for n in {*one, *other} if one.get(n) != other.get(n)))


def leftovers(place: Path, folder: Path, usual: set[str]) -> list[str]:
    """Return what is beside the folder, what is with the temporary files that is not usual, and such names inside."""
    beside = [p.name for p in place.iterdir() if p != folder]
    beside += [p.name for p in temporary(folder).iterdir() if p.name not in usual]
    inside = [p.name for p in folder.rglob("*") if "partial" in p.name or "lock" in p.name]
    return [f"left behind: {', '.join([*beside, *inside])}"] if beside or inside else []


def prepare(name: str, folder: Path, run_folder: Path) -> None:
    """Give ``report`` a run to draw."""
    if name == "report":
        shutil.copytree(run_folder, folder)


def soak(name: str, kills: int, rng: random.Random, base: Path, python: str) -> dict[str, Any]:
    """Kill one command so many times; return counts and what was wrong."""
    run_folder = base / "a-run"
    if name == "report" and not run_folder.is_dir():
        words = (
            "simulate",
            "quickstart",
            "--duration",
            "3",
            "--no-report",
            "--out",
            str(run_folder),
            "--quiet",
        )
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        command = [python, "-m", "camnet.cli.main", *words]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    alone, again = base / f"{name}-alone" / "out", base / f"{name}-again" / "out"
    took = 0.0
    for folder in (alone, again):
        folder.parent.mkdir()
        prepare(name, folder, run_folder)
        begin = time.monotonic()
        run = start(name, folder, python)
        changes = watch(run, folder.parent, None)
        if fault := run.wait():
            return {"kills": 0, "rounds": 0, "faults": [f"left alone: {fault}"]}
        took = time.monotonic() - begin
    wanted = results(alone)
    if names := differing(wanted, results(again)):
        return {"kills": 0, "rounds": 0, "faults": [f"two runs that were left alone differ: {names}"]}
    usual = {p.name for p in temporary(alone).iterdir()}  # caches of libraries, not ours
    faults = leftovers(alone.parent, alone, usual)
    done = rounds = at_writes = ended = 0
    while done < kills:
        place = base / f"{name}-{rounds}"
        folder = place / "out"
        place.mkdir()
        prepare(name, folder, run_folder)
        for _ in range(min(rng.randint(1, 3), kills - done)):
            run = start(name, folder, python)
            if done % 2:
                watch(run, place, rng.randint(1, max(1, changes)))
                at_writes += run.process.poll() is None
            else:
                with suppress(subprocess.TimeoutExpired):
                    run.process.wait(rng.uniform(0.0, took))
            ended += run.process.poll() is not None
            faults += kill(run)
            done += 1
        if fault := start(name, folder, python).wait():
            faults.append(f"round {rounds}: run again: {fault}")
        elif names := differing(wanted, results(folder)):
            faults.append(f"round {rounds}: other results than alone: {names}")
        faults += [f"round {rounds}: {text}" for text in leftovers(place, folder, usual)]
        rounds += 1
        words = f"{name}: {done} of {kills} kills, {rounds} rounds, {len(faults)} faults"
        print("; ".join([words, *faults[-1:]]), file=sys.stderr, flush=True)
    return {
        "kills": done,
        "at_writes": at_writes,
        "ended_before": ended,
        "rounds": rounds,
        "alone_s": round(took, 1),
        "files": len(wanted),
        "faults": faults,
    }


def main() -> int:
    """Run all and print one JSON object."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--kills", type=int, default=60, help="in all (default 60)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--commands", default=",".join(COMMANDS), help=f"of {', '.join(COMMANDS)} (default: all)"
    )
    parser.add_argument("--python", default=sys.executable, help="interpreter with camnet's requirements")
    args = parser.parse_args()
    names = args.commands.split(",")
    if unknown := [n for n in names if n not in COMMANDS]:
        parser.error(f"--commands {unknown[0]!r}: give some of {', '.join(COMMANDS)}")
    if not Path("/proc/self/environ").is_file() or args.kills < len(names):
        parser.error("this needs Linux, and at least one kill for every command")
    rng, content = random.Random(args.seed), {}
    with tempfile.TemporaryDirectory(prefix="camnet-soak-") as base:
        for k, name in enumerate(names):
            share = args.kills // len(names) + (k < args.kills % len(names))
            content[name] = soak(name, share, rng, Path(base), args.python)
    faults = sum(len(c["faults"]) for c in content.values())
    kills = sum(c["kills"] for c in content.values())
    print(json.dumps({"seed": args.seed, "kills": kills, "faults": faults, "commands": content}, indent=2))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

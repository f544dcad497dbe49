"""The program behind ``scripts/robustness.py``: draws cases, runs them, judges and counts."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

from robustness.case import Answer, Case
from robustness.generate import KINDS, draw
from robustness.judge import Base, answer_of, faults
from robustness.outcome import Outcome
from robustness.runner import run_all, run_words
from robustness.stage import COMMANDS, Stage, build_stage

__all__ = ["Tally", "bases_of", "main"]

_SHOWN = 40


class Tally:
    """Counts of cases and the list of faults."""

    def __init__(self) -> None:
        self.kinds: Counter[tuple[str, str]] = Counter()
        self.natures: Counter[str] = Counter()
        self.faults: list[dict[str, Any]] = []
        self.real = 0
        self.longest_s = 0.0
        self.peak_bytes = 0

    def add(self, case: Case, real: bool, outcome: Outcome, answer: Answer | None, wrong: list[str]) -> None:
        """Count one case."""
        self.kinds[case.kind, "other" if answer is None else answer.value] += 1
        self.natures[case.nature.value] += 1
        self.real += real
        self.longest_s = max(self.longest_s, outcome.cpu_s)
        self.peak_bytes = max(self.peak_bytes, outcome.peak_bytes)
        if wrong:
            words = " ".join([*case.command.argv, *case.extra])
            self.faults.append(
                {"kind": case.kind, "label": case.label, "nature": case.nature.value, "command": words, "faults": wrong,
                 "status": outcome.status, "stderr": outcome.stderr[-2000:]}
            )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """Return the counts as plain data."""
        kinds: dict[str, dict[str, int]] = {}
        for (kind, answer), count in sorted(self.kinds.items()):
            kinds.setdefault(kind, {})[answer] = count
        return {
            "cases": sum(self.natures.values()),
            "real_processes": self.real,
            "natures": dict(self.natures),
            "kinds": kinds,
            "faults": len(self.faults),
            "longest_cpu_s": round(self.longest_s, 2),
            "peak_mib": self.peak_bytes >> 20,
        }


def bases_of(stage: Stage) -> dict[str, Base]:
    """Return the result of every command on the unchanged stage; two runs of each must agree."""
    bases = {}
    for command in COMMANDS.values():
        first, second = run_words(stage, command), run_words(stage, command)
        if first.status not in (0, 1) or Base.of(command, first) != Base.of(command, second):
            raise SystemExit(
                f"{command.name}: the unchanged input fails or is not repeatable: {first.stderr}"
            )
        bases[command.name] = Base.of(command, first)
    return bases


def _with_reals(cases: Iterator[Case], seed: int, count: int, real: int) -> Iterator[tuple[Case, bool]]:
    """Mark ``real`` of the cases, at random, to run as processes from the start."""
    chosen = set(Random(seed).sample(range(count), min(real, count)))
    for k, case in enumerate(cases):
        yield case, k in chosen


def main() -> None:
    """Run cases; the exit status is 1 if any is at fault."""
    args = _arguments()
    started = time.monotonic()
    stage = build_stage()
    bases = bases_of(stage)
    print(f"prepared in {time.monotonic() - started:.0f} s", flush=True)
    reports = [_run(args, stage, bases, seed) for seed in args.seed]
    if args.json is not None:
        content = reports[0] if len(reports) == 1 else {"seeds": reports}
        args.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    sys.exit(1 if any(report["faults"] for report in reports) else 0)


def _run(args: argparse.Namespace, stage: Stage, bases: dict[str, Base], seed: int) -> dict[str, Any]:
    """Run the cases of one seed, print what is at fault and the counts, and return them."""
    started = time.monotonic()
    tally = Tally()
    cases = _with_reals(draw(stage, seed, args.cases, args.kinds), seed, args.cases, args.real)
    for k, (case, real, outcome) in enumerate(run_all(stage, cases, args.jobs), start=1):
        wrong = faults(case, outcome, bases)
        tally.add(case, real, outcome, answer_of(case, outcome, bases), wrong)
        if wrong:
            print(f"{case.kind}, {case.label} ({case.nature.value}): {'; '.join(wrong)}", flush=True)
            if len(tally.faults) <= _SHOWN:
                print("    " + outcome.stderr[-1200:].strip().replace("\n", "\n    "), flush=True)
            if args.keep is not None:
                stage.write(args.keep / f"{seed}-{len(tally.faults)}", case.command, case.files)
        if k % 250 == 0:
            print(f"{k} cases, {len(tally.faults)} faults, {time.monotonic() - started:.0f} s", flush=True)
    return _report(tally, seed, time.monotonic() - started)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="robustness.py", description="Generated inputs against the program."
    )
    parser.add_argument("--seed", type=int, nargs="+", default=[0], help="one or more")
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument(
        "--real", type=int, default=100, help="of them, as processes from the start (default 100)"
    )
    parser.add_argument(
        "--kinds", nargs="*", default=(), choices=list(KINDS), help="of inputs (default: all)"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, help="file for counts and faults")
    parser.add_argument("--keep", type=Path, help="folder for the inputs of faults")
    return parser.parse_args()


def _report(tally: Tally, seed: int, seconds: float) -> dict[str, Any]:
    """Print the counts of one seed and return them with the faults."""
    content = {"seed": seed, **tally.as_dict(), "seconds": round(seconds)}
    print(json.dumps({key: value for key, value in content.items() if key != "kinds"}))
    answers = ("unchanged", "refused", "failed", "other")
    print(f"{'kind':12s}" + "".join(f"{answer:>11s}" for answer in answers))
    for kind, counts in content["kinds"].items():
        print(f"{kind:12s}" + "".join(f"{counts.get(answer, 0):11d}" for answer in answers), flush=True)
    return {**content, "list": tally.faults}

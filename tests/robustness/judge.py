"""Whether what happened is among the answers that are right."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robustness.case import Answer, Case, Command
from robustness.outcome import Outcome
from robustness.runner import CPU_S

__all__ = ["Base", "answer_of", "faults", "result_of"]

#: what two runs of one input may differ in: names and paths, clocks, the version
_SPARED = frozenset({"version", "config", "real_time_factor", "wall_s", "file"})
_UNFINISHED = re.compile(r"(^|/)\.(?!camnet\.json$)|partial|\.lock$|\.tmp$")


def result_of(command: Command, outcome: Outcome) -> Any:
    """Return the result of a command without what may differ between two runs of one input."""
    if command.result is not None:
        return outcome.result
    content = _spared(json.loads(outcome.stdout))
    content.pop("seconds", None)  # how long the solver took
    return content


@dataclass(frozen=True, slots=True)
class Base:
    """What a command answers to the unchanged input: 0, or 1 where its verdict is that something is not reached."""

    status: int
    result: Any

    @classmethod
    def of(cls, command: Command, outcome: Outcome) -> Base:
        """Take it from an outcome."""
        return cls(outcome.status, result_of(command, outcome))


def answer_of(case: Case, outcome: Outcome, bases: Mapping[str, Base]) -> Answer | None:
    """Return which answer an exit status stands for."""
    if outcome.status == bases[case.command.name].status:
        return Answer.UNCHANGED
    return {0: Answer.UNCHANGED, 1: Answer.FAILED, 2: Answer.REFUSED}.get(outcome.status)


def faults(case: Case, outcome: Outcome, bases: Mapping[str, Base]) -> list[str]:
    """Return what is wrong with an outcome; nothing if it is as expected."""
    found = []
    answer = answer_of(case, outcome, bases)
    if "Traceback (most recent call last)" in outcome.stderr:
        found.append("traceback")
    if answer is None:
        found.append(f"ended with status {outcome.status}")
    elif answer not in case.answers:
        found.append(f"answered {answer.value}, not {' or '.join(sorted(a.value for a in case.answers))}")
    elif answer is Answer.UNCHANGED:
        found += _differs(case, outcome, bases)
    elif not outcome.stderr.strip():
        found.append("said nothing")
    elif answer is Answer.REFUSED and case.mentions and not any(m in outcome.stderr for m in case.mentions):
        found.append(f"the message names none of {', '.join(map(repr, case.mentions))}")
    if outcome.cpu_s > CPU_S:
        found.append(f"took {outcome.cpu_s:.1f} s of processor time")
    return [*found, *_leftovers(case, outcome, answer)]


def _differs(case: Case, outcome: Outcome, bases: Mapping[str, Base]) -> list[str]:
    base = bases[case.command.name]
    if outcome.status != base.status:
        return [f"ended with status {outcome.status}, not {base.status}"]
    try:
        result = result_of(case.command, outcome)
    except ValueError:
        return ["printed no JSON object"]
    return [] if result == base.result else [f"another result: {_where(base.result, result)}"]


def _leftovers(case: Case, outcome: Outcome, answer: Answer | None) -> list[str]:
    """Refusals change no file; nothing leaves unfinished files; inputs stay as they are."""
    new = sorted(set(outcome.after) - set(outcome.before))
    lost = sorted(set(outcome.before) - set(outcome.after))
    found = [f"removed {name}" for name in lost]
    if answer is Answer.REFUSED:
        altered = [
            name for name, digest in outcome.before.items() if outcome.after.get(name, digest) != digest
        ]
        found += [f"left {name}" for name in new] + [f"changed {name}" for name in altered]
    elif answer is not Answer.FAILED:  # a failure keeps what it has and says where
        found += [f"left unfinished {name}" for name in new if _UNFINISHED.search(name)]
    return found[:5]


def _spared(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _spared(item) for key, item in value.items() if key not in _SPARED}
    return [_spared(item) for item in value] if isinstance(value, list) else value


def _where(a: Any, b: Any, path: str = "") -> str:
    """Name the first place at which two results differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted(set(a) | set(b)):
            if a.get(key) != b.get(key):
                return _where(a.get(key), b.get(key), f"{path}.{key}")
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            if x != y:
                return _where(x, y, f"{path}[{k}]")
    return f"{path or 'whole'}: {str(a)[:60]} / {str(b)[:60]}"

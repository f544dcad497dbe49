from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from robustness.case import Answer, Case, Nature
from robustness.generate import KINDS, draw
from robustness.judge import Base, faults
from robustness.runner import run_all, run_words
from robustness.stage import COMMANDS, Stage, build_stage
from robustness.yaml_cases import HARMLESS, MEANING


@pytest.fixture(scope="module")
def stage() -> Stage:
    return build_stage(saved=False)


def test_cases_are_drawn_in_their_shares_and_the_same_from_one_seed(stage: Stage) -> None:
    texts = ("yaml", "csv", "gpx", "krtd", "sumo")
    cases = list(draw(stage, 5, 1500, texts))
    again = list(draw(stage, 5, 300, texts))
    assert [(c.label, c.files) for c in again] == [(c.label, c.files) for c in cases[:300]]
    natures = Counter(case.nature for case in cases)
    assert natures[Nature.MEANING] >= 0.4 * len(cases)
    assert natures[Nature.HARMLESS] >= 0.2 * len(cases)
    assert {c.kind for c in cases} == set(texts) < set(KINDS)
    assert all(case.answers for case in cases)


def test_the_judge_finds_what_is_wrong(stage: Stage) -> None:
    """Right answers pass; another result, an accepted fault, a refused harmless change and a leftover do not."""
    command = COMMANDS["certify cameras"]
    base = {command.name: Base.of(command, run_words(stage, command))}
    other = stage.files["cameras/north.krtd"].replace(b"1500.0", b"1400.0")
    unchanged, refused = frozenset({Answer.UNCHANGED}), frozenset({Answer.REFUSED})

    def case(content: bytes, answers: frozenset[Answer], *mentions: str) -> Case:
        files = {"cameras/north.krtd": content}
        return Case("krtd", "x", Nature.MEANING, command, files, (), answers, mentions)

    tried = {
        "right": case(stage.files["cameras/north.krtd"], unchanged),
        "another result": case(other, unchanged),
        "answered unchanged, not refused": case(other, refused),
        "answered refused, not unchanged": case(b"", unchanged),
        "names none of 'nobody'": case(b"", refused, "nobody"),
    }
    done = {id(c): (c, o) for c, _, o in run_all(stage, [(c, False) for c in tried.values()], 2)}
    for words, one in tried.items():
        found = faults(one, done[id(one)][1], base)
        assert (not found) if words == "right" else any(words in fault for fault in found), (words, found)


def test_a_few_cases_of_worlds_are_answered_rightly(stage: Stage) -> None:
    """The whole is ``scripts/robustness.py``; here every change of a world once."""
    from random import Random

    makers = [*MEANING, *HARMLESS]
    cases = [make(Random(k)) for k, make in enumerate(makers)]
    bases = {c.name: Base.of(c, run_words(stage, c)) for c in {case.command for case in cases}}
    for case, _, outcome in run_all(stage, [(case, k == 0) for k, case in enumerate(cases)], 2):
        assert not faults(case, outcome, bases), (case.label, outcome.stderr)

"""Every example of the README and of every ``--help`` runs, on small inputs and shortened where it would take long.

Examples are read from the texts themselves; each must stand in ``CASES``, which says what is appended to shorten it
(later options win), or why it is read only. A new example without a case, and a case without its example, fail.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from camnet.cli.main import build_parser, main

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
_PROGRAMS = ("camnet", "python", "python3", "pip", "source", "cp", "tensorboard")


@dataclass(frozen=True)
class Case:
    """How an example is tried: shortened by ``more``, after ``needs``, with ``replaced`` words; or ``only_read``.

    It ends with ``status``.
    """

    more: str = ""
    needs: tuple[str, ...] = ()
    replaced: tuple[tuple[str, str], ...] = ()
    only_read: str = ""
    slow: bool = False
    status: int = 0
    package: str = ""


_SHORT_RUN = "--duration 2 --no-report"
_SHORT_SCORES = "--episodes 1 --cycles 5 --jobs 1 --back-end pybullet"
_TRAINS = "camnet train --world quickstart --seed 1 --out runs/train"
_FASTER = (
    "camnet simulate my_world.yaml --set targets.robot.motion.speed_mps=0.5 --duration 200 --out runs/faster"
)
_FIRST = "camnet simulate quickstart --out runs/first"
_SCORES = (
    "camnet evaluate --world quickstart,loop_8 --agents learned,runs/train/policy.npz --episodes 200 "
    "--out runs/scores"
)
_NO_TORCH = "training needs PyTorch, which the test environment leaves out; tests/training covers it"

_RECORDED = "it needs recordings of an hour and more; tests/association covers it"

CASES: dict[str, Case] = {
    # the program's own help
    "camnet worlds": Case(),
    _FIRST: Case("--duration 2 --no-video"),
    "camnet report runs/first": Case("--no-video", needs=(_FIRST,)),
    "camnet certify quickstart": Case(status=1),  # agents without a model: nothing is promised
    "camnet design --roads city.net.xml --off-max 120": Case("--time-limit 5", package="sumolib"),
    "camnet evaluate --episodes 20": Case(_SHORT_SCORES),
    # camnet simulate
    "camnet simulate quickstart": Case(_SHORT_RUN),
    "camnet simulate my_world.yaml --out runs/mine": Case(_SHORT_RUN),
    "camnet simulate quickstart --duration 60 --set targets.robot.motion.speed_mps=0.5": Case(_SHORT_RUN),
    "camnet simulate quickstart --seeds 1-10 --out runs/ten": Case("--seeds 1-2 --duration 2", slow=True),
    # camnet certify, falsify, design
    # 80 s are enough to learn something, and too few to certify every handoff
    "camnet certify mobile_certified --learn": Case("--duration 80", status=1),
    # people who go anywhere can stay out of view for ever
    "camnet certify --cameras DIR_OF_KRTD": Case(status=1),
    "camnet certify --cameras DIR_OF_KRTD --tracks people.csv": Case(status=1),
    "camnet certify --roads NET.xml --cameras CAMERAS.csv": Case(package="sumolib", status=1),
    "camnet coverage stationary_certified": Case(),
    "camnet coverage stationary_certified --class recognise": Case(),
    "camnet coverage --cameras DIR_OF_KRTD": Case(),
    "camnet coverage --roads NET.xml --cameras CAMERAS.csv": Case(package="sumolib"),
    "camnet coverage --cameras DIR_OF_KRTD --area AREAS.geojson --origin 39.05,-85.53,205": Case(),
    "camnet falsify quickstart --learn --trials 10000": Case("--trials 50 --duration 150", slow=True),
    "camnet falsify patrol --model-error 0.05": Case("--trials 50"),
    "camnet falsify patrol --closed-loop --out runs/attack": Case("--trials 4 --duration 60"),
    "camnet falsify patrol --closed-loop --replay runs/attack/attack.json": Case(
        needs=("camnet falsify patrol --closed-loop --out runs/attack",)
    ),
    "camnet falsify mobile_certified --closed-loop --learn": Case(only_read="it flies for minutes"),
    "camnet falsify two_vehicles --closed-loop --model-error 0.15": Case("--trials 2 --duration 20"),
    "camnet falsify WORLD --closed-loop --promise certificate.json": Case(
        "--trials 1",
        replaced=(
            ("WORLD", "patrol"),
            ("certificate.json", str(ROOT / "tests/experiments/data/promises/patrol_off_max.json")),
        ),
        status=1,
    ),
    "camnet falsify patrol --closed-loop --violate speed=-20%": Case("--trials 24 --duration 150", status=1),
    "camnet design --roads NET.xml --unseen-max-m 600": Case("--time-limit 5", package="sumolib"),
    "camnet design --roads NET.xml --off-max 120": Case("--time-limit 5", package="sumolib"),
    "camnet design --roads NET.xml --poles POLES.csv": Case(package="sumolib"),
    "camnet design --roads NET.xml --count 60": Case("--time-limit 5", package="sumolib"),
    "camnet design --roads NET.xml --repair CAMERAS.csv": Case("--time-limit 5", package="sumolib"),
    "camnet design --tracks people.csv --off-max 20": Case("--time-limit 5"),
    "camnet design WORLD --mounts walls:2,5 --off-max 30": Case(
        "--aim-step 45 --existing replace", replaced=(("WORLD", "depot.yaml"),)
    ),
    "camnet design --repair WORLD --off-max 30": Case("--aim-step 45", replaced=(("WORLD", "depot.yaml"),)),
    # camnet evaluate, train
    "camnet evaluate --world quickstart --agents learned,ekf,nearest --episodes 20": Case(_SHORT_SCORES),
    _SCORES: Case(_SHORT_SCORES, replaced=((",runs/train/policy.npz", ",static"),)),
    "camnet evaluate --world camnet/Handoff-Failures-v0 --agents learned,auction,ekf --episodes 50": Case(
        _SHORT_SCORES
    ),
    _TRAINS: Case(only_read=_NO_TORCH),
    "camnet evaluate --world loop_8 --agents runs/train/policy.npz,nearest,ekf --episodes 50": Case(
        only_read=_NO_TORCH
    ),
    "tensorboard --logdir runs/train/tensorboard": Case(only_read=_NO_TORCH),
    # the others
    "camnet warm-up": Case(slow=True),
    "camnet warm-up quickstart": Case(slow=True),
    "camnet warm-up simulate certify": Case(replaced=((" simulate", ""),)),
    "camnet worlds quickstart": Case(),
    "camnet worlds quickstart --yaml": Case(),
    "camnet worlds --schema": Case(),
    "camnet report runs/first --no-video": Case(needs=(_FIRST,)),
    "camnet track observations.csv --out runs/track": Case(),
    "camnet track fixes.csv --sd 3 --estimators adate,ekf,ukf": Case(),
    "camnet track OBSERVATIONS": Case(replaced=(("OBSERVATIONS", "observations.csv"),)),
    "camnet identify configs/meva.yaml --set data=FOLDER": Case(only_read=_RECORDED),
    "camnet identify configs/meva.yaml --set data=FOLDER --appearance 0.66": Case(only_read=_RECORDED),
    "camnet identify configs/meva.yaml --set data=FOLDER --learn earlier": Case(only_read=_RECORDED),
    "camnet identify MY_SITE.yaml --out runs/identity": Case(only_read=_RECORDED),
    "camnet identify RECORDING": Case(only_read=_RECORDED),
    "camnet futures configs/bologna.yaml --set data=FOLDER": Case(only_read=_RECORDED),
    "camnet futures configs/bologna.yaml --set data=FOLDER --trace fcd.xml.gz": Case(only_read=_RECORDED),
    "camnet futures configs/bologna.yaml --set data=FOLDER --hidden 1,5,20": Case(only_read=_RECORDED),
    "camnet futures RECIPE": Case(only_read=_RECORDED),
    "camnet structure PHOTOGRAPHS --board 9x6 --mask MASKS --odometry relative_to_the_board.txt": Case(
        only_read="tests/structure covers masks and odometry relative to a board"
    ),
    "camnet log runs/first": Case(needs=(_FIRST,)),
    "camnet log runs/first --columns": Case(needs=(_FIRST,)),
    "camnet log runs/first --describe --only 'robot.p_*'": Case(needs=(_FIRST,)),
    "camnet log runs/first --csv --only 't_s,*.p_?_m' --every 10": Case(needs=(_FIRST,)),
    "camnet log runs/first --events": Case(needs=(_FIRST,)),
    "camnet log runs/first --events --csv --out runs/table": Case(needs=(_FIRST,)),
    "camnet track-video walking.mp4 --box 51,53,87,290 --out runs/walking": Case(),
    "camnet track-video SEQUENCE_FOLDER": Case(),
    "camnet structure drive.mp4 --camera camera.yaml --odometry wheels.txt": Case(),
    "camnet structure PHOTOGRAPHS --board 9x6": Case(),
    # README
    "python3 scripts/quickstart.py": Case(only_read="it makes an environment and installs into it"),
    "python3 scripts/test.py": Case(only_read="it runs this test"),
    "source .venv/bin/activate": Case(only_read="it belongs to a shell"),
    "camnet simulate quickstart --duration 60": Case(_SHORT_RUN),
    "camnet simulate configs/quickstart.yaml --seeds 1-10": Case("--seeds 1 --duration 2 --jobs 1"),
    "cp worlds/quickstart/world.yaml my_world.yaml": Case(),
    _FASTER: Case(_SHORT_RUN),
    "pip install -e '.[analysis]'": Case(only_read="it installs; that the extras exist is tested"),
    "pip install -e '.[sumo]'": Case(only_read="it installs; that the extras exist is tested"),
    "python -c \"import pandas; print(pandas.read_parquet('runs/faster/log.parquet').columns)\"": Case(
        needs=(_FASTER,)
    ),
    "camnet certify mobile_certified --learn --out runs/certificate": Case("--duration 80", status=1),
    "camnet simulate CONFIG": Case(_SHORT_RUN),
    "camnet certify CONFIG": Case(status=1),
    "camnet falsify WORLD --learn": Case("--trials 20 --duration 150"),
    "camnet design --roads NET": Case("--time-limit 5", package="sumolib"),
    "camnet evaluate": Case(_SHORT_SCORES),
    "camnet train": Case(only_read=_NO_TORCH),
    "camnet track-video SEQUENCE": Case(),
    "camnet report RUN": Case("--no-video", needs=(_FIRST,), replaced=(("RUN", "runs/first"),)),
    "camnet completion bash": Case(),
    "camnet completion zsh": Case(),
    "camnet completion fish": Case(),
    "camnet completion SHELL": Case(replaced=(("SHELL", "bash"),)),
    "camnet log RUN": Case(needs=(_FIRST,), replaced=(("RUN", "runs/first"),)),
    "camnet worlds NAME": Case(replaced=(("NAME", "pursuit"),)),
    "camnet reproduce EXPERIMENT": Case("--seeds 1", replaced=(("EXPERIMENT", "adate-navigation"),)),
    "camnet bench BENCHMARK": Case(replaced=(("BENCHMARK", "history-selection"),), slow=True),
    "camnet bench history-selection --out runs/speed": Case(slow=True),
    "camnet simulate obstacle_course": Case(_SHORT_RUN),
}


def _stripped(line: str) -> str:
    """Take the explanation off a line: a comment, or what follows two blanks."""
    line = re.sub(r"\s+#.*$", "", line.strip())
    return re.split(r"\s{2,}", line)[0]


def _commands(lines: list[str]) -> list[str]:
    return [_stripped(line) for line in lines if line.split() and line.split()[0] in _PROGRAMS]


def _fenced(language: str) -> list[str]:
    """Return the README's fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


def _of_readme() -> list[str]:
    blocks = [line for block in _fenced("") for line in block.splitlines()]
    prose = re.sub(r"^```.*?^```$", "", README, flags=re.DOTALL | re.MULTILINE)
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose)]
    return _commands(blocks) + _commands([span for span in spans if " " in span])


def _parsers() -> dict[str, argparse.ArgumentParser]:
    parser = build_parser()
    actions = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return {"camnet": parser, **{f"camnet {name}": p for a in actions for name, p in a.choices.items()}}


def _of_help() -> list[str]:
    texts = [(p.description or "") + "\n" + (p.epilog or "") for p in _parsers().values()]
    lines = [line for text in texts for line in text.splitlines()]
    return _commands([line for line in lines if re.match(r"  \S", line)])


EXAMPLES = list(dict.fromkeys([*_of_help(), *_of_readme()]))


def test_every_example_has_a_case_and_every_case_its_example() -> None:
    assert sorted(set(EXAMPLES) - set(CASES)) == []
    assert sorted(set(CASES) - set(EXAMPLES)) == []


def test_every_command_has_an_example_and_a_row_in_the_readme() -> None:
    for name in _parsers():
        assert any(example == name or example.startswith(f"{name} ") for example in EXAMPLES), name
        assert name == "camnet" or f"| `{name}" in README, name


def _try(example: str) -> None:
    """Run an example in the current folder; what it needs first is run, too."""
    case = CASES[example]
    text = example
    for old, new in case.replaced:
        assert old in text
        text = text.replace(old, new)
    for needed in case.needs:
        if not Path(shlex.split(needed)[-1]).exists():
            _try(needed)
    program, *words = shlex.split(text)
    if program == "camnet":
        assert main([*words, *shlex.split(case.more)]) == case.status
    else:
        command = [sys.executable if program == "python" else program, *words]
        assert subprocess.run(command, check=False).returncode == 0


def _marks(example: str) -> list[pytest.MarkDecorator]:
    case = CASES.get(example, Case())
    missing = bool(case.package) and importlib.util.find_spec(case.package) is None
    return [
        *([pytest.mark.slow] if case.slow else []),
        *([pytest.mark.skip(reason=f"needs {case.package}")] if missing else []),
    ]


@pytest.mark.parametrize("example", [pytest.param(e, marks=_marks(e), id=e) for e in EXAMPLES])
def test_an_example_does_what_it_says(
    example: str, workplace: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workplace)
    if CASES[example].only_read:
        program, *words = shlex.split(example)
        if program == "camnet":
            assert build_parser().parse_args(words).command == words[0]
        elif program == "python3":
            compile((ROOT / words[0]).read_text(encoding="utf-8"), words[0], "exec")
        elif program == "pip":
            extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
            assert words[-1].strip(".[]") in extras
        return
    _try(example)
    assert "Traceback" not in capfd.readouterr().err


#: what shortens the README's Python blocks
_SHORTER = (("max_cycles=600", "max_cycles=20"), ("max_cycles=50", "max_cycles=4"))


def test_the_python_of_the_readme_runs(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(workplace)
    blocks = _fenced("python")
    assert blocks
    for old, new in _SHORTER:
        assert any(old in block for block in blocks)
        blocks = [block.replace(old, new) for block in blocks]
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {"__name__": "readme"})

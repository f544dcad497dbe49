"""What holds for every command: options, exit status, one JSON object, silence, suggestions, help."""

from __future__ import annotations

import argparse
import json
import logging
import subprocess
import sys
from pathlib import Path

import pytest

from camnet.cli.main import build_parser, main


def _parsers() -> dict[str, argparse.ArgumentParser]:
    actions = [a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction)]
    return dict(actions[0].choices)


PARSERS = _parsers()
#: these compute nothing: they list, draw again, or prepare
COMPUTE_NOTHING = {"worlds", "report", "warm-up", "log", "completion"}
#: the options of many seeds are one
SEEDS_HELP = "a count (10: ten seeds, from --seed on), a range (1-10) or a list (1,4,9-12)"


def _options(name: str) -> dict[str, argparse.Action]:
    return {option: action for action in PARSERS[name]._actions for option in action.option_strings}


@pytest.mark.parametrize("name", PARSERS)
def test_every_command_has_the_common_options(name: str) -> None:
    options = _options(name)
    assert {"--help", "--quiet", "--log-level"} <= set(options)
    if name not in COMPUTE_NOTHING:
        assert {"--json", "--out", "--seed", "--force"} <= set(options)
    if "--seeds" in options:
        assert SEEDS_HELP in (options["--seeds"].help or "")


@pytest.mark.parametrize("name", PARSERS)
def test_help_explains_every_option(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert f"usage: camnet {name}" in out
    assert all(action.help for action in PARSERS[name]._actions)
    assert (PARSERS[name].description or "").strip()


def test_without_words_the_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    shown = capsys.readouterr()
    assert main(["--help"]) == 0
    assert capsys.readouterr() == shown
    assert all(f"\n    {name}" in shown.out for name in PARSERS)


def test_the_package_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "camnet"]
    assert subprocess.run([*command, "--version"], capture_output=True, check=True).stdout
    assert subprocess.run([*command, "worlds", "atlantis"], capture_output=True, check=False).returncode == 2


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        ("simulat quickstart", "did you mean 'simulate'?"),
        ("worlds quikstart", "did you mean 'quickstart'?"),
        ("simulate quikstart", "did you mean 'quickstart'?"),
        ("simulate quickstart --ouput x", "did you mean '--out'?"),
        ("simulate quickstart --durations 3", "did you mean '--duration'?"),
        ("evaluate --wrold quickstart", "did you mean '--world'?"),
        ("evaluate --agents lerned", "did you mean 'learned'?"),
        ("evaluate --world camnet/Handoff-Failure-v0", "did you mean 'camnet/Handoff-Failures-v0'?"),
        ("evaluate --back-end bullet", "did you mean 'pybullet'?"),
        ("train --set stps=4", "did you mean 'steps'?"),
        ("reproduce adate-tabel", "did you mean 'adate-table'?"),
        ("warm-up simulatte", "did you mean 'simulate'?"),
        ("bench sensng", "did you mean 'sensing'?"),
        ("simulate quickstart --set duration=3", "did you mean 'run.duration_s'?"),
        ("simulate quickstart --set speed_mps=3", "did you mean 'targets.robot.motion.speed_mps'?"),
        ("simulate quickstart --set run.durations=3", "did you mean 'duration_s'?"),
        ("simulate quickstart --log-level warn", "did you mean 'warning'?"),
        ("--quiet worlds", "options come after the command"),
        ("worlds quickstart pursuit", "'pursuit'"),
    ],
)
def test_what_is_mistyped_gets_a_suggestion(
    words: str,
    advice: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert advice in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


_NEED = {"design": ["--tracks", "x.csv"], "simulate": ["quickstart"], "falsify": ["patrol"]}
_NEED |= {
    "structure": ["x.mp4"],
    "coverage": ["patrol"],
    "identify": ["x.yaml"],
    "futures": ["x.yaml"],
    "track": ["x.csv"],
}
_NEED |= {"reproduce": ["adate-table"], "track-video": ["x.mp4"], "bench": ["sensing"], "certify": ["patrol"]}


@pytest.mark.parametrize("value", ["-1", "1.5", "1_0", "", "٣", "4294967296", "1e3", "one"])
@pytest.mark.parametrize("name", sorted(set(PARSERS) - COMPUTE_NOTHING))
def test_a_seed_is_a_whole_number_from_zero(
    name: str, value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([name, *_NEED.get(name, []), "--seed", value]) == 2
    err = capsys.readouterr().err
    assert f"--seed: {value!r}" in err
    assert "from 0 to 4294967295" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "value", ["-3", "-3-5", "0", "5-1", "1,,2", "1-", "a", "1-20000", "20000", "4294967296-4294967297", "1:3"]
)
@pytest.mark.parametrize("name", [name for name in PARSERS if "--seeds" in _options(name)])
def test_seeds_mean_the_same_everywhere(
    name: str, value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([name, *_NEED[name], "--seeds", value]) == 2
    assert f"--seeds: {value!r}" in capsys.readouterr().err
    good = PARSERS[name].parse_args([*_NEED[name], "--seeds", "4"]).seeds
    assert good.numbers(7) == (7, 8, 9, 10)
    good = PARSERS[name].parse_args([*_NEED[name], "--seeds", "4,1-3,2"]).seeds
    assert good.numbers(7) == (1, 2, 3, 4)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("simulate quickstart --seed 3 --seeds 1-4", "--seed 3"),
        ("simulate quickstart --seed 4294967295 --seeds 2", "too large"),
        ("simulate quickstart --jobs 2", "--jobs 2"),
        ("simulate quickstart --duration 3 --set run.duration_s=4", "--duration 3"),
        ("reproduce adate-table --seeds 1,3", "consecutive"),
        ("reproduce adate-table --data .", "--data"),
        ("reproduce pedestrians --seeds 3 --data .", "--seeds 3"),
        ("train --steps 5 --set steps=6", "--steps"),
        ("falsify patrol --model-error 0.05 --duration 3", "--duration 3"),
        ("falsify patrol --learn --model x.npz", "--model x.npz"),
        ("certify --cameras . --learn", "--learn: applies"),
        ("certify --cameras . --range 30 --class detect", "give one"),
        ("coverage patrol --image 640x480", "--image 640x480"),
        ("coverage patrol --area x.geojson --margin 5", "--margin 5"),
        ("design --tracks x.csv --class detect", "--class detect"),
        ("worlds --yaml", "--yaml"),
        ("worlds quickstart --schema", "--schema"),
        ("worlds quickstart --yaml --json", "--json"),
        ("worlds --quiet --log-level debug", "--log-level debug"),
        ("evaluate --reference ekf --agents static", "--reference"),
    ],
)
def test_an_option_that_would_be_ignored_is_an_error(
    words: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_a_value_may_start_with_a_minus() -> None:
    parser = build_parser()
    assert parser.parse_args(["certify", "--origin", "-39.5,-85,205"]).origin == "-39.5,-85,205"
    assert parser.parse_args(["simulate", "x", "--set", "-1=2"]).overrides == ["-1=2"]


def test_worlds_are_a_table_a_description_and_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["worlds"]) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[0].split() == ["name", "kind", "agents", "cameras", "targets", "size", "description"]
    assert main(["worlds", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["worlds"]
    rows = [line.split() for line in table[1:] if line][: len(found)]
    assert [row[0] for row in rows] == list(found)
    for name, world in found.items():
        row = rows[list(found).index(name)]
        assert row[1] == world["kind"]
        assert list(map(int, row[2:5])) == [
            world["agents"],
            world["agents"] + world["fixed_cameras"],
            world["targets"],
        ]
        assert Path(world["path"]).is_file()
        assert min(world["size_m"]) > 1.0
        assert main(["worlds", name]) == 0
        described = capsys.readouterr().out
        assert world["path"] in described
        assert world["description"] in described
        assert main(["worlds", name, "--yaml"]) == 0
        assert capsys.readouterr().out == Path(world["path"]).read_text(encoding="utf-8")
        assert main(["worlds", name, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["config"]["name"] == name
    assert found["quickstart"]["size_m"] == pytest.approx([11.6, 11.6])  # the regions' outer sides: +-5.8 m


_QUIET = [
    "simulate quickstart --duration 1 --no-video",
    "simulate quickstart --duration 1 --seeds 1 --jobs 1",
    "certify quickstart",
    "certify --cameras DIR_OF_KRTD --tracks people.csv",
    "coverage --cameras DIR_OF_KRTD --resolution 1",
    "falsify patrol --model-error 0.05 --trials 20",
    "design --tracks people.csv --off-max 20",
    "evaluate --agents static,random --episodes 1 --cycles 5 --jobs 1 --back-end pybullet",
    "reproduce adate-navigation --seeds 1",
    "track observations.csv",
    "track-video walking.mp4 --box 51,53,87,290",
    "structure PHOTOGRAPHS --board 9x6",
    "worlds",
    "worlds quickstart",
    pytest.param("bench history-selection", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("words", _QUIET)
def test_json_is_one_object_and_quiet_is_quiet(
    words: str, workplace: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workplace)
    # nothing can be promised of agents without a model, nor of people who go anywhere: status 1
    assert main([*words.split(), "--json", "--quiet"]) == int(words.startswith("certify"))
    out, err = capfd.readouterr()
    assert isinstance(json.loads(out), dict)
    assert out.count("\n") == 1
    assert err == ""


def test_messages_of_the_library_follow_the_log_level(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from camnet.cli.worlds import run

    def talkative(args: argparse.Namespace) -> int:
        for level in ("debug", "info", "warning", "error"):
            getattr(logging.getLogger("camnet.some.module"), level)("at %s", level)
        return run(args)

    monkeypatch.setattr("camnet.cli.worlds.run", talkative)
    for words, shown in (([], ["warning", "error"]), (["--log-level", "info"], ["info", "warning", "error"])):
        assert main(["worlds", *words]) == 0
        assert capsys.readouterr().err.splitlines() == [f"camnet: {level}: at {level}" for level in shown]
    assert main(["worlds", "--quiet", "--log-level", "error"]) == 0
    assert capsys.readouterr().err == "camnet: error: at error\n"

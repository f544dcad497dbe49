"""Parts of a package that is not camnet's, found by name: they do what they say, and wrong names are told."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from camnet.agents import estimator_of, make_team
from camnet.cli.inputs import read_tracks
from camnet.cli.main import main
from camnet.config import load_scenario
from camnet.env import handoff_v0
from camnet.errors import ConfigError, DataError
from camnet.motion.field_law import build_law
from camnet.motion.settings import FieldTarget

PACKAGE = Path(__file__).resolve().parents[2] / "examples/camnet_steady"


@pytest.fixture(autouse=True)
def on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(PACKAGE))


def test_its_estimator_runs_beside_ours_and_holds_what_was_seen(tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = "simulate quickstart --duration 12 --no-report --quiet --set run.estimators=[ekf,camnet_steady:steady]"
    assert main([*words.split(), "--out", str(out)]) == 0
    log = pd.read_parquet(out / "log.parquet")
    unseen = (log["robot.seen_by"] < 0).to_numpy()
    x = log["robot.camnet_steady:steady.p_x_m"].to_numpy()[unseen]
    assert len(x) > 10
    assert np.ptp(x[2:]) == 0.0  # it stands while nobody sees the target
    assert json.loads((out / "summary.json").read_text())["summary"]["baselines"].keys() == {
        "camnet_steady:steady"
    }
    assert main(["log", str(out), "--columns"]) == 0


def test_its_agent_acts_in_the_environment() -> None:
    assert estimator_of("camnet_steady:Hover") == "ekf"
    env = handoff_v0.parallel_env(world="quickstart", max_cycles=3, filter_name="ekf")
    observations, _ = env.reset(seed=1)
    actions = make_team("camnet_steady:Hover", env)(observations)
    assert set(actions) == set(env.agents)
    assert all(np.all(a == 0.0) for a in actions.values())
    env.step(actions)
    env.close()


def test_its_law_moves_a_target() -> None:
    law = build_law(FieldTarget(kind="field", entry="camnet_steady:whirl"))
    places = np.array([[1.0, 0.0], [0.0, 2.0]])
    np.testing.assert_allclose(law.of(places, np.zeros_like(places), 0.0), [[0.0, 1.0], [-2.0, 0.0]])


def test_its_reader_reads_tracks(tmp_path: Path) -> None:
    path = tmp_path / "people.xyt"
    path.write_text("a 0 0 0\na 1 0 1\nb 5 5 0\nb 5 6 1\n")
    args = argparse.Namespace(origin=None, tracks=Path(f"camnet_steady:read_xyt:{path}"))
    tracks = read_tracks(args)
    assert [t.id for t in tracks] == ["a", "b"]
    np.testing.assert_array_equal(tracks[1].p_world[:, :2], [[5, 5], [5, 6]])
    path.write_text("a 0 0\n")
    with pytest.raises(DataError, match="line 1"):
        read_tracks(args)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("camnet_steady:steedy", "has no 'steedy'; it has"),
        ("no_such_package:steady", "No module named 'no_such_package'; install"),
        ("builtins:slice", "made slice, which has no name, estimate"),
        ("camnet_steady:__all__", "is list: a function of"),
    ],
)
def test_wrong_estimators_are_told(
    name: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ("--out", str(tmp_path / "x"), "--quiet", "--duration", "1")
    assert main(["simulate", "quickstart", "--set", f"run.estimators=[{name}]", *out]) == 2
    err = capsys.readouterr().err
    assert "run.estimators" in err
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_wrong_agents_and_words_are_told() -> None:
    with pytest.raises(ConfigError, match="has no 'Hoover'"):
        estimator_of("camnet_steady:Hoover")
    with pytest.raises(ConfigError, match="did you mean 'nearest'"):
        estimator_of("nearst")
    with pytest.raises(ConfigError, match="learned, learned_shared"):
        load_scenario("quickstart", ["run.estimators=[lerned]"])


@pytest.mark.slow
def test_the_package_installs_and_is_found(tmp_path: Path) -> None:
    venv.create(tmp_path / "env", system_site_packages=True, with_pip=True)
    python = str(tmp_path / "env/bin/python")
    install = [python, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", str(PACKAGE)]
    paths = [p for p in sys.path if "site-packages" in p]
    subprocess.run(install, check=True, env={"PYTHONPATH": ":".join(paths)}, cwd=tmp_path)
    found = subprocess.run(
        [python, "-c", "import importlib.util as u; print(u.find_spec('camnet_steady').origin)"],
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert str(tmp_path / "env") in found.stdout

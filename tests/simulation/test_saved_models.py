"""Learned models saved by one run and loaded by the next: through the command line, shared, and what does not fit."""

from pathlib import Path

import numpy as np
import pytest

from camnet.cli.main import main
from camnet.config.load import load_scenario
from camnet.errors import ConfigError, DataError
from camnet.estimation.delayed import DelayedFilter
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.persistence import load_models, save_models
from camnet.simulation.models import check_saving, collect_learned, start_from
from camnet.simulation.network import build_network

OVERRIDES = ["run.estimators=[learned]"]


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    arguments = [
        "simulate",
        "quickstart",
        "--duration",
        "25",
        "--no-report",
        "--quiet",
        "--out",
        str(folder / "run"),
    ]
    for text in OVERRIDES:
        arguments += ["--set", text]
    assert main([*arguments, "--save-model", str(folder / "m.npz")]) == 0
    return folder / "m.npz"


def build(count, name="learned", latency=0.0):
    network = build_network(load_scenario("quickstart"))
    settings = network.scenario.estimator
    filters = [
        LearningEstimator(settings, network.basis, 4, 30.0, network.bounds, name) for _ in range(count)
    ]
    return network, {name: [DelayedFilter(f, latency) if latency else f for f in filters]}


def test_a_run_starts_from_what_another_learned(saved: Path, tmp_path: Path) -> None:
    models = load_models(saved)
    assert len(models) == 4
    assert max(len(model.stacks[0][0]) for model in models) > 10
    again = [
        "simulate",
        "quickstart",
        "--duration",
        "1",
        "--no-report",
        "--quiet",
        "--out",
        str(tmp_path / "r"),
    ]
    assert (
        main([*again, "--set", OVERRIDES[0], "--model", str(saved), "--save-model", str(tmp_path / "n.npz")])
        == 0
    )
    for before, after in zip(models, load_models(tmp_path / "n.npz"), strict=True):
        assert len(after.stacks[0][0]) >= len(before.stacks[0][0])
        assert np.isclose(after.stacks[0][1][: len(before.stacks[0][1])], before.stacks[0][1]).all()
        old = after.stacks[0][2][: len(before.stacks[0][2])]
        assert (old < 0.0).all()
        np.testing.assert_allclose(np.diff(old), np.diff(before.stacks[0][2]), atol=1e-9)


def test_one_set_serves_every_target_and_late_measurements_too(saved: Path) -> None:
    network, filters = build(3, latency=0.1)
    start_from(load_models(saved), saved, filters, network.basis, 4)
    for target in filters["learned"]:
        assert isinstance(target, DelayedFilter)
        for j, model in enumerate(load_models(saved)):
            np.testing.assert_array_equal(target.settled.model(j).weights, model.weights)


def test_shared_estimators_merge_all_sets(saved: Path, tmp_path: Path) -> None:
    network, filters = build(2)
    start_from(load_models(saved), saved, filters, network.basis, 4)
    both = tmp_path / "both.npz"
    save_models(both, collect_learned(filters, network.basis, 4))
    assert len(load_models(both)) == 8
    _, shared = build(1, "learned_shared")
    start_from(load_models(both), both, shared, network.basis, 4)
    alone = load_models(saved)[0].stacks[0][0]
    assert shared["learned_shared"][0].model(0).integral.count == 2 * len(alone)


def test_what_does_not_fit_is_refused(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network, filters = build(3)
    with pytest.raises(DataError, match=r"expected 4 .* or 12"):
        start_from(load_models(saved) * 2, saved, filters, network.basis, 4)
    with pytest.raises(ConfigError, match="folder that exists"):
        check_saving(tmp_path / "nowhere" / "m.npz", ["learned"])
    with pytest.raises(ConfigError, match="learns"):
        check_saving(tmp_path / "m.npz", ["ekf"])
    none = ["simulate", "quickstart", "--out", str(tmp_path / "r"), "--model", str(tmp_path / "none.npz")]
    assert main(none) == 2
    assert "none.npz" in capsys.readouterr().err
    assert (
        main(
            [
                "simulate",
                "quickstart",
                "--seeds",
                "1-2",
                "--save-model",
                "m.npz",
                "--out",
                str(tmp_path / "s"),
            ]
        )
        == 2
    )

"""Logged quantities of the Lyapunov analysis, recomputed from the run and from what was learned."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.cli.main import main
from camnet.config.load import load_scenario
from camnet.geometry.rotations import align_sign
from camnet.report.instruments_plot import write_instruments
from camnet.report.run_data import load_run
from camnet.simulation.instruments import INSTRUMENTS
from camnet.simulation.run import run_network


@pytest.fixture(scope="module")
def run():
    scenario = load_scenario("stationary_certified", ["run.instruments=true", "run.duration_s=30"], seed=2)
    return scenario, run_network(scenario, 2, keep_models=True)


def test_the_figures_are_those_of_the_run(run):
    scenario, result = run
    columns = dict(zip(result.log.columns, result.log.values.T, strict=True))
    known = np.isfinite(columns["robot.V"])
    assert known.mean() > 0.9
    wanted = [f"robot.{axis}" for axis in ("p_x_m", "p_y_m", "p_z_m", "q_w", "q_x", "q_y", "q_z")]
    here = [f"robot.learned.{name.partition('.')[2]}" for name in wanted]
    truth, estimate = (np.stack([columns[n] for n in names], axis=1)[known] for names in (wanted, here))
    turn = np.array([align_sign(a, b) - b for a, b in zip(estimate[:, 3:], truth[:, 3:], strict=True)])
    expected = 0.5 * (((estimate - truth)[:, :3] ** 2).sum(axis=1) + (turn**2).sum(axis=1))
    np.testing.assert_allclose(columns["robot.V_pose"][known], expected, rtol=1e-6, atol=1e-12)
    seen = columns["robot.seen_by"] >= 0
    np.testing.assert_array_equal(columns["robot.sigma_f"][known] > 0, seen[known])
    assert (columns["robot.V"][known] >= columns["robot.V_pose"][known] - 1e-12).all()
    assert (columns["robot.psi_min_visited_s2"][known] >= columns["robot.psi_min_s2"][known] - 1e-9).all()
    # no weights at first: V then holds those that the run ended with in the region of that time
    gamma, first = scenario.estimator.gamma, np.flatnonzero(known)[0]
    assert columns["robot.W_hat"][first] == pytest.approx(0.0, abs=1e-3)
    region = int(columns["robot.seen_by"][first])
    norm = np.linalg.norm(result.learned[region].weights[:, :6])
    gap = columns["robot.V"][first] - columns["robot.V_pose"][first]
    assert gap == pytest.approx(0.5 * norm**2 / gamma, rel=0.02)


def test_nothing_is_logged_unless_it_is_asked_for_and_an_ekf_has_none():
    plain = load_scenario("stationary_certified", ["run.duration_s=1"])
    assert not any(c.split(".")[-1] in INSTRUMENTS for c in run_network(plain, 0).log.columns)
    ekf = load_scenario("stationary_certified", ["run.instruments=true", "run.estimators=[ekf]"])
    with pytest.raises(Exception, match="has no history stack"):
        run_network(ekf, 0)


def test_the_run_s_page_shows_them(tmp_path):
    words = ["--instruments", "--duration", "12", "--no-video", "--quiet", "--out", str(tmp_path / "r")]
    assert main(["simulate", "quickstart", *words]) == 0
    assert (tmp_path / "r" / "instruments.png").stat().st_size > 10_000
    assert "Lyapunov analysis" in (tmp_path / "r" / "report.html").read_text()
    write_instruments(load_run(tmp_path / "r"), tmp_path / "again.png")
    assert (tmp_path / "again.png").exists()

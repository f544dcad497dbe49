"""``camnet track``: observations in, tracks and named observers out; wrong files are refused by field."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from camnet.cli.main import main
from camnet.estimation.adate import AdaptiveTrajectoryEstimator
from camnet.estimation.pls import PowerLimitedSteering

HEAD = ["t", "observer", "x", "y", "z", "sd", "true_x", "true_y", "true_z"]
SD = 5.0


def scene(seed: int, steps: int = 220, drifts: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Irregular times (n,), truth (n,3) and four observers' positions (n,4,3); the first drifts in the second half."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(1.0 + 0.3 * rng.uniform(-1.0, 1.0, steps))
    truth = np.stack([60.0 * np.sin(t / 40.0), 1.2 * t, 5.0 * np.cos(t / 60.0)], axis=1)
    seen = truth[:, None] + rng.normal(0.0, SD, (steps, 4, 3))
    if drifts:
        half = steps // 2
        seen[half:, 0, :2] += 3.0 * np.sqrt(np.arange(steps - half))[:, None]
    return t, truth, seen


def written(path: Path, seed: int = 0, drifts: bool = True, steps: int = 220) -> Path:
    t, truth, seen = scene(seed, steps, drifts)
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(HEAD)
        for k in range(len(t)):
            for j in range(4):
                missing = k % 17 == 3 and j == 2
                rows.writerow(
                    [t[k], f"station {j}", *(["", "", ""] if missing else seen[k, j]), SD, *truth[k]]
                )
    return path


def test_a_drifting_observer_is_named_and_hardly_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "observations.csv")
    assert (
        main(["track", str(path), "--estimators", "adate,ekf", "--json", "--out", str(tmp_path / "out")]) == 0
    )
    found = json.loads(capsys.readouterr().out)
    drifting = {name for name, o in found["observers"].items() if o["drifts_from_s"] is not None}
    assert drifting == {"station 0"}
    best = min(o["rmse_m"] for o in found["observers"].values())
    adate = found["estimators"]["adate"]
    assert adate["causal_rmse_m"] < best
    assert adate["smoothed_rmse_m"] < min(found["estimators"]["ekf"]["smoothed_rmse_m"], best)
    assert adate["smoothed_rmse_m"] <= 1.1 * told() + 0.05
    rows = list(csv.DictReader((tmp_path / "out" / "track.csv").open()))
    assert len(rows) == 220
    assert float(rows[-1]["adate_smoothed_cov_xx_m2"]) > 0.0
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {
        "track.csv",
        "observations.csv",
        "track.png",
        "report.html",
    }


def told() -> float:
    """RMSE, m, of the same estimator that is not shown the drifting observer's drift."""
    t, truth, seen = scene(0)
    estimator = AdaptiveTrajectoryEstimator(PowerLimitedSteering(), float(np.median(np.diff(t))))
    cov = np.tile(SD**2 * np.eye(3), (4, 1, 1))
    for k in range(len(t)):
        use = [j for j in range(4) if not (j == 0 and k >= len(t) // 2) and not (k % 17 == 3 and j == 2)]
        estimator.update(seen[k, use], cov[use], use, None if k == 0 else float(t[k] - t[k - 1]))
    return float(np.sqrt(np.mean(np.sum((estimator.trajectory[:, :3] - truth) ** 2, axis=1))))


def test_two_dimensions_one_observer_and_degrees(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(40.0)
    lines = ["time,lat,lon,sd"]
    lines += [f"{s},{49.0 + 1e-5 * s:.9f},{11.0 + 2e-5 * s:.9f},2" for s in t]
    path = tmp_path / "fixes.csv"
    path.write_text("\n".join(lines))
    assert main(["track", str(path), "--json", "--out", str(tmp_path / "out")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["origin"] == [49.0, 11.0]
    rows = list(csv.DictReader((tmp_path / "out" / "track.csv").open()))
    # 1e-5 degrees of latitude are 1.11 m, 2e-5 of longitude at 49 degrees 1.46 m
    assert float(rows[-1]["ekf_smoothed_y_m"]) == pytest.approx(39 * 1.112, abs=0.3)
    assert float(rows[-1]["ekf_smoothed_x_m"]) == pytest.approx(39 * 1.463, abs=0.3)


GOOD = "t,observer,x,y,sd\n0,a,0,0,1\n1,a,1,0,1\n2,a,2,0,1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        (GOOD.replace("t,", "when,", 1), "no time among the columns"),
        (GOOD.replace("x,y", "east,north"), "no position among the columns"),
        (GOOD.replace(",sd", ",noise"), "no noise among the columns"),
        (GOOD.replace("observer", "obsever"), "did you mean 'observer'"),
        (GOOD.replace("1,a,1,0,1", "1,a,1,0"), "4 fields"),
        (GOOD.replace("1,a,1,0,1", "1,a,one,0,1"), "x is 'one'"),
        (GOOD.replace("1,a,1,0,1", "1,a,1,0,-1"), "sd is -1"),
        (GOOD.replace("1,a,1,0,1", "1,a,1,nan,1"), "y is 'nan'"),
        (GOOD.replace("1,a,1,0,1", "0,a,1,0,1"), "two observations at t = 0 s"),
        ("t,x,y,sd\n0,0,0,1\n", "at least two times"),
        (GOOD.replace("1,a,1,0,1", "1,,1,0,1"), "observer is empty"),
        ("t,x,y,cov_xx,cov_xy\n0,0,0,1,0\n1,0,0,1,0\n", "column 'cov_yy' is missing"),
        ("t,x,y,cov_xx,cov_xy,cov_yy\n0,0,0,1,2,1\n1,0,0,1,0,1\n", "not positive definite"),
    ],
)
def test_wrong_files_are_refused(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.csv"
    path.write_text(text)
    assert main(["track", str(path), "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_unknown_estimators_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "good.csv"
    path.write_text(GOOD)
    assert main(["track", str(path), "--estimators", "adate,pf"]) == 2
    assert "'pf' is unknown" in capsys.readouterr().err

"""The motion-learning experiment: scene, filters against second routes, seeds that can be taken up again."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from camnet.errors import ConfigError
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.observation import measured_world_pose
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EkfSettings
from camnet.estimation.ukf import ConstantVelocityUKF
from camnet.experiments.kept_runs import digest
from camnet.experiments.motion_learning import interval, print_table, run
from camnet.experiments.motion_learning_published import PublishedEstimator, published_basis
from camnet.experiments.motion_learning_rows import ROWS, Trace, build_rows, follow, score
from camnet.experiments.motion_learning_runs import (
    _kept,
    image_noise,
    run_seed,
    run_seeds,
    trace_file,
)
from camnet.experiments.motion_learning_scene import (
    Recording,
    SceneSettings,
    SlippingMotion,
    draw_schedule,
    record,
)
from camnet.geometry import rotations
from camnet.motion.factory import build_motion
from camnet.motion.settings import TargetSettings, VectorFieldTarget
from camnet.storage.seal import seal_of
from camnet.storage.whole_file import write_json
from camnet.types import CameraMotion, PoseMeasurement

RATE = 60.0
BOUNDS = np.array([[-2.0, -2.0, -0.5], [2.0, 2.0, 0.5]])
SHORT = SceneSettings(duration_s=8.0, first_on_s=4.0, on_s=(1.0, 1.5), off_s=(1.0, 1.5))


def _measurement(t_s: float, p: np.ndarray, q: np.ndarray) -> PoseMeasurement:
    still = CameraMotion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    return PoseMeasurement(t_s, 0, 0, p, q, still)


@pytest.fixture(scope="module")
def short_recording() -> Recording:
    return record(SHORT, 3)


def test_schedule_follows_the_published_dwell_times() -> None:
    scene = SceneSettings(duration_s=10_000.0)
    t = np.arange(0.0, scene.duration_s, 0.02)
    on = draw_schedule(scene, t, np.random.default_rng(0))
    assert on[t < 60.0].all()
    edges = np.flatnonzero(np.diff(on.astype(int))) + 1
    lengths = np.diff(t[edges])
    off, seen = lengths[0::2], lengths[1::2]
    assert stats.kstest(off, stats.uniform(10.0, 10.0).cdf).pvalue > 0.01
    assert stats.kstest(seen, stats.uniform(15.0, 15.0).cdf).pvalue > 0.01


def test_recording_is_repeatable_and_the_schedule_alone_hides(short_recording: Recording) -> None:
    again = record(SHORT, 3)
    np.testing.assert_array_equal(again.p_world, short_recording.p_world)
    given = np.array([m is not None for m in short_recording.measurements])
    np.testing.assert_array_equal(given, short_recording.on)
    for a, b in zip(again.measurements, short_recording.measurements, strict=True):
        assert a is None or (b is not None and np.array_equal(a.p_cam, b.p_cam))
    assert not np.array_equal(record(SHORT, 4).p_world, short_recording.p_world)


def test_images_show_the_same_and_only_what_the_schedule_leaves(short_recording: Recording) -> None:
    """The marker is found in every frame that is looked at; its pose scatters by millimetres."""
    seen = np.array([m is not None for m in short_recording.images])
    np.testing.assert_array_equal(seen, short_recording.on)
    noise = image_noise(short_recording)
    assert noise["position_std_m"] < 0.005
    assert noise["orientation_std_deg"] < 1.0
    for image, pose in zip(short_recording.images, short_recording.measurements, strict=True):
        if image is not None and pose is not None:
            # the same calibration errors: only the noise of a frame is another
            assert np.linalg.norm(measured_world_pose(image)[0] - measured_world_pose(pose)[0]) < 0.04


def test_slip_has_the_stated_spread() -> None:
    field = VectorFieldTarget(kind="vector_field", field="wave", scale_m=1.8, speed_mps=0.3)
    plain = build_motion(TargetSettings(name="robot", motion=field), ())
    motion = SlippingMotion(plain, 0.02, 0.05, 0.2)
    rng = np.random.default_rng(0)
    state, dt, slips = motion.reset(rng), 0.05, []
    for k in range(6000):
        before = state
        state = motion.step(state, k * dt, dt, rng)
        slips.append(state.internal[-2:])
        moved = np.linalg.norm(state.p_world - before.p_world) / dt
        assert moved <= motion.v_max_mps
    spread = np.std(slips, axis=0)
    np.testing.assert_allclose(spread, [0.02, 0.05], rtol=0.1)
    np.testing.assert_allclose(
        np.corrcoef(np.array(slips)[:-4, 0], np.array(slips)[4:, 0])[0, 1], math.exp(-1.0), atol=0.08
    )


def _turning(filters: list[TargetFilter], seconds: float = 8.0) -> None:
    rng = np.random.default_rng(0)
    for k in range(round(seconds * RATE)):
        t = k / RATE
        q = rotations.multiply(rotations.from_yaw(0.4 * t), rotations.exp(0.01 * rng.standard_normal(3)))
        p = np.array([0.3 * t, 0.1 * t, 0.0]) + 0.01 * rng.standard_normal(3)
        for each in filters:
            if 5.0 <= t < 6.0:
                each.predict(t)
            else:
                each.correct(_measurement(t, p, -q if k % 3 else q), 0)


def test_unscented_filter_agrees_with_the_extended_one() -> None:
    """Position: only the prior of the velocity differs. Orientation: second order in its spread."""
    ekf, ukf = ConstantVelocityEKF(EkfSettings(), RATE), ConstantVelocityUKF(EkfSettings(), RATE)
    _turning([ekf, ukf])
    a, b = ekf.estimate, ukf.estimate
    np.testing.assert_allclose(a.p_world, b.p_world, atol=1e-4)
    np.testing.assert_allclose(a.v_world, b.v_world, atol=1e-3)
    assert float(rotations.angle_between(a.q_world, b.q_world)) < 2e-3
    np.testing.assert_allclose(a.w_body, b.w_body, atol=0.01)
    np.testing.assert_allclose(a.w_body, [0.0, 0.0, 0.4], atol=0.1)
    assert a.seen == b.seen


def test_published_estimator_takes_one_window_a_second_and_learns_a_constant_velocity() -> None:
    estimator = PublishedEstimator(published_basis(), RATE, BOUNDS)
    q = rotations.from_yaw(0.3)
    for k in range(round(20.0 * RATE)):
        t = k / RATE
        x = 0.8 * math.sin(0.3 * t)  # to and fro: the mean velocity by place is zero, that of y constant
        estimator.correct(_measurement(t, np.array([x, 0.02 * t, 0.0]), q), 0)
    assert estimator.diagnostics()["stack_size"] == pytest.approx(20, abs=1)
    before = estimator.estimate
    for k in range(round(2.0 * RATE)):
        estimator.predict(20.0 + k / RATE)
    after = estimator.estimate
    assert after.p_world[1] - before.p_world[1] == pytest.approx(0.04, abs=0.02)
    assert float(rotations.angle_between(after.q_world, q)) < 0.02


@pytest.mark.parametrize("fixed_sign", [False, True])
def test_sign_of_the_measured_quaternion_does_not_matter(fixed_sign: bool) -> None:
    ends = []
    for signs in (1, 2):
        estimator = PublishedEstimator(published_basis(), RATE, BOUNDS, fixed_sign=fixed_sign)
        for k in range(round(10.0 * RATE)):
            t = k / RATE
            q = rotations.from_yaw(0.5 * t) * (-1.0) ** (k % signs)
            estimator.correct(_measurement(t, np.array([math.sin(0.5 * t), -math.cos(0.5 * t), 0.0]), q), 0)
        ends.append(np.abs(estimator.estimate.q_world))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


def test_score_by_hand(short_recording: Recording) -> None:
    shift = np.array([0.03, -0.04, 0.0])
    turn = rotations.exp(np.array([0.0, 0.0, math.radians(5.0)]))
    trace = Trace(short_recording.p_world + shift, -rotations.multiply(short_recording.q_world, turn))
    found = score(short_recording, trace, from_s=2.0)
    assert found["position_rmse_m"] == pytest.approx(0.05)
    assert found["position_rmse_unseen_m"] == pytest.approx(0.05)
    assert found["orientation_rmse_deg"] == pytest.approx(5.0)


def test_every_row_follows_the_recording(short_recording: Recording) -> None:
    rows = build_rows(short_recording, SHORT)
    assert tuple(rows) == ROWS
    traces = follow(short_recording, rows)
    for name, trace in traces.items():
        assert isinstance(rows[name], TargetFilter)
        error = np.linalg.norm(trace.p_world - short_recording.p_world, axis=1)
        # as printed, the estimate is not restarted at a re-sighting but pulled in
        first = short_recording.t_s < (SHORT.first_on_s if "published" in name else SHORT.duration_s)
        assert error[short_recording.on & first].max() < 0.1, name
    ideal = np.linalg.norm(traces["ideal"].p_world - short_recording.p_world, axis=1)
    assert ideal.max() < 0.1


def test_interval_of_a_mean() -> None:
    values = [0.1, 0.2, 0.4]
    low, high = stats.t.interval(0.95, 2, loc=np.mean(values), scale=stats.sem(values))
    found = interval(values)
    assert found["ci95"] == pytest.approx([low, high])
    assert interval([0.3]) == {"mean": 0.3, "ci95": [0.3, 0.3]}


def test_seeds_are_kept_and_taken_up_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("camnet.experiments.motion_learning_runs.score", lambda r, t: score(r, t, 1.0))
    first = run_seeds([5], SHORT, tmp_path, None)
    kept = tmp_path / "seed-5.json"
    content = json.loads(kept.read_text())
    seal = content.pop("seal")
    assert content == first[0]
    marked = {"seed": 5, "mark": 1}
    write_json(kept, {**marked, "seal": seal_of(marked)})
    assert run_seed(5, SHORT, tmp_path, keep_trace=True) == marked
    for damage in (
        {**marked, "seal": seal},
        marked,
        {**marked, "seed": 6, "seal": seal_of({**marked, "seed": 6})},
    ):
        write_json(kept, damage)
        assert _kept(tmp_path, 5, True) is None
    write_json(kept, {**content, "seal": seal})
    assert _kept(tmp_path, 5, True) == content
    trace = trace_file(tmp_path, 5)
    trace.write_bytes(trace.read_bytes()[:-50])
    assert _kept(tmp_path, 5, True) is None
    assert _kept(tmp_path, 5, False) == content
    assert digest(SHORT) != digest(SceneSettings())
    assert digest(SHORT) == digest(SceneSettings(**SHORT.model_dump()))


def test_seeds_must_be_positive() -> None:
    with pytest.raises(ConfigError, match="seeds"):
        run(seeds=0)


@pytest.mark.slow
def test_processes_do_not_change_results(tmp_path: Path) -> None:
    scene = SceneSettings(duration_s=215.0)
    alone = run_seeds([0, 1], scene, tmp_path / "one", None, workers=1)
    assert run_seeds([0, 1], scene, tmp_path / "two", None, workers=2) == alone


@pytest.mark.slow
def test_acceptance_on_two_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = run(seeds=2, out_dir=tmp_path / "out")
    rows = {name: {k: v["mean"] for k, v in row.items()} for name, row in result["rows"].items()}
    assert rows["learned"]["position_rmse_m"] <= 0.08
    assert rows["learned"]["orientation_rmse_deg"] <= 8.0
    assert rows["learned_image"]["position_rmse_m"] <= 0.10
    assert rows["learned_image"]["orientation_rmse_deg"] <= 10.0
    assert 0.015 <= rows["ideal"]["position_rmse_m"] <= 0.06
    assert 0.6 <= rows["ideal"]["orientation_rmse_deg"] <= 2.4
    for measure in ("position_rmse_m", "orientation_rmse_deg"):
        assert rows["ekf"][measure] >= 5.0 * rows["learned"][measure]
    print_table(result)
    assert "learned_published" in capsys.readouterr().out
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"trajectory.png", "states.png", "errors.png"}

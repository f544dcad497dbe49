"""The moving-target experiment on a small scale."""

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.experiments.moving_target import print_table, run
from camnet.experiments.moving_target_identities import identity_errors
from camnet.experiments.moving_target_run import scene_truth
from camnet.experiments.moving_target_scene import MovingSetUp, make_moving_scene

PARTS = ("gaps", "first_lap", "varied_speed", "branch")


def test_identities_hold_to_1e_10_and_the_printed_velocity_does_not():
    worst, printed = identity_errors()
    assert worst < 1e-10
    assert printed > 0.1


def test_a_small_run_has_every_part_of_the_result(tmp_path, capsys):
    setup = MovingSetUp(duration_s=130.0, noises_px=(0.5,), scale_seeds=1, corners=20)
    result = run(1, tmp_path, seed=1, setup=setup)
    assert result["identities_max_error"] < 1e-10
    assert abs(result["scale"]["rms_pct"]) < 2.0
    assert result["scale"]["shape_mm"] < 4.0
    seen = result["seen"]
    assert seen["position_m"] < 2.0 * seen["position_bound_m"]
    assert seen["velocity_mps"] < 0.05
    assert seen["velocity_chi_printed_mps"] > 2.0 * seen["velocity_chi_mps"]
    for part in PARTS:
        for row in ("replay", "velocity_field", "acceleration", "constant_velocity", "coordinated_turn"):
            entry = result[part][row]
            assert entry["count"] > 0
            assert 0.0 <= entry["median_m"] <= entry["p90_m"]
    fork = result["branch"]["across_fork"]
    assert 0 <= fork["holds_true"] <= fork["count"] <= result["branch"]["replay"]["count"]
    assert result["first_lap"]["replay"]["median_m"] <= result["first_lap"]["coordinated_turn"]["median_m"]
    assert set(result["never_at_rest"]) >= {"30s_pct", "150s_pct"}
    assert result["never_at_rest"]["still_camera"] == "unobservable"
    assert {p.name for p in tmp_path.iterdir()} >= {"page.html", "gaps.png", "places.png"}
    print_table(result)
    assert "coordinated_turn" in capsys.readouterr().out


def test_no_seeds_are_refused():
    with pytest.raises(ConfigError, match="seeds"):
        run(0)


@pytest.mark.parametrize("way", ["same", "speed", "branch"])
def test_the_target_moves_as_the_scene_says(way):
    setup = MovingSetUp(duration_s=150.0)
    scene = make_moving_scene(setup, 0.5, way, np.random.default_rng(3))
    target, t = scene.target, scene.t_s
    assert np.all(target.p_world[t < setup.rest_s] == target.p_world[0])
    moving = t > setup.rest_s + 2.0
    speed = np.linalg.norm(target.v_world[moving], axis=1)
    low, high = setup.speed_mps
    spread = setup.speed_spread if way == "speed" else 0.0
    assert low * (1.0 - spread) - 1e-9 <= speed.min() < speed.max() <= high * (1.0 + spread) + 1e-9
    # velocity and turn rate are the derivatives of position and heading; no lateral slip
    v = np.gradient(target.p_world, t, axis=0)
    inside = moving & (np.roll(target.lap, 20) == np.roll(target.lap, -20))
    np.testing.assert_allclose(v[inside], target.v_world[inside], atol=0.01)
    # the curvature jumps where the ways of a branch part: a difference over two images sees half of it
    np.testing.assert_allclose(np.gradient(target.yaw, t)[inside], target.yaw_rate[inside], atol=0.03)
    across = np.column_stack([-np.sin(target.yaw), np.cos(target.yaw), np.zeros(len(t))])
    assert np.abs(np.sum(across * target.v_world, axis=1)).max() < 1e-12
    away = np.linalg.norm(scene_truth(scene)[0], axis=1)
    assert 2.0 < away.min() < away.max() < 8.0
    assert np.isnan(scene.xy_target[~scene.seen]).all()
    assert np.array_equal(target.inner, np.zeros(len(t), dtype=bool)) == (way != "branch")

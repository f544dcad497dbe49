"""The key-frame experiment: form of its result, its page, and what a short run shows."""

import math

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation.structure.odometry import OdometryErrors
from camnet.experiments.key_frame_images import RenderedKeyFrames, image_setup
from camnet.experiments.key_frame_position import print_table, run, run_case
from camnet.experiments.key_frame_position_run import ROWS
from camnet.experiments.key_frame_setup import CASES, SetUp, WorldSettings, make_scene
from camnet.geometry.pinhole import Pinhole

SHORT = SetUp(world=WorldSettings(loops=1))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("key_frames")
    return run(seeds=1, out_dir=folder, setup=SHORT), folder


def test_result_has_every_case_gate_and_row(result, capsys):
    content, folder = result
    assert list(content["cases"]) == list(CASES)
    for by_gate in content["cases"].values():
        assert list(by_gate) == ["3px", "10px"]
        for part in by_gate.values():
            assert list(part["rows"]) == list(ROWS)
            for cells in part["rows"].values():
                assert math.isfinite(cells["rms_m"]["mean"])
                assert cells["rms_m"]["ci95"] is None
                assert cells["max_m"] >= cells["rms_m"]["mean"]
            assert 0.0 <= part["key_frames"]["passed_share"] <= 1.0
            assert 35 < part["key_frames"]["count"] < 50
            # predictions of features out of view keep within the sound bound, and come near it
            off = part["key_frames"]["off_view"]
            assert off["count"] > 100
            assert off["broken"] == 0
            assert 0.5 < off["largest_share"] <= 1.0
    for name in ("paths", "errors", "distances"):
        assert (folder / f"{name}_mixed_3px.png").stat().st_size > 1000
    page = (folder / "page.html").read_text()
    assert "0.63" in page
    assert "key frames" in page
    print_table(content)
    assert "published 0.58; 1.00" in capsys.readouterr().out


def test_wider_gate_lets_more_key_frames_pass(result):
    for by_gate in result[0]["cases"].values():
        frames = [by_gate[gate]["key_frames"]["passed_share"] for gate in ("3px", "10px")]
        assert frames[1] > frames[0]


def test_filter_is_below_dead_reckoning_on_gyro_errors(result):
    for case in ("gyro_scale", "mixed"):
        rows = result[0]["cases"][case]["3px"]["rows"]
        assert rows["augmented"]["rms_m"]["mean"] < 0.7 * rows["dead_reckoning"]["rms_m"]["mean"]


def test_equal_seeds_give_equal_runs(result):
    again = run_case(SHORT, "mixed", 0)["3px"]
    assert (
        again.rms("augmented_reuse")
        == result[0]["cases"]["mixed"]["3px"]["rows"]["augmented_reuse"]["rms_m"]["mean"]
    )
    assert np.all(again.error_m["dead_reckoning"][again.landmark] < 0.05)


def test_corners_read_from_rendered_images_are_where_their_points_project():
    setup = image_setup(SetUp())
    scene = make_scene(setup.world, OdometryErrors(), np.random.default_rng(0))
    frames = RenderedKeyFrames(setup, scene, np.random.default_rng(0))
    key = next(iter(frames))
    assert key.seen[0].sum() >= 30
    assert 10 < len(key.seen) < 60
    assert np.all(key.seen.sum(axis=1) >= setup.key_frames.least_features)
    camera = Pinhole.from_settings(setup.world.camera)
    last = len(key.seen) - 1
    expected = camera.project_world(key.points_world, scene.truth.p_world[last], scene.truth.q_world[last])
    off = np.linalg.norm(expected - key.pixels[last], axis=1)[key.seen[last]]
    assert np.median(off) < 0.3
    assert np.max(off) < 3.0
    walls = 0.5 * np.array(setup.world.size_m) + setup.world.wall_m
    inside = np.all(np.abs(key.points_world[:, :2]) < walls + 1e-9, axis=1)
    assert inside.all()


def test_no_runs_are_refused():
    with pytest.raises(ConfigError, match="seeds: 0"):
        run(0)

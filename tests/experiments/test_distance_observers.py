"""The distance-observer experiment: two runs, against the published figures; what is refused; figures and page."""

import json

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.experiments.distance_observers import print_table, run
from camnet.experiments.distance_observers_images import board_tracks
from camnet.experiments.distance_observers_run import PARTS, ROWS
from camnet.experiments.distance_observers_scene import SetUp, make_scene


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    folder = tmp_path_factory.mktemp("distance") / "out"
    return run(2, folder), folder


def test_two_runs_are_near_print(two):
    rows = {name: {p: entry["mean"] for p, entry in row.items()} for name, row in two[0]["rows"].items()}
    two_, bundle = rows["estimator_2"], rows["bundle"]
    assert tuple(rows) == ROWS
    assert 45.0 < two_["whole"] < 69.0
    assert 80.0 < two_["before"] < 120.0
    assert rows["estimator_1"]["before"] == pytest.approx(134.8, rel=0.06)
    assert two_["before"] < 0.9 * rows["estimator_1"]["before"]
    for part in ("whole", "before"):
        assert bundle[part] < 0.75 * two_[part]
        assert rows["bundle_depth_prior"][part] < bundle[part]
    for row in ("estimator_1", "estimator_2", "bundle", "bundle_depth_prior"):
        assert rows[row]["after"] < 6.0
    bound = two[0]["bound"]
    assert bound["depth_prior"]["before"] < bound["before"] < bundle["before"]
    assert two[0]["position_m"]["after"] < 0.08


def test_a_run_is_one_json_object_and_the_seed_fixes_it(two):
    text = json.dumps(two[0], allow_nan=False)
    assert json.loads(text)["config"]["start_m"] == 3.4
    again = run(1, seed=1)
    first = two[0]["runs"][1]
    for name in ROWS:
        assert [again["runs"][0]["rows"][name][p] for p in PARTS] == [first["rows"][name][p] for p in PARTS]


def test_figures_page_and_table_show_print_beside_ours(two, capsys):
    names = sorted(p.name for p in two[1].iterdir())
    assert names == ["errors.png", "page.html", "paths.png", "position.png"]
    assert "published 105.45" in (two[1] / "page.html").read_text()
    print_table(two[0])
    assert "105.45" in capsys.readouterr().out


def test_no_runs_are_refused():
    with pytest.raises(ConfigError, match="seeds: 0"):
        run(0)


def test_split_is_at_the_last_feature_learned(two):
    for one in two[0]["runs"]:
        assert 0.2 < one["learned_from_s"] / one["duration_s"] < 0.45
        assert np.isfinite(one["position_m"]["after"])


def test_corners_read_from_rendered_images_are_the_boards():
    setup = SetUp(path_m=0.3)
    rng = np.random.default_rng(0)
    scene = make_scene(setup, rng)
    frames = list(board_tracks(setup, scene, rng))
    assert len(frames) == len(scene.t_s)
    truth = scene.path.states(scene.t_s)
    off = [
        f.pixels - scene.camera.project_world(scene.points_world[f.ids], truth.p_world[k], truth.q_world[k])
        for k, f in enumerate(frames)
    ]
    assert all(len(f.ids) == 48 for f in frames)
    assert np.sqrt(np.mean(np.square(off))) < 0.3
    assert np.abs(np.mean(np.concatenate(off), axis=0)).max() < 0.1

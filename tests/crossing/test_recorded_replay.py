"""The replay of recorded tracks: what counts as a gap, causality, a planted site, and the real recording."""

import json
import math

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.estimation.crossing import CrossingSettings
from camnet.experiments.recorded import run_recorded
from camnet.experiments.recorded_rows import remedy_rows
from camnet.experiments.recorded_summary import Row, summarise
from camnet.geometry import rotations
from camnet.geometry.settings import Intrinsics
from camnet.importers.geodesy import Origin
from camnet.importers.krtd import read_krtd_folder
from camnet.importers.surveyed_camera import SurveyedCamera
from camnet.importers.tracks import TrackOptions, read_tracks
from camnet.motion.track import Track


def down(name, x, y, half=10.0):
    """A camera 20 m up that looks down on a square of 2 x half metres."""
    focal = 20.0 / half * 500.0
    intrinsics = Intrinsics(width_px=1000, height_px=1000, fx_px=focal, fy_px=focal, cx_px=500.0, cy_px=500.0)
    q = rotations.from_matrix(np.diag([1.0, -1.0, -1.0]))
    return SurveyedCamera(name, intrinsics, np.array([x, y, 20.0]), q)


CAMERAS = (down("west", 0.0, 0.0), down("east", 60.0, 0.0), down("north", 0.0, 60.0))


def walker(identity, start_s, corner, stops, speed=1.25, dt=8.0):
    """A track through straight pieces, a fix every ``dt``."""
    t, times, places = start_s, [], []
    here = np.array(corner, dtype=float)
    for stop in stops:
        leg = np.array(stop, dtype=float) - here
        steps = max(round(np.linalg.norm(leg) / (speed * dt)), 1)
        for k in range(steps):
            times.append(t)
            places.append([*(here + leg * k / steps), 0.0])
            t += dt
        here = here + leg
    return Track(identity, np.array(times), np.array(places))


def site(seed=0, people=14):
    """Each person walks round trips west - corner - east: the path across the gap bends, so its exit misleads."""
    rng = np.random.default_rng(seed)
    tracks = []
    for k in range(people):
        bend = (30.0, 35.0)
        wobble = rng.normal(0.0, 0.5, 2)
        stops = [(5.0, 8.0), bend, (60.0, 8.0), (60.0, 0.0), (60.0, 8.0), bend, (5.0, 8.0), (0.0, 0.0)] * 2
        stops = [tuple(np.array(s) + wobble) for s in stops]
        tracks.append(walker(f"p{k}", 97.0 * k, (0.0, 0.0), stops, speed=rng.uniform(1.1, 1.4)))
    return tracks


def run(tracks, **changes):
    return run_recorded(CAMERAS, tracks, target_height_m=0.0, **changes)


def test_a_gap_is_seen_unseen_seen_and_nothing_else():
    x = [0, 8, 16, 30, 44, 52, 60]
    track = Track("a", 10.0 * np.arange(7), np.column_stack([x, np.zeros(7), np.zeros(7)]))
    table = run([track]).gaps
    assert table["exit_camera"] == ["west"]
    assert table["entry_camera"] == ["east"]
    assert list(table["exit_t_s"]) == [10.0]
    assert list(table["entry_t_s"]) == [50.0]
    np.testing.assert_allclose(table["exit_v_x_mps"], [0.8])
    np.testing.assert_allclose(table["last_seen_error_m"], [44.0])
    assert table["target"] == ["a"]


def test_a_recording_that_stopped_is_no_gap():
    seen = Track("a#1", np.arange(3) * 10.0, np.array([[0, 0, 0], [8, 0, 0], [16, 0, 0]]))
    later = Track("a#2", 200.0 + np.arange(2) * 10.0, np.array([[44, 0, 0], [52, 0, 0]]))
    whole = Track("a", np.concatenate([seen.t_s, later.t_s]), np.concatenate([seen.p_world, later.p_world]))
    for tracks in ([seen, later], [whole]):
        with pytest.raises(DataError, match="no target is seen, lost and seen again"):
            run(tracks)
        assert len(run(tracks, max_fix_interval_s=1000.0).gaps["target"]) == 1


def test_gaps_outside_the_stated_lengths_are_left_out():
    tracks = site(people=3)
    duration = np.subtract(run(tracks).gaps["entry_t_s"], run(tracks).gaps["exit_t_s"])
    middle = float(np.median(duration))
    longer = run(tracks, min_gap_s=middle).gaps
    assert np.min(np.subtract(longer["entry_t_s"], longer["exit_t_s"])) >= middle
    shorter = run(tracks, max_gap_s=middle).gaps
    assert np.max(np.subtract(shorter["entry_t_s"], shorter["exit_t_s"])) <= middle


def test_on_a_planted_site_learned_finds_the_way_that_others_took():
    result = run(site())
    gaps = result.summary["gaps"]
    assert gaps["count"] == len(result.gaps["target"]) > 50
    assert gaps["learned"]["median_error_m"] < 5.0
    assert gaps["learned"]["median_error_m"] < 0.25 * gaps["last_seen"]["median_error_m"]
    assert gaps["learned"]["median_error_m"] < 0.25 * gaps["ekf"]["median_error_m"]
    assert gaps["next_camera_accuracy"]["last_seen"] == 0.0
    assert gaps["next_camera_accuracy"]["learned"] > 0.9
    json.dumps(result.summary, allow_nan=False)


def test_the_map_holds_what_a_picture_needs():
    picture = run(site(people=4), origin=Origin(39.0, -85.0)).map
    assert picture.cameras == ("west", "east", "north")
    assert picture.exits.shape == picture.entries.shape == picture.predicted.shape
    (outline,) = picture.footprints[0]
    np.testing.assert_allclose(outline.min(axis=0), [-10, -10], atol=1e-9)
    np.testing.assert_allclose(outline.max(axis=0), [10, 10], atol=1e-9)
    inside = np.max(np.abs(picture.fixes), axis=1) < 9.5
    assert np.all(picture.seen[inside])


PREDICTED = [
    f"{row}_{axis}_m" for row in ("learned", "ekf", "last_seen", "now", "flow_prior_gaps") for axis in "xy"
]


def test_altering_the_future_changes_no_prediction():
    tracks = site()
    first = run(tracks, more_rows=remedy_rows)
    cut = float(np.quantile(first.gaps["entry_t_s"], 0.6))
    rng = np.random.default_rng(5)
    altered = []
    for track in tracks:
        p = track.p_world.copy()
        future = track.t_s > cut
        p[future, :2] = rng.uniform(-20.0, 80.0, (future.sum(), 2))
        altered.append(Track(track.id, track.t_s, p))
    second = run(altered, more_rows=remedy_rows)
    before = np.flatnonzero(np.asarray(first.gaps["entry_t_s"]) <= cut)
    assert len(before) > 30
    for name in [*PREDICTED, "learned_radius_m"]:
        np.testing.assert_array_equal(
            np.asarray(first.gaps[name])[before], np.asarray(second.gaps[name])[before]
        )
    assert [first.gaps["learned_next_camera"][k] for k in before] == [
        second.gaps["learned_next_camera"][k] for k in before
    ]


def test_what_happens_after_an_exit_changes_no_prediction_of_it_but_the_time():
    tracks = site()
    first = run(tracks)
    k = int(len(first.gaps["target"]) * 0.8)
    who, exit_s, entry_s = (first.gaps[n][k] for n in ("target", "exit_t_s", "entry_t_s"))
    altered = []
    for track in tracks:
        p = track.p_world.copy()
        after = track.t_s > exit_s
        if track.id == who:
            after &= track.t_s >= entry_s  # still unseen until the same time, then elsewhere
            p[after, :2] = [3.0, 55.0]
        else:
            p[after, :2] = [500.0, 500.0]
        altered.append(Track(track.id, track.t_s, p))
    second = run(altered)
    same = np.flatnonzero(
        (np.asarray(second.gaps["exit_t_s"]) == exit_s) & (np.array(second.gaps["target"]) == who)
    )
    (j,) = same
    assert second.gaps["entry_camera"][j] == "north"
    for name in ("learned_x_m", "learned_y_m", "ekf_x_m", "ekf_y_m", "learned_radius_m"):
        assert first.gaps[name][k] == second.gaps[name][j]
    assert first.gaps["learned_next_camera"][k] == second.gaps["learned_next_camera"][j]


def test_only_what_cameras_saw_is_used():
    tracks = site(people=6)
    first = run(tracks)
    rng = np.random.default_rng(2)
    altered = []
    for track in tracks:
        p = track.p_world.copy()
        unseen = np.min([np.max(np.abs(p[:, :2] - c.p_world[:2]), axis=1) for c in CAMERAS], axis=0) > 10.0
        p[unseen, :2] = rng.uniform(200.0, 300.0, (unseen.sum(), 2))
        altered.append(Track(track.id, track.t_s, p))
    second = run(altered)
    assert first.summary == second.summary


def test_order_of_the_tracks_does_not_matter():
    tracks = site(people=5)
    one, two = run(tracks).summary["gaps"], run(tracks[::-1]).summary["gaps"]
    assert one["learned"]["median_error_m"] == pytest.approx(two["learned"]["median_error_m"], abs=0.3)
    assert one["last_seen"] == two["last_seen"]


def test_a_stopped_run_covers_the_part_before():
    tracks = site()

    calls = []

    def stop(share):
        calls.append(share)
        if share > 0.0:
            raise KeyboardInterrupt

    long = [Track(t.id, t.t_s, t.p_world) for t in tracks]
    long += [walker(f"q{k}", 5000.0 + 60.0 * k, (0, 0), [(60, 8), (0, 0)] * 12) for k in range(14)]
    partial, whole = run(long, progress=stop), run(long)
    assert partial.interrupted
    assert not whole.interrupted
    n = len(partial.gaps["target"])
    assert 0 < n < len(whole.gaps["target"])
    for column, values in whole.gaps.items():
        np.testing.assert_array_equal(np.asarray(values[:n]), np.asarray(partial.gaps[column]))


def test_nothing_to_replay_is_refused():
    with pytest.raises(DataError, match="0 cameras and 1 tracks"):
        run_recorded((), site(people=1))


def test_bootstrap_of_equal_gaps_has_no_width_and_of_many_targets_the_known_one():
    rng = np.random.default_rng(0)
    n = 400
    error = np.abs(rng.normal(10.0, 3.0, n))
    rows = {
        "learned": Row(error, np.ones(n, dtype=bool)),
        "ekf": Row(np.full(n, 7.0), np.zeros(n, dtype=bool)),
        "last_seen": Row(error + 5.0, rng.random(n) < 0.5),
        "learned_at_exit": Row(error, np.ones(n, dtype=bool)),
    }
    out = summarise(rows, np.arange(n), rng)
    assert out["ci95"]["median_error_m"]["ekf"] == [7.0, 7.0]
    np.testing.assert_allclose(out["ci95"]["median_error_below_last_seen_m"], 5.0)
    low, high = out["ci95"]["median_error_m"]["learned"]
    assert low < 10.0 < high
    expected = 2 * 1.96 * 3.0 * math.sqrt(math.pi / 2 / n)  # normal median
    assert high - low == pytest.approx(expected, rel=0.4)
    low, high = out["ci95"]["next_camera_accuracy"]["last_seen"]
    assert high - low == pytest.approx(2 * 1.96 * 0.5 / math.sqrt(n), rel=0.25)


SITE = Origin(39.04977294, -85.52924953, 205.0)


def real(shared_data):
    folder = shared_data / "meva"
    tracks = read_tracks(folder / "tracks.csv.gz", "csv", TrackOptions(SITE))
    return read_krtd_folder(folder / "cameras", 1920, 1080), tracks


def test_real_people_a_first_part(shared_data):
    cameras, tracks = real(shared_data)
    first = min(track.t_s[0] for track in tracks)
    early = [
        t.select(0, int(np.searchsorted(t.t_s, first + 86_400.0)))
        for t in tracks
        if t.t_s[0] < first + 80_000.0
    ]
    summary = run_recorded(cameras, early, range_cap_m=80.0).summary
    gaps = summary["gaps"]
    assert gaps["count"] > 700
    assert gaps["learned"]["median_error_m"] < gaps["last_seen"]["median_error_m"]
    assert gaps["learned"]["median_error_m"] < gaps["ekf"]["median_error_m"]
    assert gaps["next_camera_accuracy"]["learned"] > gaps["next_camera_accuracy"]["last_seen"] + 0.03


@pytest.mark.slow
def test_real_people_all(shared_data):
    cameras, tracks = real(shared_data)
    summary = run_recorded(cameras, tracks, CrossingSettings(), range_cap_m=80.0, origin=SITE).summary
    gaps = summary["gaps"]
    assert 3000 < gaps["count"] < 4000
    assert gaps["learned"]["median_error_m"] <= 14.0
    assert gaps["ci95"]["median_error_below_last_seen_m"][0] > 4.0
    assert gaps["next_camera_accuracy"]["learned"] >= gaps["next_camera_accuracy"]["last_seen"] + 0.1
    assert gaps["ci95"]["next_camera_accuracy_above_last_seen"][0] > 0.1
    assert 0.85 < gaps["radius_coverage"] < 0.95

"""Certificates of surveyed cameras, and recorded people that hold them to it."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.certification.free_network import FreeTargetClass
from camnet.certification.site import views_of
from camnet.experiments.certify_site import (
    certify_cameras,
    usable_frustum,
)
from camnet.experiments.recorded_people import check_recorded
from camnet.geometry.frustum import Frustum
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.importers.krtd import read_krtd_folder
from camnet.motion.track import Track


def test_distortion_that_folds_over_cuts_the_view():
    fine = Intrinsics(width_px=1920, height_px=1080, fx_px=1000, fy_px=1000, cx_px=960, cy_px=540)
    assert usable_frustum("a", fine, 1.0, 80.0)[1] == 1.0
    folds = fine.model_copy(update={"distortion": (-0.45, 0.0, 0.0, 0.0)})
    frustum, share = usable_frustum("b", folds, 1.0, 80.0)
    assert 0.3 < share < 1.0
    # r (1 - 0.45 r^2) rises up to r = 1 / sqrt(1.35): no corner of the view may be beyond it
    assert np.hypot(frustum.tangents[1], frustum.tangents[3]) <= 1 / np.sqrt(1.35) + 1e-9


def test_surveyed_cameras_against_recorded_people(shared_data):
    from camnet.importers.csv_tracks import read_csv_tracks
    from camnet.importers.fixes import TrackOptions
    from camnet.importers.geodesy import Origin

    target = FreeTargetClass(2.0, 0.3)
    done, views, names, warnings = certify_cameras(
        read_krtd_folder(shared_data / "meva" / "cameras", 1920, 1080), target, range_m=80.0
    )
    assert len(done.report["transitions"]) == 14 * 13
    assert [w[:4] for w in warnings] == ["G638"]
    origin = Origin(39.04977294, -85.52924953, 205.0)
    tracks = read_csv_tracks(shared_data / "meva" / "tracks.csv.gz", TrackOptions(origin=origin))
    found = check_recorded(tracks, views, names, target, 0.0)
    assert found["held_out"]["unseen"] > 1000
    assert found["held_out"]["outside"] == 0
    assert found["table"][0]["outside"] > 100  # exact fixes: many leave, so that the check can fail
    least = found["least_fix_error_m"]
    assert check_recorded(tracks, views, names, target, 0.0, least + 1e-6)["outside"] == 0
    assert check_recorded(tracks, views, names, target, 0.0, least - 1e-3)["outside"] >= 1
    fast = FreeTargetClass(found["least_v_max_mps"] + 1e-6, 0.3)
    assert check_recorded(tracks, views, names, fast, 0.0, 0.0)["outside"] == 0


def test_fix_error_by_hand():
    """One camera over the origin; a person walks out of view, and one fix is thrown 15 m aside."""
    frustum = Frustum.from_camera(
        CameraModel(
            name="c",
            intrinsics=Intrinsics(width_px=200, height_px=200, fx_px=100, fy_px=100, cx_px=100, cy_px=100),
            near_m=1.0,
            far_m=20.0,
        )
    )
    eye = np.array([[0.0, 0.0, 10.0]])
    views = views_of([frustum.in_world(eye[0], np.array([0.0, 1.0, 0.0, 0.0]))], eye)  # sees |x|, |y| <= 10
    t = np.array([0.0, 10.0, 20.0, 30.0])
    p = np.array([[0.0, 0, 0], [9.0, 0, 0], [29.0, 15, 0], [40.0, 0, 0]])
    target = FreeTargetClass(2.0, 0.0)
    found = check_recorded([Track("a", t, p)], views, ["c"], target, 0.0, 2.4)
    # 25 m from the exit after 10 s: 5 m too far, so that each of the two fixes is off by at least 2.5 m
    assert found["least_fix_error_m"] == pytest.approx(2.5)
    assert (found["unseen"], found["outside"], found["people_outside"]) == (2, 1, 1)
    assert check_recorded([Track("a", t, p)], views, ["c"], target, 0.0, 2.6)["outside"] == 0
    # the second step of 25 m, and the third of sqrt(11^2 + 15^2) < 20 m
    assert found["faster_than_v_max"] == 1
    assert found["least_v_max_mps"] == pytest.approx(2.5)

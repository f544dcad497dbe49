"""Tracks through drawn images: accuracy, numbers, what is lost, what is renewed."""

import numpy as np
import pytest

from camnet.estimation.structure.image_tracks import ImageTracks, TrackerSettings
from camnet.geometry import rotations as rot
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import Intrinsics
from camnet.sensing.textured_planes import TexturedPlane, draw_planes

CAMERA = Pinhole.from_settings(
    Intrinsics(width_px=320, height_px=240, fx_px=300.0, fy_px=300.0, cx_px=159.5, cy_px=119.5)
)
RNG = np.random.default_rng(0)
BLOCKS = np.kron(RNG.integers(20, 236, (40, 60)), np.ones((12, 12))).astype(np.uint8)
WALL = TexturedPlane(
    np.array([-3.0, -2.0, 3.0]), np.array([6.0, 0.0, 0.0]), np.array([0.0, 4.0, 0.0]), BLOCKS
)
SETTINGS = TrackerSettings(corners=60)


def poses(count):
    return [
        (np.array([0.02 * k, 0.01 * k, 0.0]), rot.exp(np.array([0.0, 0.0, 0.005 * k]))) for k in range(count)
    ]


def sequence(count, planes=lambda k: [WALL]):
    for k, (p, q) in enumerate(poses(count)):
        image = draw_planes(planes(k), CAMERA, p, q) + 1.5 * RNG.standard_normal((240, 320))
        yield k / 30.0, np.clip(np.rint(image), 0, 255).astype(np.uint8)


def on_wall(pixels, pose):
    """Where rays through pixels hit the wall z = 3."""
    ray = rot.rotate(pose[1], CAMERA.unproject(pixels))
    return pose[0] + ray * ((3.0 - pose[0][2]) / ray[:, 2])[:, None]


def test_corners_stay_on_their_points():
    frames = list(ImageTracks(sequence(15), SETTINGS))
    first, last = frames[0], frames[-1]
    assert len(first.ids) > 40
    both = np.intersect1d(first.ids, last.ids)
    assert len(both) > 25
    points = on_wall(first.pixels[np.isin(first.ids, both)], poses(15)[0])
    p, q = poses(15)[-1]
    off = CAMERA.project_world(points, p, q) - last.pixels[np.isin(last.ids, both)]
    assert np.median(np.linalg.norm(off, axis=1)) < 0.3
    for frame in frames:
        assert np.all(np.diff(frame.ids) > 0)


def test_given_corners_keep_their_numbers_and_are_not_renewed():
    start = np.array([[100.0, 100.0], [150.0, 120.0], [200.0, 60.0]])
    frames = list(ImageTracks(sequence(4), TrackerSettings(refine_px=0.0), start))
    np.testing.assert_array_equal(frames[0].pixels, start)
    for frame in frames:
        assert set(frame.ids) <= {0, 1, 2}


def test_covered_corners_are_lost_and_new_ones_get_new_numbers():
    cover = TexturedPlane(
        np.array([-1.5, -2.0, 1.5]),
        np.array([1.7, 0.0, 0.0]),
        np.array([0.0, 4.0, 0.0]),
        BLOCKS[::-1, ::-1].copy(),
    )
    frames = list(ImageTracks(sequence(8, lambda k: [WALL] if k < 4 else [WALL, cover]), SETTINGS))
    before, after = frames[3], frames[4]
    hidden = before.pixels[:, 0] < 160.0
    followed = np.isin(before.ids, after.ids)
    assert hidden.sum() > 10
    assert followed[hidden].mean() < 0.2
    assert followed[~hidden].mean() > 0.8
    fresh = np.setdiff1d(frames[-1].ids, frames[3].ids)
    assert len(fresh) > 5
    assert fresh.min() > before.ids.max()


@pytest.mark.parametrize("grey", [0, 128])
def test_an_empty_image_has_no_corners(grey):
    images = [(0.0, np.full((240, 320), grey, dtype=np.uint8))] * 2
    assert all(len(f.ids) == 0 for f in ImageTracks(images, SETTINGS))


def test_corners_are_found_where_the_mask_allows():
    mask = np.zeros((240, 320), dtype=np.uint8)
    mask[:, :100] = 255
    frame = next(iter(ImageTracks(sequence(1), SETTINGS, mask=mask)))
    assert len(frame.ids) > 5
    assert frame.pixels[:, 0].max() < 102.0

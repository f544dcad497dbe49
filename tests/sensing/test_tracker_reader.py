from __future__ import annotations

import cv2
import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.geometry import rotations
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.sensing.settings import SensingSettings, TrackerSettings
from camnet.sensing.tracker_reader import TrackerReader, _corners
from camnet.sensing.vision_sensor import build_sensor
from camnet.types import Snapshot

BODY = np.array([[-0.3, -0.2, 0.0], [0.3, -0.2, 0.0], [0.3, 0.2, 0.25], [-0.3, 0.2, 0.25]])
CAMERA = CameraModel(
    name="c", intrinsics=Intrinsics(width_px=320, height_px=240, fx_px=210, fy_px=210, cx_px=160, cy_px=120)
)
LENS = Pinhole.from_settings(CAMERA.intrinsics)
TILTED = rotations.look_at(np.array([0.0, -2.0, 3.0]), np.array([0.0, 0.3, 0.0]))


class Stage:
    """A block of six colours on a floor of slow shades, drawn by its projection alone."""

    def __init__(self):
        rng = np.random.default_rng(0)
        coarse = rng.uniform(90, 110, (3, 4)).astype(np.float32)
        self.floor = cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_CUBIC)
        self.t = 0.0
        self.hidden = False

    def snapshot(self):
        speed, turn = 0.4, 0.3
        heading = 0.4 + turn * self.t
        p = np.array([np.sin(heading) - np.sin(0.4), np.cos(0.4) - np.cos(heading), 0.0]) * speed / turn
        q = np.array([np.cos(heading / 2), 0, 0, np.sin(heading / 2)])
        eye = np.array([0.05 * np.sin(self.t), -2.0 + 0.1 * self.t, 3.0])
        one = np.zeros((1, 3))
        unit = np.array([[1.0, 0, 0, 0]])
        agent = (eye[None], unit, one, one)
        camera = (eye[None], TILTED[None], one, one)
        return Snapshot(self.t, 0, *agent, *camera, p[None], q[None], one, one)

    def render(self, camera, width, height):
        s = self.snapshot()
        picture = np.repeat(self.floor[..., None], 3, axis=2).astype(np.uint8)
        if self.hidden:
            return picture
        solid = rotations.rotate(s.target_q_world[0], _corners(BODY)) + s.target_p_world[0]
        faces = [
            ((0, 2, 6, 4), 60),
            ((0, 1, 5, 4), 90),
            ((2, 3, 7, 6), 110),
            ((4, 5, 7, 6), 160),
            ((0, 1, 3, 2), 30),
        ]
        faces.append(((1, 3, 7, 5), 230))
        for corners, level in faces:
            pixels = LENS.project_world(solid[list(corners)], s.camera_p_world[0], s.camera_q_world[0])
            cv2.fillConvexPoly(picture, np.rint(pixels).astype(np.int32), (level, level // 2, 255 - level))
        return picture


def poses(stage, reader, seconds, rate=10.0):
    rng, out = np.random.default_rng(1), []
    for _ in range(round(seconds * rate)):
        stage.t += 1.0 / rate
        s = stage.snapshot()
        pose = reader.read(s, 0, 0, rng)
        if pose is not None:
            p = s.camera_p_world[0] + rotations.rotate(s.camera_q_world[0], pose.p)
            q = rotations.multiply(s.camera_q_world[0], pose.q)
            away = np.linalg.norm(p - s.target_p_world[0])
            off = 2 * np.arccos(min(abs(float(q @ s.target_q_world[0])), 1.0))
            out.append((s.t_s, away, off))
    return np.array(out)


def test_a_block_is_followed_on_the_ground_with_its_heading_from_its_motion():
    stage = Stage()
    found = poses(stage, TrackerReader(TrackerSettings(), [CAMERA], [BODY], stage.render), 4.0)
    assert len(found) >= 33  # no heading, no pose in the first tenths of a second
    assert np.sqrt(np.mean(found[:, 1] ** 2)) < 0.06
    assert found[:, 1].max() < 0.15
    assert np.median(found[10:, 2]) < 0.2


def test_the_tracker_follows_the_picture_not_the_truth(monkeypatch):
    stage = Stage()
    reader = TrackerReader(TrackerSettings(least_psr=0.0), [CAMERA], [BODY], stage.render)
    poses(stage, reader, 1.5)
    stage.hidden = True  # the truth goes on, the picture is empty
    blind = poses(stage, reader, 2.0)
    assert len(blind) == 0 or blind[-1, 1] > 0.1


def test_a_lost_target_is_detected_anew():
    stage = Stage()
    reader = TrackerReader(TrackerSettings(), [CAMERA], [BODY], stage.render)
    before = poses(stage, reader, 1.5)
    stage.t += 1.5
    after = poses(stage, reader, 1.5)
    assert len(before)
    assert len(after)
    assert after[:, 1].max() < 0.15


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigError, match="renders"):
        build_sensor(SensingSettings(level="image_tracker"), [CAMERA], [BODY], None)

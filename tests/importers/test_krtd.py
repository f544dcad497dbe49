from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from camnet.errors import DataError
from camnet.importers.krtd import read_krtd, read_krtd_folder

GOOD = """800 0 640
0 810 360
0 0 1

1 0 0
0 0 -1
0 1 0

1 2 3

-0.1 0.02 0 0
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "cam.krtd"
    path.write_text(text)
    return path


def raw_matrices(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    values = np.array([float(word) for word in path.read_text().split()])
    return values[:9].reshape(3, 3), values[9:18].reshape(3, 3), values[18:21], values[21:]


def test_world_points_project_as_opencv_projects_them(shared_data: Path) -> None:
    rng = np.random.default_rng(0)
    cameras = read_krtd_folder(shared_data / "meva/cameras", 1920, 1080)
    assert len(cameras) == 14
    for camera in cameras:
        k, r, t, d = raw_matrices(shared_data / f"meva/cameras/{camera.name}.krtd")
        # points spread in front of the camera, made from the file's own matrices
        p_cam = rng.uniform([-0.15, -0.1, 1], [0.15, 0.1, 1], (20, 3)) * rng.uniform(5, 60, (20, 1))
        p_world = (p_cam - t) @ r
        d = np.concatenate([d, np.zeros(5 - len(d))])
        expected = cv2.projectPoints(p_world, cv2.Rodrigues(r)[0], t, k, d)[0][:, 0]
        # what was read, through SciPy's rotations and OpenCV's distortion alone
        own_cam = Rotation.from_quat(camera.q_world, scalar_first=True).inv().apply(p_world - camera.p_world)
        i = camera.intrinsics
        own_k = np.array([[i.fx_px, 0, i.cx_px], [0, i.fy_px, i.cy_px], [0, 0, 1]])
        own = cv2.projectPoints(own_cam, np.zeros(3), np.zeros(3), own_k, np.array(i.distortion))[0][:, 0]
        np.testing.assert_allclose(own, expected, rtol=1e-5, atol=1e-3)


def test_surveyed_cameras_stand_above_the_ground_of_their_site(shared_data: Path) -> None:
    for camera in read_krtd_folder(shared_data / "meva/cameras", 1920, 1080):
        assert np.hypot(*camera.p_world[:2]) < 300
        assert 2 < camera.p_world[2] < 30
        assert camera.fixed_pose().position_m == tuple(camera.p_world)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1), st.integers(0, 99))
def test_any_pose_survives_the_file(
    tmp_path_factory: pytest.TempPathFactory, q: tuple[float, ...], n: int
) -> None:
    rotation = Rotation.from_quat(q, scalar_first=True)
    p_world = np.array([n, -2.0 * n, 0.5])
    r = rotation.inv().as_matrix()
    rows = [*r, -r @ p_world]
    text = "800 0 640\n0 810 360\n0 0 1\n" + "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    camera = read_krtd(written(tmp_path_factory.mktemp("k"), text), 1280, 720)
    np.testing.assert_allclose(camera.p_world, p_world, atol=1e-9)
    back = Rotation.from_quat(camera.q_world, scalar_first=True)
    assert (back.inv() * rotation).magnitude() < 1e-9
    assert camera.intrinsics.distortion == ()


def test_short_distortion_is_padded_to_a_length_opencv_takes(tmp_path: Path) -> None:
    camera = read_krtd(written(tmp_path, GOOD.replace("-0.1 0.02 0 0", "-0.1")), 1280, 720)
    assert camera.intrinsics.distortion == (-0.1, 0, 0, 0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (GOOD, "", r"cam\.krtd: is empty"),
        ("0 0 1\n", "0 0 2\n", r"line 1: K is .*last row 0 0 1 was expected"),
        ("800 0 640", "800 5 640", r"line 1: K has skew 5"),
        ("800 0 640", "-800 0 640", r"fx is -800; a positive focal length"),
        ("800 0 640", "800 0 6400", r"cx is 6400; the image ends at 1280 px"),
        ("800 0 640", "800 0 x640", r"line 1: a matrix entry is 'x640'; a decimal number"),
        ("800 0 640", "800 0 nan", r"line 1: a matrix entry is 'nan'; a finite number"),
        ("800 0 640", "800 0", r"line 1: 2 numbers .* where K"),
        ("1 0 0\n", "1 0.1 0\n", r"line 5: R is not orthonormal.* 0\.1"),
        ("1 0 0\n", "-1 0 0\n", r"line 5: R has determinant -1\.000, a reflection"),
        ("\n1 2 3\n\n-0.1 0.02 0 0\n", "", r"ends after 0 numbers of T"),
        ("1 2 3\n", "1 2\n", r"where T \(3 numbers\) was expected"),
        ("-0.1 0.02 0 0", "0 " * 15, r"D has 15 numbers; OpenCV's models have at most 14"),
    ],
)
def test_a_wrong_camera_file_is_named_quoted_and_corrected(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in GOOD
    with pytest.raises(DataError, match=message):
        read_krtd(written(tmp_path, GOOD.replace(old, new, 1)), 1280, 720)


def test_missing_and_binary_files_are_data_errors(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_krtd(tmp_path / "none.krtd", 1280, 720)
    with pytest.raises(DataError, match="is a folder"):
        read_krtd(tmp_path, 1280, 720)
    with pytest.raises(DataError, match=r"no \*\.krtd"):
        read_krtd_folder(tmp_path, 1280, 720)
    with pytest.raises(DataError, match="no such folder"):
        read_krtd_folder(tmp_path / "none", 1280, 720)
    path = tmp_path / "b.krtd"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="0xff is not UTF-8"):
        read_krtd(path, 1280, 720)
    with pytest.raises(DataError, match="image size given is 0 x 720"):
        read_krtd(written(tmp_path, GOOD), 0, 720)

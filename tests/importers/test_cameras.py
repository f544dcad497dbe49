from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from camnet.errors import DataError
from camnet.geometry.pinhole import Pinhole
from camnet.importers.cameras import CameraOptions, read_cameras
from camnet.importers.surveyed_camera import SurveyedCamera

# One sample of every format in the structure of public files, with numbers of our own: a camera at (2, -3, 5) that
# looks along y and 30 degrees down.
R = np.array([[1, 0, 0], [0, -0.5, -np.sqrt(0.75)], [0, np.sqrt(0.75), -0.5]])
C = np.array([2.0, -3.0, 5.0])
T = -R @ C
FLAT_R = ", ".join(f"{v:.12g}" for v in R.ravel())
FLAT_T = ", ".join(f"{v:.12g}" for v in T)

OPENCV_YAML = f"""%YAML:1.0
---
calibration_time: "Tue 01 Dec 2026"
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 900., 0., 645., 0., 905., 355., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -1.2e-01, 3.0e-02, 1.0e-04, -2.0e-04, 0. ]
rotation_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FLAT_R} ]
tvec: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ {FLAT_T} ]
avg_reprojection_error: 2.1e-01
"""


def _xml(name: str, rows: int, columns: int, data: str) -> str:
    return (
        f'<{name} type_id="opencv-matrix">\n  <rows>{rows}</rows>\n  <cols>{columns}</cols>\n  <dt>d</dt>\n'
        f"  <data>\n    {data}</data></{name}>\n"
    )


RVEC_XML = _xml("rvec", 3, 1, " ".join(f"{v:.12g}" for v in cv2.Rodrigues(R)[0].ravel()))
OPENCV_XML = (
    '<?xml version="1.0"?>\n<opencv_storage>\n<image_width>1280</image_width>\n<image_height>720</image_height>\n'
    + _xml("camera_matrix", 3, 3, "900. 0. 645. 0. 905. 355. 0. 0. 1.")
    + _xml("distortion_coefficients", 1, 5, "-0.12 0.03 1e-4 -2e-4 0.")
    + RVEC_XML
    + _xml("tvec", 3, 1, FLAT_T.replace(",", ""))
    + "</opencv_storage>\n"
)
ROS = """image_width: 1280
image_height: 720
camera_name: east
camera_matrix:
  rows: 3
  cols: 3
  data: [900, 0, 645, 0, 905, 355, 0, 0, 1]
camera_model: plumb_bob
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.12, 0.03, 0.0001, -0.0002, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [870, 0, 640, 0, 0, 880, 356, 0, 0, 0, 1, 0]
"""
KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.12, 0.03, 0.0001, -0.0002]
  distortion_model: radtan
  intrinsics: [900.0, 905.0, 645.0, 355.0]
  resolution: [1280, 720]
  rostopic: /east/image_raw
cam1:
  T_cn_cnm1:
  - [0.0, 0.0, -1.0, 0.5]
  - [0.0, 1.0, 0.0, 0.0]
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.12, 0.03, 0.0001, -0.0002]
  distortion_model: radtan
  intrinsics: [900.0, 905.0, 645.0, 355.0]
  resolution: [1280, 720]
  rostopic: /west/image_raw
"""
P = np.array([[900.0, 0, 645], [0, 905, 355], [0, 0, 1]]) @ np.column_stack([R, T])
KITTI = f"""calib_time: 01-Dec-2026 12:00:00
P0: {" ".join(f"{v:.12e}" for v in P.ravel())}
P1: {" ".join(f"{v:.12e}" for v in (0.01 * P).ravel())}
R0_rect: 1 0 0 0 1 0 0 0 1
"""
CAMERAS_TXT = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
7 OPENCV 1280 720 900 905 645 355 -0.12 0.03 0.0001 -0.0002
"""
IMAGES_TXT = f"""# Image list with two lines of data per image:
#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
#   POINTS2D[] as (X, Y, POINT3D_ID)
# Number of images: 1
3 0.5 0.866025403784439 0 0 {FLAT_T.replace(",", "")} 7 east.jpg
10.5 20.25 -1 30.5 40.5 11
"""
POSES = "name,x,y,z,pan,tilt,roll\neast,2,-3,5,90,30,0\n"

FILES = {
    "opencv.yaml": OPENCV_YAML,
    "opencv.xml": OPENCV_XML,
    "ros.yaml": ROS,
    "kalibr.yaml": KALIBR,
    "calib.txt": KITTI,
    "poses.csv": POSES,
}


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def model(folder: Path, cameras: str = CAMERAS_TXT, images: str = IMAGES_TXT) -> Path:
    written(folder, "cameras.txt", cameras)
    written(folder, "images.txt", images)
    return folder


def options(folder: Path, name: str) -> CameraOptions:
    needs_pose = name in ("ros.yaml", "kalibr.yaml", "poses.csv")
    poses = folder / "table.csv"
    if needs_pose and not poses.exists():
        poses.write_text(POSES)
    return CameraOptions(assumed_px=(1280, 720), poses=poses if needs_pose else None)


def read(folder: Path, name: str, text: str) -> tuple[SurveyedCamera, ...]:
    if name == "cameras.txt":
        return read_cameras(model(folder, cameras=text))
    if name == "images.txt":
        return read_cameras(model(folder, images=text))
    if name == "poses.csv":
        written(folder, "table.csv", text)
        return read_cameras(written(folder, "ros.yaml", ROS), options(folder, name))
    return read_cameras(written(folder, name, text), options(folder, name))


@pytest.mark.parametrize("name", [*FILES, "cameras.txt"])
def test_every_format_gives_the_camera_that_its_sample_describes(tmp_path: Path, name: str) -> None:
    cameras = read(tmp_path, name, CAMERAS_TXT if name == "cameras.txt" else FILES[name])
    first = cameras[0]
    rotation, translation = first.cam_from_world()
    np.testing.assert_allclose(rotation, R, atol=1e-9)
    np.testing.assert_allclose(first.p_world, C, atol=1e-9)
    np.testing.assert_allclose(translation, T, atol=1e-9)
    i = first.intrinsics
    assert (i.fx_px, i.fy_px, i.cx_px, i.cy_px) == pytest.approx((900, 905, 645, 355), abs=1e-6)
    assert (i.width_px, i.height_px) == (1280, 720)
    expected = () if name == "calib.txt" else (-0.12, 0.03, 1e-4, -2e-4)
    assert i.distortion[:4] == pytest.approx(expected)


def test_a_rig_is_placed_by_one_of_its_cameras(tmp_path: Path) -> None:
    east, west = read(tmp_path, "kalibr.yaml", KALIBR)
    # points of the first camera go to the second by T_cn_cnm1
    point = np.array([4.0, 9.0, 1.0])
    r0, t0 = east.cam_from_world()
    r1, t1 = west.cam_from_world()
    in_first = r0 @ point + t0
    expected = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]) @ in_first + (0.5, 0, 0.1)
    np.testing.assert_allclose(r1 @ point + t1, expected, atol=1e-9)
    assert [c.name for c in (east, west)] == ["east", "west"]


MALFORMED: list[tuple[str, str, str, str]] = [
    # OpenCV, YAML
    ("opencv.yaml", "image_width: 1280\n", "", r"image_width: is missing"),
    ("opencv.yaml", "image_width: 1280", "image_width: 12.5", r"image_width: is '12\.5'; a whole number"),
    ("opencv.yaml", "[ 900., ", "[ ", r"camera_matrix\.data: holds 8 numbers; 9 were expected"),
    ("opencv.yaml", "[ 900.,", "[ .Nan,", r"camera_matrix\.data is '\.Nan'"),
    ("opencv.yaml", "[ 900.,", "[ 9.,", r"camera_matrix: fx is 9, a view of"),
    ("opencv.yaml", "[ 900.,", "[ 9e8,", r"camera_matrix: fx is 9e\+08, a view of"),
    ("opencv.yaml", "645.,", "6450.,", r"camera_matrix: cx is 6450; the image ends at 1280 px"),
    ("opencv.yaml", "   cols: 3\n", "   cols: 4\n", r"camera_matrix\.data: holds 9 numbers; 3 x 4"),
    ("opencv.yaml", "-1.2e-01, ", "", r"distortion_coefficients\.data: holds 4 numbers; 5 x 1"),
    ("opencv.yaml", "tvec:", "tvex:", r"tvec: is missing; rotation and translation come together"),
    ("opencv.yaml", "[ 1, 0, 0,", "[ 1, 0.2, 0,", r"rotation_matrix: R is not orthonormal"),
    ("opencv.yaml", "image_width: 1280\n", "image_width: 1280\nimage_width: 1280\n", r"'image_width' is there twice"),
    ("opencv.yaml", "calibration_time:", "K: 3\ncalibration_time:", r"K: means the same as camera_matrix"),
    # OpenCV, XML
    ("opencv.xml", "<image_height>720</image_height>\n", "", r"image_height: is missing"),
    ("opencv.xml", "<image_width>1280<", "<image_width>0<", r"image_width: is '0'; a whole number"),
    ("opencv.xml", "900. ", "9OO. ", r"camera_matrix\.data is '9OO\.'"),
    ("opencv.xml", "900. ", "", r"camera_matrix\.data: holds 8 numbers"),
    ("opencv.xml", "<rows>3</rows>", "<rows>2</rows>", r"camera_matrix\.data: holds 9 numbers; 2 x 3"),
    ("opencv.xml", "<opencv_storage>", "<storage>opencv_storage", r"the outermost element is <storage>"),
    ("opencv.xml", "</opencv_storage>", "", r"not well-formed XML"),
    ("opencv.xml", RVEC_XML, "", r"rvec: is missing; rotation and translation"),
    ("opencv.xml", "<image_width>", "<image_width>1</image_width><image_width>", r"'image_width' is there twice"),
    ("opencv.xml", '<?xml version="1.0"?>\n', '<!DOCTYPE a [<!ENTITY b "c">]>\n', r"declares the entity 'b'"),
    # ROS
    ("ros.yaml", "image_width: 1280", "image_width: -1", r"image_width: is '-1'"),
    ("ros.yaml", "camera_matrix:", "camera_mtx:", r"camera_matrix: is missing; the fields here are image_width"),
    ("ros.yaml", "[900, 0,", "[900, 3,", r"camera_matrix: K has skew 3"),
    ("ros.yaml", "[900, 0,", "[nine, 0,", r"camera_matrix\.data is 'nine'"),
    ("ros.yaml", "distortion_model: plumb_bob", "distortion_model: fisheye", r"distortion_model: is 'fisheye'"),
    ("ros.yaml", "[-0.12, 0.03, 0.0001, -0.0002, 0]", "[-0.12]", r"coefficients\.data: holds 1 numbers"),
    ("ros.yaml", "image_height: 720", "image_height: 720\nbinning_x: 2", r"binning_x: is 2"),
    ("ros.yaml", "camera_name: east", "camera_name: ''", r"camera_name: is ''; a text"),
    ("ros.yaml", "camera_name: east", "camera_name: [east", r"line \d+:"),
    ("ros.yaml", "camera_name: east", "camera_name: &a east\nother: *a", r"holds an alias"),
    # Kalibr
    ("kalibr.yaml", "cam1:", "cam2:", r"has the fields cam0, cam2; cam0, cam1"),
    ("kalibr.yaml", "camera_model: pinhole", "camera_model: omni", r"cam0\.camera_model: is 'omni'"),
    ("kalibr.yaml", "radtan", "equidistant", r"cam0\.distortion_model: is 'equidistant'"),
    ("kalibr.yaml", "[900.0, 905.0,", "[905.0,", r"cam0\.intrinsics: holds 3 numbers; 4"),
    ("kalibr.yaml", "[900.0,", "[inf,", r"cam0\.intrinsics is 'inf'"),
    ("kalibr.yaml", "[1280, 720]", "[1280]", r"cam0\.resolution: holds 1 numbers"),
    ("kalibr.yaml", "[1280, 720]", "[1280.5, 720]", r"cam0\.resolution: is 1280\.5, 720; whole"),
    ("kalibr.yaml", "  - [1.0, 0.0, 0.0, 0.1]\n", "", r"cam1\.T_cn_cnm1: holds 12 numbers; 16"),
    ("kalibr.yaml", "[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.1, 1.0]", r"cam1\.T_cn_cnm1: its last row"),
    ("kalibr.yaml", "[0.0, 1.0, 0.0, 0.0]", "[0.0, 2.0, 0.0, 0.0]", r"cam1\.T_cn_cnm1: R is not orthonormal"),
    ("kalibr.yaml", "/west/", "/east/", r"cam1\.rostopic: the camera name 'east' is there twice"),
    # KITTI
    ("calib.txt", "P0: ", "P0 ", r"has no name and colon"),
    ("calib.txt", "P1: ", "P0: ", r"line 3: P0 is there twice"),
    ("calib.txt", "P0: ", "P0: 1.0 ", r"line 2: P0 has 13 numbers; 12"),
    ("calib.txt", "P0: ", "P0: x", r"line 2: P0 is 'x"),
    ("calib.txt", KITTI.splitlines()[1], "P0: " + "0 " * 12, r"line 2: P0: its left 3 x 3 part is singular"),
    ("calib.txt", KITTI.splitlines()[1], "P0: 1 0 0 0 0 1 0 0 0 0 1 0", r"P0: fx is 1, a view of"),
    ("calib.txt", KITTI.splitlines()[1], "P0: 900 9 640 0 0 900 360 0 0 0 1 0", r"P0: has skew 9"),
    ("calib.txt", KITTI.splitlines()[1], "P0: -900 0 640 0 0 900 360 0 0 0 1 0", r"P0: its left .* a reflection"),
    ("calib.txt", KITTI.splitlines()[1], "P0: 900 0 9640 0 0 900 360 0 0 0 1 0", r"P0: cx is 9640"),
    ("calib.txt", "P0: ", "P0: 1e999 ", r"line 2: P0 is '1e999'"),
    # COLMAP, lenses
    ("cameras.txt", "OPENCV 1280", "OPENCV_FISHEYE 1280", r"cameras\.txt, line 3: MODEL is 'OPENCV_FISHEYE'"),
    ("cameras.txt", " 1280 ", " wide ", r"line 3: WIDTH is 'wide'"),
    ("cameras.txt", " 720 ", " 720.5 ", r"line 3: HEIGHT is '720\.5'"),
    ("cameras.txt", " 900 ", " ", r"line 3: PARAMS has 7 numbers; OPENCV has 8"),
    ("cameras.txt", " 900 ", " nan ", r"line 3: PARAMS is 'nan'"),
    ("cameras.txt", CAMERAS_TXT.splitlines()[2], "7 OPENCV", r"line 3: 2 values"),
    ("cameras.txt", CAMERAS_TXT.splitlines()[2], "# none", r"cameras\.txt: holds no camera"),
    ("cameras.txt", " 355 ", " 35 ", r"line 3: cy is 35, far from the middle"),
    # COLMAP, poses
    ("images.txt", "3 0.5 ", "3 0.7 ", r"images\.txt, line 5: QW QX QY QZ has length"),
    ("images.txt", " 7 east.jpg", " 8 east.jpg", r"line 5: CAMERA_ID is '8'"),
    ("images.txt", " east.jpg", "", r"line 5: 9 values"),
    ("images.txt", "3 0.5 ", "3 half ", r"line 5: QW is 'half'"),
    ("images.txt", "\n10.5 20.25 -1 30.5 40.5 11\n", "\n\n" + IMAGES_TXT.splitlines()[4] + "\n", r"NAME is 'east"),
    # poses
    ("poses.csv", "pan,", "", r"the columns are .*pan, tilt"),
    ("poses.csv", "90,30,0", "90,30,0,1", r"line 2: 8 fields"),
    ("poses.csv", "90,30,0", "90,91,0", r"line 2: tilt is '91'"),
    ("poses.csv", "90,30,0", "north,30,0", r"line 2: pan is 'north'"),
    ("poses.csv", "east,", "\"\",", r"line 2: name is ''"),
    ("poses.csv", "east,", "west,", r"no camera is called 'west'; there are east"),
    ("poses.csv", "\neast,2,-3,5,90,30,0\n", "\n", r"holds no row below its header"),
    ("poses.csv", POSES, POSES + POSES.splitlines()[1], r"line 3: name is 'east'"),
    ("poses.csv", "2,-3,5", "2,-3,", r"line 2: z is ''"),
    ("poses.csv", ",roll", ",rolll", r"unknown column 'rolll'; did you mean 'roll'"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "message"), MALFORMED)
def test_a_wrong_camera_file_is_named_with_its_field(
    tmp_path: Path, name: str, old: str, new: str, message: str
) -> None:
    text = {**FILES, "cameras.txt": CAMERAS_TXT, "images.txt": IMAGES_TXT}[name]
    assert old in text
    with pytest.raises(DataError, match=message):
        read(tmp_path, name, text.replace(old, new, 1))


def test_units_and_axes_that_cannot_be_are_refused(tmp_path: Path) -> None:
    centimetres = OPENCV_YAML.replace(FLAT_T, ", ".join(f"{100 * v:.9g}" for v in T))
    path = written(tmp_path, "cm.yaml", centimetres)
    with pytest.raises(DataError, match=r"hang 500 m above z = 0: are these centimetres"):
        read_cameras(path)
    np.testing.assert_allclose(read_cameras(path, CameraOptions(unit="cm"))[0].p_world, C, atol=1e-6)
    with pytest.raises(DataError, match=r"unit 'km': one of m, cm, mm"):
        read_cameras(path, CameraOptions(unit="km"))
    opengl = np.diag([1.0, -1.0, -1.0]) @ R
    turned = OPENCV_YAML.replace(FLAT_R, ", ".join(f"{v:.12g}" for v in opengl.ravel()))
    with pytest.raises(DataError, match=r"upside down: are its axes OpenGL's"):
        read_cameras(written(tmp_path, "gl.yaml", turned))
    with pytest.raises(DataError, match=r"look straight up: are the poses in the frame of a camera"):
        read(tmp_path, "calib.txt", "P0: 900 0 640 0 0 900 360 0 0 0 1 0\n")


def test_sizes_formats_and_places_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    krtd = written(tmp_path, "calib.txt", KITTI)
    with pytest.raises(DataError, match=r"a KITTI file does not state the size"):
        read_cameras(krtd)
    yaml = written(tmp_path, "a.yaml", OPENCV_YAML)
    with pytest.raises(DataError, match=r"has images of 1280 x 720 px, not 1920 x 1080"):
        read_cameras(yaml, CameraOptions(image_px=(1920, 1080)))
    with pytest.raises(DataError, match=r"is no camera file that is known here: KRTD"):
        read_cameras(written(tmp_path, "b.yaml", "a: 1\n"))
    with pytest.raises(DataError, match=r"no file matches this pattern"):
        read_cameras(tmp_path / "*.krtd")
    with pytest.raises(DataError, match=r"no such file or folder"):
        read_cameras(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"holds no camera file"):
        read_cameras(tmp_path / "empty")
    with pytest.raises(DataError, match=r"camera 'east' has no pose"):
        read_cameras(written(tmp_path, "ros.yaml", ROS))
    with pytest.raises(DataError, match=r"relative to the camera 'east'"):
        read_cameras(written(tmp_path, "kalibr.yaml", KALIBR))


def projection_error_px(
    cameras: tuple[SurveyedCamera, ...], truth: Path, names: dict[str, str]
) -> tuple[float, int]:
    """Largest distance from OpenCV's projections, and how many were compared; KITTI compares without distortion."""
    plain = {c.name: c for c in read_cameras(truth.parent / "opencv/*.yaml")}
    with truth.open() as file:
        rows = list(csv.DictReader(file))
    worst, count = 0.0, 0
    for camera in cameras:
        name = names.get(camera.name, camera.name)
        mine = [row for row in rows if row["camera"] == name]
        p = np.array([[float(row[f"{a}_m"]) for a in "xyz"] for row in mine])
        uv = np.array([[float(row[f"{a}_px"]) for a in "uv"] for row in mine])
        i = camera.intrinsics
        k = np.array([[i.fx_px, 0, i.cx_px], [0, i.fy_px, i.cy_px], [0, 0, 1]])
        if not i.distortion:
            lens = np.array(plain[name].intrinsics.distortion)
            # to convergence: the default stops after five steps, a tenth of a pixel short
            stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 500, 1e-12)
            uv = cv2.undistortPoints(uv[:, None], k, lens, R=np.eye(3), P=k, criteria=stop)[:, 0]
        r, t = camera.cam_from_world()
        own = cv2.projectPoints(p, cv2.Rodrigues(r)[0], t, k, np.array(i.distortion or [0.0] * 4))[0][:, 0]
        own_pinhole = Pinhole.from_settings(i).project(p @ r.T + t)
        worst = max(worst, float(np.abs(own - uv).max()), float(np.abs(own_pinhole - uv).max()))
        count += len(mine)
    return worst, count


@pytest.mark.parametrize(
    ("path", "given"),
    [
        ("krtd", {"image_px": (1920, 1080)}),
        ("opencv/*.yaml", {}),
        ("opencv/*.xml", {}),
        ("colmap", {}),
        ("ros", {"poses": "colmap"}),
        ("kalibr_camchain.yaml", {"poses": "opencv/gate.yaml"}),
        ("kitti/calib.txt", {"image_px": (1920, 1080)}),
    ],
)
def test_every_format_projects_as_opencv_does(shared_data: Path, path: str, given: dict) -> None:
    folder = shared_data / "camera_formats"
    if "poses" in given:
        given = {**given, "poses": folder / given["poses"]}
    cameras = read_cameras(folder / path, CameraOptions(**given))
    names = {"P0": "gate", "P1": "yard", "P2": "roof"}
    worst, count = projection_error_px(cameras, folder / "truth.csv", names)
    assert count == 102
    assert worst < 0.01
    centres = {names.get(c.name, c.name): c.p_world for c in cameras}
    for name, centre in {"gate": (-12, 3, 6), "yard": (9, -14, 8), "roof": (4, 11, 12)}.items():
        np.testing.assert_allclose(centres[name], centre, atol=1e-5)

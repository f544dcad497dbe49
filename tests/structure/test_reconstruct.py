"""`camnet structure`: real photographs of a board, a rendered corridor, wrong order, files that other programs read."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from camnet.cli.main import main
from camnet.errors import DataError
from camnet.estimation.structure.bundle.problem import Observations
from camnet.estimation.structure.geometry import unit
from camnet.estimation.structure.triangulate import meeting_point, start_points
from camnet.geometry import rotations as rot
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import Intrinsics
from camnet.importers.opencv_camera import read_opencv_intrinsics
from camnet.importers.poses import read_tum
from camnet.report.structure_files import write_kitti, write_tum
from camnet.sensing.textured_planes import TexturedPlane, draw_planes

SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "data"
BOARD = SHARED / "chessboard"
needs_photographs = pytest.mark.skipif(not BOARD.is_dir(), reason=f"no photographs in {BOARD}")


def wrong_odometry(p, q, rng, scale=1.05, share=0.1, turn=0.01):
    """Poses that are ``scale`` too long, with ``share`` of noise a step."""
    at, turned = [p[0]], [q[0]]
    for i in range(len(p) - 1):
        step = rot.to_matrix(q[i]).T @ (p[i + 1] - p[i])
        step = scale * (step + share * np.linalg.norm(step) * rng.standard_normal(3) / np.sqrt(3.0))
        at.append(at[-1] + rot.rotate(turned[-1], step))
        dq = rot.multiply(rot.multiply(rot.conjugate(q[i]), q[i + 1]), rot.exp(turn * rng.standard_normal(3)))
        turned.append(rot.multiply(turned[-1], dq))
    return np.array(at), np.array(turned)


def similarity_error(found, truth):
    """Root mean square distance after the best similarity, and its scale (Umeyama)."""
    a, b = found - found.mean(axis=0), truth - truth.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    d = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = np.trace(np.diag(s) @ d) / np.sum(a * a)
    return np.sqrt(np.mean(np.sum((scale * a @ (u @ d @ vt).T - b) ** 2, axis=1))), scale


@pytest.fixture(scope="module")
def photographs():
    """Poses of the camera relative to the board by PnP (OpenCV's calibration), squares of 25 mm."""
    plane = np.zeros((54, 3), np.float32)
    plane[:, :2] = 0.025 * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
    files = sorted(BOARD.glob("*.jpg"))
    found = [cv2.findChessboardCornersSB(cv2.imread(str(f), cv2.IMREAD_GRAYSCALE), (9, 6)) for f in files]
    corners = [c.reshape(-1, 2).astype(np.float32) for ok, c in found if ok]
    _, _, _, turns, shifts = cv2.calibrateCamera([plane] * len(corners), corners, (640, 480), None, None)
    p, q = np.full((len(files), 3), np.nan), np.full((len(files), 4), np.nan)
    r = np.array([cv2.Rodrigues(x)[0] for x in turns])
    where = [k for k, (ok, _) in enumerate(found) if ok]
    p[where] = -np.einsum("kba,kb->ka", r, np.array(shifts)[..., 0])
    q[where] = rot.from_matrix(np.swapaxes(r, 1, 2))
    return files, where, p, q


def copied(files, folder, order):
    folder.mkdir()
    for k, i in enumerate(order):
        shutil.copy(files[i], folder / f"view_{k:02d}.jpg")
    return folder


@needs_photographs
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_board_photographs_with_wrong_odometry(photographs, tmp_path, capsys, seed):
    files, where, p, q = photographs
    p, q = p[where], q[where]
    at, turned = wrong_odometry(p, q, np.random.default_rng(seed))
    write_tum(tmp_path / "odometry.txt", np.arange(float(len(at))), at, turned)
    folder = copied(files, tmp_path / "views", where)
    words = ["structure", str(folder), "--board", "9x6", "--odometry", str(tmp_path / "odometry.txt")]
    assert main([*words, "--scale-sd", "0.05", "--out", str(tmp_path / "out"), "--json", "--quiet"]) == 0
    result = json.loads(capsys.readouterr().out)
    _, path, _ = read_tum(tmp_path / "out" / "path_tum.txt")
    error, scale = similarity_error(path, p)
    assert error <= 0.3 * similarity_error(at, p)[0]
    low, high = result["scale"]["true_over_found_ci95"]
    assert low <= scale <= high
    assert high - low < 0.3
    assert result["consistent"]


def masks_of_boards(files, folder):
    """Write a mask an image: the board's outline, with half a square around it."""
    folder.mkdir()
    for k, file in enumerate(files):
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        _, corners = cv2.findChessboardCornersSB(grey, (9, 6))
        mask = np.zeros_like(grey)
        cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(corners).astype(np.int32)), 255)
        cv2.imwrite(str(folder / f"mask_{k:02d}.png"), cv2.dilate(mask, np.ones((9, 9), np.uint8)))
    return folder


@needs_photographs
def test_masks_for_each_photograph(photographs, tmp_path, capsys):
    files, where, p, q = photographs
    p, q = p[where], q[where]
    at, turned = wrong_odometry(p, q, np.random.default_rng(5))
    write_tum(tmp_path / "odometry.txt", np.arange(float(len(at))), at, turned)
    folder = copied(files, tmp_path / "views", where)
    masks = masks_of_boards(sorted(folder.iterdir()), tmp_path / "masks")
    words = [
        "structure",
        str(folder),
        "--board",
        "9x6",
        "--odometry",
        str(tmp_path / "odometry.txt"),
        "--quiet",
    ]
    assert main([*words, "--mask", str(masks), "--out", str(tmp_path / "out")]) == 0
    _, path, _ = read_tum(tmp_path / "out" / "path_tum.txt")
    assert similarity_error(path, p)[0] <= 0.3 * similarity_error(at, p)[0]
    # a mask that hides the board of one image takes that image out; masks that hide all of them are refused
    hidden = np.zeros((480, 640), np.uint8)
    hidden[:5, :5] = 255
    cv2.imwrite(str(masks / "mask_03.png"), hidden)
    assert main([*words, "--mask", str(masks), "--out", str(tmp_path / "fewer")]) == 0
    result = json.loads((tmp_path / "fewer" / "result.json").read_text())
    assert result["images"] == len(where) - 1
    (masks / "mask_00.png").unlink()
    assert main([*words, "--mask", str(masks), "--out", str(tmp_path / "none")]) == 2
    assert f"{len(where) - 1} masks for {len(where)} images" in capsys.readouterr().err


@needs_photographs
def test_images_of_two_sizes_and_a_single_one_are_refused(photographs, tmp_path, capsys):
    files, where, _, _ = photographs
    folder = copied(files, tmp_path / "views", where[:3])
    words = ["--board", "9x6", "--out", str(tmp_path / "out"), "--quiet"]
    second = folder / "view_01.jpg"
    cv2.imwrite(str(second), cv2.resize(cv2.imread(str(second)), (320, 240)))
    assert main(["structure", str(folder), *words]) == 2
    assert "view_01.jpg: 320 x 240 pixels; the images before have 640 x 480" in capsys.readouterr().err
    one = copied(files, tmp_path / "one", where[:1])
    assert main(["structure", str(one), *words]) == 2
    assert "in 1 images" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@needs_photographs
def test_shuffled_photographs_fail(photographs, tmp_path):
    files, where, p, q = photographs
    write_tum(tmp_path / "odometry.txt", np.arange(float(len(where))), p[where], q[where])
    folder = copied(files, tmp_path / "views", np.random.default_rng(0).permutation(where))
    words = ["structure", str(folder), "--board", "9x6", "--odometry", str(tmp_path / "odometry.txt")]
    assert main([*words, "--out", str(tmp_path / "out"), "--quiet"]) in (1, 2)


@needs_photographs
def test_without_odometry_the_shape_is_right_and_the_size_is_said_to_be_open(photographs, tmp_path, capsys):
    _, where, p, _ = photographs
    assert main(["structure", str(BOARD), "--board", "9x6", "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert "arbitrary" in capsys.readouterr().out
    t, path, _ = read_tum(tmp_path / "out" / "path_tum.txt")
    both = [k for k in where if k in t.astype(int)]
    rows = np.searchsorted(t, both)
    extent = np.sqrt(np.sum((p[both] - p[both].mean(axis=0)) ** 2))
    assert similarity_error(path[rows], p[both])[0] < 0.01 * extent
    assert "comment unit arbitrary" in (tmp_path / "out" / "points.ply").read_text()
    names = {x.name for x in (tmp_path / "out").iterdir()}
    assert {"points.ply", "path_tum.txt", "path_kitti.txt", "structure.mp4", "result.json"} <= names


def corridor(folder, count, rng):
    """Images of a corridor with textured walls and floor, the camera 60 degrees off its way; its true poses."""
    camera = Intrinsics(width_px=480, height_px=360, fx_px=380.0, fy_px=380.0, cx_px=239.5, cy_px=179.5)
    blocks = [np.kron(rng.integers(20, 236, (24, 96)), np.ones((8, 8))).astype(np.uint8) for _ in range(3)]
    along, up = np.array([12.0, 0.0, 0.0]), np.array([0.0, 0.0, -2.4])
    planes = [
        TexturedPlane(np.array([-2.0, 1.5, 2.4]), along, up, blocks[0]),
        TexturedPlane(np.array([-2.0, -0.8, 2.4]), along, up, blocks[1]),
        TexturedPlane(np.array([-2.0, 1.5, 0.0]), along, np.array([0.0, -2.3, 0.0]), blocks[2]),
    ]
    t = np.linspace(0.0, 1.0, count)
    p = np.column_stack([3.0 * t, 0.15 * np.sin(6.0 * t), 0.8 + 0.0 * t])
    from camnet.estimation.structure.camera_path import forward_camera

    q = forward_camera(np.radians(60.0) + 0.1 * np.sin(5.0 * t))
    folder.mkdir()
    for k in range(count):
        image = draw_planes(planes, Pinhole.from_settings(camera), p[k], q[k], samples=2)
        image = np.clip(image + 1.5 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{k:03d}.png"), image)
    storage = cv2.FileStorage(str(folder.parent / "camera.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 480)
    storage.write("image_height", 360)
    storage.write("camera_matrix", Pinhole.from_settings(camera).matrix)
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.release()
    return p, q


def test_rendered_corridor_with_wrong_odometry(tmp_path, capsys):
    rng = np.random.default_rng(4)
    p, q = corridor(tmp_path / "images", 40, rng)
    at, turned = wrong_odometry(p, q, rng)
    write_tum(tmp_path / "odometry.txt", np.arange(40.0), at, turned)
    words = ["structure", str(tmp_path / "images"), "--camera", str(tmp_path / "camera.yaml")]
    words += [
        "--odometry",
        str(tmp_path / "odometry.txt"),
        "--scale-sd",
        "0.05",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*words, "--json", "--quiet"]) == 0
    result = json.loads(capsys.readouterr().out)
    t, path, _ = read_tum(tmp_path / "out" / "path_tum.txt")
    k = np.rint(t).astype(int)
    error, scale = similarity_error(path, p[k])
    assert len(k) >= 8
    assert error <= 0.5 * similarity_error(at[k], p[k])[0]
    low, high = result["scale"]["true_over_found_ci95"]
    assert low <= scale <= high


def test_shuffled_images_of_the_corridor_fail(tmp_path, capsys):
    rng = np.random.default_rng(4)
    p, q = corridor(tmp_path / "images", 24, rng)
    write_tum(tmp_path / "odometry.txt", np.arange(24.0), p, q)
    files = sorted((tmp_path / "images").iterdir())
    shuffled = tmp_path / "shuffled"
    shuffled.mkdir()
    for k, i in enumerate(rng.permutation(24)):
        shutil.copy(files[i], shuffled / f"{k:03d}.png")
    words = [
        "--camera",
        str(tmp_path / "camera.yaml"),
        "--odometry",
        str(tmp_path / "odometry.txt"),
        "--quiet",
    ]
    assert main(["structure", str(tmp_path / "images"), *words, "--out", str(tmp_path / "right")]) == 0
    assert main(["structure", str(shuffled), *words, "--out", str(tmp_path / "wrong")]) == 1
    assert "NOT CONSISTENT" in capsys.readouterr().out
    result = json.loads((tmp_path / "wrong" / "result.json").read_text())
    assert result["scale"] is None
    assert not result["consistent"]


def test_rays_meet_where_the_point_is():
    rng = np.random.default_rng(0)
    p, x = rng.normal(size=(4, 3)), np.array([0.3, -0.2, 5.0])
    np.testing.assert_allclose(meeting_point(p, unit(x - p)[0]), x, atol=1e-10)
    assert meeting_point(p[:2], np.array([[0, 0, 1.0], [0, 0, 1.0]])) is None
    seen = Observations(np.array([0, 1]), np.array([0, 0]), (x[:2] - [[0, 0], [1, 0]]) / 5.0, np.ones(2))
    anchor, start = start_points(seen, 1, np.array([[0, 0, 0.0], [1, 0, 0]]), np.tile(rot.IDENTITY, (2, 1)))
    assert anchor[0] == 0
    np.testing.assert_allclose(start[0], [x[0] / 5.0, x[1] / 5.0, 0.2], atol=1e-10)


def test_paths_come_back_from_their_files_and_open_in_evo(tmp_path):
    rng = np.random.default_rng(1)
    t, p, q = np.arange(5.0), rng.normal(size=(5, 3)), rot.exp(rng.normal(size=(5, 3)))
    write_tum(tmp_path / "tum.txt", t, p, q)
    write_kitti(tmp_path / "kitti.txt", p, q)
    t2, p2, q2 = read_tum(tmp_path / "tum.txt")
    np.testing.assert_allclose(p2, p, atol=1e-7)
    assert rot.angle_between(q2, q).max() < 1e-7
    assert np.array_equal(t2, t)
    rows = np.loadtxt(tmp_path / "kitti.txt").reshape(5, 3, 4)
    np.testing.assert_allclose(rows[:, :, :3], rot.to_matrix(q), atol=1e-10)
    evo = pytest.importorskip("evo.tools.file_interface", reason="evo is not installed")
    as_tum = evo.read_tum_trajectory_file(tmp_path / "tum.txt")
    as_kitti = evo.read_kitti_poses_file(tmp_path / "kitti.txt")
    np.testing.assert_allclose(as_tum.positions_xyz, p, atol=1e-7)
    np.testing.assert_allclose(as_kitti.positions_xyz, p, atol=1e-9)
    np.testing.assert_allclose(np.abs(np.sum(as_tum.orientations_quat_wxyz * q, axis=1)), 1.0, atol=1e-9)
    assert as_tum.check()[0]
    assert as_kitti.check()[0]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1 2 3", "3 values"),
        ("0 0 0 0 0 0 0 2", "length 2"),
        ("0 0 x 0 0 0 0 1", "y is 'x'"),
        ("# nothing", "holds no pose"),
        ("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1", "line 2: time 0 is not after 0"),
    ],
)
def test_malformed_odometry_is_refused(tmp_path, line, words):
    (tmp_path / "o.txt").write_text(line + "\n")
    with pytest.raises(DataError, match=words):
        read_tum(tmp_path / "o.txt")


def test_cameras_of_opencv_are_read_and_others_refused(tmp_path):
    file = SHARED / "camera_formats" / "opencv" / "gate.yaml"
    if not file.is_file():
        pytest.skip(f"no camera files in {file.parent}")
    camera = read_opencv_intrinsics(file)
    assert (camera.fx_px, camera.cx_px, camera.width_px) == (1180.0, 955.0, 1920)
    assert read_opencv_intrinsics(file.with_suffix(".xml")) == camera
    (tmp_path / "c.yaml").write_text("%YAML:1.0\n---\nimage_width: 3\n")
    with pytest.raises(DataError, match="camera_matrix"):
        read_opencv_intrinsics(tmp_path / "c.yaml")
    with pytest.raises(DataError, match="no such file"):
        read_opencv_intrinsics(tmp_path / "d.yaml")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--camera"),
        (["--board", "9by6"], "--board '9by6'"),
        (["--board", "9x6", "--mask", "m.png"], "m.png"),
        (["--odometry", "none.txt", "--board", "9x6"], "none.txt"),
    ],
)
@needs_photographs
def test_bad_words_are_refused(tmp_path, capsys, options, words):
    assert main(["structure", str(BOARD), *options, "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert words in capsys.readouterr().err

"""A folder with everything that the examples of README and ``--help`` name: worlds, a small city, people, cameras."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import IDENTITY, exp, multiply
from camnet.geometry.settings import Intrinsics
from camnet.sensing.textured_planes import TexturedPlane, checkerboard, draw_planes

ROOT = Path(__file__).resolve().parents[2]

#: a triangle of streets with a spur; both directions of each
_STREETS = ("ab", "bc", "ca", "bd")
_PLACES = {"a": (0, 0), "b": (300, 0), "c": (300, 300), "d": (600, 0)}

#: 640 px wide, 4 m above the ground, tilted down by 30 degrees towards +y
_CAMERA = """800 0 {cx}
0 800 540
0 0 1

1 0 0
0 -0.5 -0.8660254037844386
0 0.8660254037844386 -0.5

{tx} 3.4641016151377544 2.0

0 0 0 0
"""


def _network(path: Path) -> None:
    edges, links = [], []
    names = [*_STREETS, *(name[::-1] for name in _STREETS)]
    for name in names:
        (x0, y0), (x1, y1) = _PLACES[name[0]], _PLACES[name[1]]
        lane = f'<lane id="{name}_0" index="0" speed="14" length="300" shape="{x0},{y0} {x1},{y1}"/>'
        edges.append(f'<edge id="{name}" from="{name[0]}" to="{name[1]}" priority="1">{lane}</edge>')
        for other in names:
            if name[1] == other[0] and (other != name[::-1] or name == "bd"):
                links.append(
                    f'<connection from="{name}" to="{other}" fromLane="0" toLane="0" dir="s" state="M"/>'
                )
    junctions = [
        f'<junction id="{k}" type="priority" x="{x}" y="{y}" incLanes="" intLanes="" shape="{x},{y}"/>'
        for k, (x, y) in _PLACES.items()
    ]
    path.write_text(f'<net version="1.16">{"".join(edges)}{"".join(junctions)}{"".join(links)}</net>')


def _people(path: Path) -> None:
    """Four people who walk up and down before the cameras, a fix a second."""
    rows = ["id,t_s,x_m,y_m"]
    for person in range(4):
        for t in range(120):
            y = 5.0 + 20.0 * abs((t + 30 * person) % 60 - 30) / 30.0
            rows.append(f"p{person},{t},{3.0 * person:.2f},{y:.3f}")
    path.write_text("\n".join(rows) + "\n")


def _observed(folder: Path) -> None:
    """A target that three stations see, once with noise stated and once without."""
    rng = np.random.default_rng(1)
    rows, fixes = ["t,observer,x,y,sd"], ["t,x,y"]
    for t in range(40):
        for name in "abc":
            x, y = np.array([1.2 * t, 10.0]) + rng.normal(0.0, 1.0, 2)
            rows.append(f"{t},{name},{x:.3f},{y:.3f},1")
        fixes.append(f"{t},{x:.3f},{y:.3f}")
    (folder / "observations.csv").write_text("\n".join(rows) + "\n")
    (folder / "fixes.csv").write_text("\n".join(fixes) + "\n")


def _areas(path: Path) -> None:
    """A yard of some 20 m before the cameras, about the origin of the example."""
    west, south, east, north = -85.5301, 39.05005, -85.5299, 39.0502
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    yard = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {"name": "yard"}, "geometry": yard}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))


def _video(path: Path) -> None:
    """A textured box that moves to the right over a textured ground."""
    rng = np.random.default_rng(0)
    ground = rng.integers(90, 130, (400, 320, 3)).astype(np.uint8)
    thing = rng.integers(0, 255, (290, 87, 3)).astype(np.uint8)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (320, 400))
    for k in range(8):
        picture = ground.copy()
        picture[53 : 53 + 290, 51 + 2 * k : 51 + 2 * k + 87] = thing
        writer.write(picture)
    writer.release()


def _sequence(folder: Path, video: Path) -> None:
    (folder / "img").mkdir(parents=True)
    film, boxes = cv2.VideoCapture(str(video)), []
    for k in range(8):
        good, picture = film.read()
        assert good
        cv2.imwrite(str(folder / "img" / f"{k + 1:04d}.jpg"), picture)
        boxes.append(f"{51 + 2 * k},53,87,290")
    (folder / "groundtruth_rect.txt").write_text("\n".join(boxes) + "\n")


def _moving_camera(folder: Path) -> None:
    """Photographs of a board, and a film along a textured wall with its camera file and odometry."""
    camera = Intrinsics(width_px=320, height_px=240, fx_px=280.0, fy_px=280.0, cx_px=159.5, cy_px=119.5)
    lens = Pinhole.from_settings(camera)
    (folder / "PHOTOGRAPHS").mkdir()
    board = TexturedPlane(
        np.array([-0.3, -0.225, 0.0]),
        np.array([0.6, 0, 0]),
        np.array([0, 0.45, 0]),
        checkerboard(10, 7, 20, 20),
    )
    for k in range(6):
        angle = 0.15 + 0.9 * k
        p = np.array([0.35 * np.cos(angle), 0.35 * np.sin(angle), -0.75])
        q = multiply(exp(np.array([0.42 * np.sin(angle), -0.42 * np.cos(angle), 0.0])), IDENTITY)
        picture = draw_planes([board], lens, p, q)
        cv2.imwrite(str(folder / "PHOTOGRAPHS" / f"{k}.png"), picture.astype(np.uint8))
    rng = np.random.default_rng(1)
    blocks = np.kron(rng.integers(20, 236, (30, 60)), np.ones((8, 8))).astype(np.uint8)
    near = TexturedPlane(np.array([-3.0, -2, 3]), np.array([4.0, 0, 0]), np.array([0, 4.0, 0]), blocks)
    far = TexturedPlane(
        np.array([-3.0, -2, 4]), np.array([8.0, 0, 0]), np.array([0, 4.0, 0]), blocks[::-1].copy()
    )
    writer = cv2.VideoWriter(str(folder / "drive.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (320, 240))
    lines = []
    for k in range(30):
        picture = draw_planes([near, far], lens, np.array([0.04 * k, 0.0, 0.0]), IDENTITY).astype(np.uint8)
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        lines.append(f"{k / 25.0:.6f} {0.0404 * k:.6f} 0 0 0 0 0 1")
    writer.release()
    (folder / "wheels.txt").write_text("\n".join(lines) + "\n")
    storage = cv2.FileStorage(str(folder / "camera.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 320)
    storage.write("image_height", 240)
    storage.write("camera_matrix", lens.matrix)
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.release()


@pytest.fixture(scope="session")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The inputs under the names that the examples use."""
    folder = tmp_path_factory.mktemp("examples")
    world = ROOT / "worlds" / "quickstart" / "world.yaml"
    shutil.copytree(ROOT / "configs", folder / "configs")
    for name in ("worlds/quickstart", "CONFIG", "WORLD"):
        (folder / name).mkdir(parents=True)
        shutil.copy(world, folder / name / "world.yaml")
    shutil.copy(world, folder / "my_world.yaml")
    for name in ("city.net.xml", "NET", "NET.xml"):
        _network(folder / name)
    for name in ("POLES.csv", "CAMERAS.csv"):
        (folder / name).write_text("name,x,y\na,0,0\nb,300,0\nc,300,300\nd,600,0\nm,150,0\n")
    shutil.copy(ROOT / "tests" / "certification" / "data" / "depot.yaml", folder)
    _people(folder / "people.csv")
    _observed(folder)
    _areas(folder / "AREAS.geojson")
    (folder / "DIR_OF_KRTD").mkdir()
    for k, name in enumerate(("gate", "yard")):
        (folder / "DIR_OF_KRTD" / f"{name}.krtd").write_text(_CAMERA.format(cx=960, tx=-4.0 * k))
    _video(folder / "walking.mp4")
    for name in ("SEQUENCE", "SEQUENCE_FOLDER"):
        _sequence(folder / name, folder / "walking.mp4")
    _moving_camera(folder)
    return folder

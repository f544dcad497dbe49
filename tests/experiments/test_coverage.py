"""Coverage: places against PyBullet's rays, surveyed cameras against OpenCV's projection, GeoJSON, areas, classes.

Rays and projections are computed here from the files' own numbers; nothing of the program takes part in them.
"""

from __future__ import annotations

import csv
import gzip
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pybullet
import pymap3d
import pytest
import shapely
import yaml
from shapely.geometry import shape

from camnet.certification.coverage import Coverage
from camnet.certification.ground_cover import Grid, lengths_by_cameras
from camnet.cli.main import main
from camnet.errors import DataError
from camnet.importers.geodesy import Origin
from camnet.importers.geojson_areas import read_areas

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
DEPOT, MEVA = SHARED / "regressions" / "depot.yaml", SHARED / "meva"
needs_depot = pytest.mark.skipif(not DEPOT.exists(), reason="needs ../shared/data/regressions")
needs_meva = pytest.mark.skipif(not MEVA.exists(), reason="needs ../shared/data/meva")
ORIGIN = (39.04977294, -85.52924953, 205.0)
ORIGIN_WORDS = ",".join(map(str, ORIGIN))


def _coverage(words: list[str], out: Path) -> dict[str, Any]:
    assert main(["coverage", *words, "--out", str(out), "--quiet"]) == 0
    content: dict[str, Any] = json.loads((out / "coverage.json").read_text())
    return content


# --- a world against rays


def _ray_counts(world: dict[str, Any], places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how many cameras see each place (n, 3), and the pixels per metre of the best, by PyBullet's rays."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        for occluder in world["occluders"]:
            low, high = (np.array(occluder["shape"][k], dtype=float) for k in ("min_m", "max_m"))
            box = pybullet.createCollisionShape(
                pybullet.GEOM_BOX, halfExtents=(high - low) / 2, physicsClientId=client
            )
            pybullet.createMultiBody(0, box, basePosition=(low + high) / 2, physicsClientId=client)
        lens = {c["name"]: c for c in world["cameras"]}
        counts, best = np.zeros(len(places), dtype=int), np.zeros(len(places))
        for camera in world["fixed_cameras"]:
            c = lens[camera["camera"]]
            k = c["intrinsics"]
            eye, goal = (np.array(camera["pose"][key], dtype=float) for key in ("position_m", "look_at_m"))
            ahead = (goal - eye) / np.linalg.norm(goal - eye)
            right = np.cross(ahead, [0.0, 0.0, 1.0])
            right /= np.linalg.norm(right)
            x, y, z = np.stack([right, np.cross(ahead, right), ahead]) @ (places - eye).T
            with np.errstate(divide="ignore", invalid="ignore"):
                u, v = k["fx_px"] * x / z + k["cx_px"], k["fy_px"] * y / z + k["cy_px"]
            inside = (z >= c["near_m"]) & (z <= c["far_m"])
            inside &= (u >= 0) & (u <= k["width_px"]) & (v >= 0) & (v <= k["height_px"])
            at = np.flatnonzero(inside)
            clear = _clear(client, eye, places[at])
            counts[at[clear]] += 1
            best[at[clear]] = np.maximum(best[at[clear]], min(k["fx_px"], k["fy_px"]) / z[at[clear]])
        return counts, best
    finally:
        pybullet.disconnect(client)


def _clear(client: int, eye: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return which rays from an eye to places nothing stops."""
    free: list[bool] = []
    for k in range(0, len(places), 10_000):
        ends = places[k : k + 10_000]
        rays = pybullet.rayTestBatch([eye.tolist()] * len(ends), ends.tolist(), physicsClientId=client)
        free += [ray[0] < 0 for ray in rays]
    return np.array(free, dtype=bool)


def _against_rays(tmp_path: Path, step: str, note: Callable[[str, object], None]) -> None:
    found = _coverage([str(DEPOT), "--resolution", step], tmp_path / "out")
    with np.load(tmp_path / "out" / "places.npz") as file:
        x, y, ground, cameras, pixels = (file[k] for k in ("x_m", "y_m", "ground", "cameras", "px_per_m"))
    gx, gy = np.meshgrid(x, y)
    world = yaml.safe_load(DEPOT.read_text())
    buildings = np.zeros(gx.shape, dtype=bool)
    on_border = np.zeros(gx.shape, dtype=bool)
    for occluder in world["occluders"]:
        low, high = occluder["shape"]["min_m"], occluder["shape"]["max_m"]
        away = np.maximum(np.maximum(low[0] - gx, gx - high[0]), np.maximum(low[1] - gy, gy - high[1]))
        buildings |= away <= 0.0
        on_border |= np.abs(away) < 1e-6
    assert (ground == ~buildings)[~on_border].all()
    assert on_border.mean() < 0.01
    places = np.c_[gx[ground], gy[ground], np.zeros(int(ground.sum()))]
    counts, best = _ray_counts(world, places)
    apart, seen = float((counts != cameras[ground]).mean()), float((counts > 0).mean())
    share = found["ground"]["seen_share"]
    note("places", len(places))
    note("differ", apart)
    note("seen_by_rays", seen)
    note("seen_by_coverage", share)
    assert 0.3 < seen < 0.95
    assert apart <= 0.01
    assert abs(seen - share) <= 0.005
    for row in found["ground"]["by_cameras"]:
        assert row["share"] == pytest.approx(float((counts == row["cameras"]).mean()), abs=0.005)
    same = counts == cameras[ground]
    np.testing.assert_allclose(pixels[ground][same], best[same], rtol=1e-5)
    for row in found["classes"]:
        assert row["ground_share"] == pytest.approx(float((best >= row["px_per_m"]).mean()), abs=0.005)


@needs_depot
def test_places_against_rays(tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    _against_rays(tmp_path, "0.5", record_property)


@needs_depot
@pytest.mark.slow
def test_places_against_rays_every_decimetre(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    _against_rays(tmp_path, "0.1", record_property)


@needs_depot
def test_road_and_outlines_against_rays(tmp_path: Path) -> None:
    found = _coverage([str(DEPOT), "--resolution", "1", "--origin", "50,8,100"], tmp_path / "out")
    world = yaml.safe_load(DEPOT.read_text())
    corners = np.array([*world["roads"][0]["points_m"], world["roads"][0]["points_m"][0]], dtype=float)
    s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    at = np.arange(0.025, s[-1], 0.05)
    line = np.c_[np.interp(at, s, corners[:, 0]), np.interp(at, s, corners[:, 1]), np.zeros(len(at))]
    counts, _ = _ray_counts(world, line)
    middle = float((counts > 0).mean())
    # the whole width (0.6 m) must be seen: a little less than of the centre line
    assert middle - 0.02 <= found["roads"]["seen_share"] <= middle + 1e-3
    # outlines: random places, none of them within 1 cm of a border
    rng = np.random.default_rng(1)
    places = np.c_[rng.uniform([-36, -26], [36, 26], (4000, 2)), np.zeros(4000)]
    outside = ~((np.abs(places[:, 0]) <= 20) & (np.abs(places[:, 1]) <= 10))
    outside &= ~((np.abs(places[:, 0] - 10) <= 6) & (np.abs(places[:, 1] + 14) <= 0.2))
    places = places[outside]
    counts, _ = _ray_counts(world, places)
    blind = [f for f in _features(tmp_path / "out") if f["properties"]["kind"] == "blind spot"]
    area = shapely.union_all([_metres(shape(f["geometry"]), (50.0, 8.0, 100.0)) for f in blind])
    points = shapely.points(places[:, :2])
    clear_of = shapely.distance(area.boundary, points) > 0.01
    assert clear_of.mean() > 0.95
    np.testing.assert_array_equal(shapely.contains(area, points)[clear_of], (counts == 0)[clear_of])


# --- surveyed cameras against OpenCV


def _features(out: Path) -> list[dict[str, Any]]:
    content = json.loads((out / "coverage.geojson").read_text())
    assert content["type"] == "FeatureCollection"
    assert "crs" not in content
    features: list[dict[str, Any]] = content["features"]
    return features


def _metres(geometry: shapely.Geometry, origin: tuple[float, float, float]) -> shapely.Geometry:
    def enu(lon_lat: np.ndarray) -> np.ndarray:
        altitude = np.full(len(lon_lat), origin[2])
        east, north, _ = pymap3d.geodetic2enu(lon_lat[:, 1], lon_lat[:, 0], altitude, *origin)
        return np.c_[east, north]

    return shapely.transform(geometry, enu)


def _krtd(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    numbers = np.array(path.read_text().split(), dtype=float)
    distortion = np.zeros(5)
    distortion[: len(numbers[21:26])] = numbers[21:26]
    return numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3), numbers[18:21], distortion


def _directly_seen(path: Path, places: np.ndarray, range_m: float) -> np.ndarray:
    """Whether places (n, 3) are in the image and the range; beyond the fold of the lens model there is no image."""
    k, r, t, d = _krtd(path)
    pixels, _ = cv2.projectPoints(places[:, None], cv2.Rodrigues(r)[0], t, k, d)
    x, y, z = r @ places.T + t[:, None]
    u, v = pixels[:, 0].T
    seen = (z >= 1.0) & (z <= range_m) & (u >= 0) & (u <= 1920) & (v >= 0) & (v <= 1080)
    off = np.linspace(0.0, 5.0, 50_001)
    assert d[2] == d[3] == 0.0  # radial only
    rate = 1.0 + 3.0 * d[0] * off**2 + 5.0 * d[1] * off**4 + 7.0 * d[4] * off**6
    fold = off[np.flatnonzero(rate <= 0.0)[0]] if (rate <= 0.0).any() else np.inf
    return np.asarray(seen & (np.hypot(x, y) < fold * np.where(z > 0.0, z, 1.0)))


@needs_meva
def test_surveyed_cameras_against_direct_projection(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    words = ["--cameras", str(MEVA / "cameras"), "--origin", ORIGIN_WORDS, "--resolution", "2"]
    _coverage(words, tmp_path / "out")
    features = _features(tmp_path / "out")
    with gzip.open(MEVA / "tracks.csv.gz", "rt") as file:
        rows = np.array([row[-2:] for row in list(csv.reader(file))[1:]], dtype=float)
    east, north, _ = pymap3d.geodetic2enu(rows[:, 0], rows[:, 1], np.full(len(rows), ORIGIN[2]), *ORIGIN)
    fixes = np.c_[east, north, np.zeros(len(east))]
    points = shapely.points(fixes[:, :2])
    checked = inside = 0
    for path in sorted((MEVA / "cameras").glob("*.krtd")):
        of = {f["properties"]["kind"]: f for f in features if f["properties"].get("name") == path.stem}
        _, r, t, _ = _krtd(path)
        lon, lat, alt = of["camera"]["geometry"]["coordinates"]
        place = np.array(pymap3d.geodetic2enu(lat, lon, alt, *ORIGIN))
        assert np.linalg.norm(place + r.T @ t) < 0.01
        view = _metres(shape(of["view"]["geometry"]), ORIGIN)
        direct = _directly_seen(path, fixes, 80.0)
        far = shapely.distance(view.boundary, points) >= 5.0
        np.testing.assert_array_equal(shapely.contains(view, points)[far], direct[far], err_msg=path.stem)
        checked, inside = checked + int(far.sum()), inside + int(direct[far].sum())
    record_property("checked", checked)
    record_property("in_view", inside)
    assert inside > 10_000


@needs_meva
def test_geojson_is_that_of_rfc_7946(tmp_path: Path) -> None:
    words = ["--cameras", str(MEVA / "cameras"), "--origin", ORIGIN_WORDS, "--resolution", "5"]
    found = _coverage(words, tmp_path / "out")
    features = _features(tmp_path / "out")
    kinds = [f["properties"]["kind"] for f in features]
    assert kinds.count("camera") == kinds.count("view") == found["cameras"] == 14
    assert kinds.count("blind spot") == found["blind_spots_count"]
    assert kinds.count("class") == 5
    rings = 0
    for feature in features:
        assert feature["type"] == "Feature"
        geometry = feature["geometry"]
        if feature["properties"]["kind"] == "camera":
            assert geometry["type"] == "Point"
            continue
        assert shape(geometry).is_valid
        for polygon in _polygons_of(geometry):
            for k, ring in enumerate(polygon):
                corners = np.array(ring)
                assert len(corners) >= 4
                assert (corners[0] == corners[-1]).all()
                assert (np.abs(corners - [ORIGIN[1], ORIGIN[0]]) < 0.01).all()  # longitude first
                x, y = (corners - corners[0]).T
                turn = float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
                assert turn > 0.0 if k == 0 else turn < 0.0  # outer ones counter-clockwise, holes clockwise
                rings += 1
    assert rings > 30


def _polygons_of(geometry: dict[str, Any]) -> Iterator[list[Any]]:
    if geometry["type"] == "Polygon":
        yield geometry["coordinates"]
    else:
        assert geometry["type"] == "MultiPolygon"
        yield from geometry["coordinates"]


# --- classes, areas, options


@needs_depot
def test_a_class_ends_the_views_where_its_pixels_end(tmp_path: Path) -> None:
    whole = _coverage([str(DEPOT), "--resolution", "0.5"], tmp_path / "a")
    asked = _coverage([str(DEPOT), "--resolution", "0.5", "--class", "recognise"], tmp_path / "b")
    row = {c["class"]: c for c in whole["classes"]}["recognise"]
    assert 0.0 < asked["ground"]["seen_share"] < whole["ground"]["seen_share"]
    assert asked["ground"]["seen_share"] == pytest.approx(row["ground_share"], abs=1e-12)
    assert asked["roads"]["seen_share"] == pytest.approx(row["road_share"], abs=1e-12)
    for camera in asked["camera_list"]:
        assert camera["px_per_m"][0] == pytest.approx(125.0)


@needs_depot
def test_areas_in_metres_and_in_degrees_are_the_same(tmp_path: Path) -> None:
    corners = np.array([[-36.0, -26.0], [36.0, -26.0], [36.0, -16.0], [-36.0, -16.0], [-36.0, -26.0]])
    lat, lon, _ = pymap3d.enu2geodetic(corners[:, 0], corners[:, 1], 0.0 * corners[:, 0], 50.0, 8.0, 100.0)
    results = []
    for name, ring, more in (
        ("metres", corners, []),
        ("degrees", np.c_[lon, lat], ["--origin", "50,8,100"]),
    ):
        feature = {
            "type": "Feature",
            "properties": {"name": "south"},
            "geometry": {"type": "Polygon", "coordinates": [ring.tolist()]},
        }
        path = tmp_path / f"{name}.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        words = [str(DEPOT), "--resolution", "0.25", "--area", str(path), *more]
        results.append(_coverage(words, tmp_path / name))
    for found in results:
        assert found["areas"][0]["name"] == "south"
        assert found["areas"][0]["m2"] == pytest.approx(720.0, rel=1e-2)
        assert found["areas"][0]["seen_share"] == found["ground"]["seen_share"]
    assert results[0]["ground"]["seen_share"] == pytest.approx(results[1]["ground"]["seen_share"], abs=5e-3)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "no JSON"),
        ("[]", "no 'type'"),
        ('{"type": "FeatureCollection", "features": []}', "no area"),
        ('{"type": "Point", "coordinates": [8, 50]}', "'Point' has no area"),
        ('{"type": "Polygon", "coordinates": [[[8, 50], [8.01, 50.01], [8.01, 50], [8, 50.01], [8, 50]]]}', "no area"),
        ('{"type": "Polygon", "coordinates": [[[50, 8], [50.1, 8], [50, 8.1], [50, 8]]]}', "longitude, then latitude"),
        ('{"type": "Polygon", "coordinates": "here"}', "no rings"),
        ('{"type": "Polygon"}', "no rings"),
    ],
)  # fmt: skip
def test_areas_that_are_none(content: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "area.geojson"
    path.write_text(content)
    with pytest.raises(DataError, match=said):
        read_areas(path, Origin(50.0, 8.0, 0.0))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("coverage", "nothing to count"),
        ("coverage quickstart", "has none"),
        ("coverage stationary_certified --cameras x", "not both"),
        ("coverage stationary_certified --range 30", "--range 30"),
        ("coverage --cameras x --range 30 --class detect", "give one"),
        ("coverage stationary_certified --resolution 0.0001", "--resolution"),
        ("coverage --cameras x --seed 3", "--seed 3"),
        ("coverage stationary_certified --class see", "unknown"),
        ("coverage --roads x", "--cameras"),
        ("certify --cameras x --range 30 --class detect", "give one"),
        ("certify --roads x --cameras y --class detect", "--class detect"),
        ("design --tracks x --class detect", "--class detect"),
    ],
)
def test_bad_input_is_named(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words.split()) == 2
    assert said in capsys.readouterr().err


@needs_depot
def test_certify_takes_a_class_in_place_of_a_range(capsys: pytest.CaptureFixture[str]) -> None:
    longest = []
    for more in ([], ["--class", "observe"], ["--class", "recognise"]):
        main(["certify", str(DEPOT), "--json", "--quiet", *more])
        longest.append(json.loads(capsys.readouterr().out)["promise"]["unseen_max_m"])
    assert longest[0] < longest[1] < longest[2]


# --- lengths and grids


def test_lengths_by_cameras_against_fine_samples() -> None:
    rng = np.random.default_rng(3)
    arc = rng.integers(0, 5, 40)
    start = rng.uniform(0.0, 8.0, 40)
    end = start + rng.uniform(0.0, 2.0, 40)
    order = np.lexsort((start, arc))
    zero = np.zeros(40)
    coverage = Coverage(arc[order], rng.integers(0, 9, 40), start[order], end[order], zero, zero)
    chosen = np.array([True, False, True, True, True])
    found = lengths_by_cameras(coverage, np.full(5, 10.0), chosen)
    at = (np.arange(100_000)[:, None] + 0.5) * 1e-4
    counts = []
    for a in np.flatnonzero(chosen):
        mine = coverage.arc == a
        counts.append(((at >= coverage.start_m[mine]) & (at < coverage.end_m[mine])).sum(axis=1))
    np.testing.assert_allclose(found, 1e-4 * np.bincount(np.concatenate(counts)), atol=0.01)


def test_a_window_holds_every_middle_of_its_box() -> None:
    rng = np.random.default_rng(4)
    grid = Grid.over((-3.2, 1.7, 11.4, 9.9), 0.3)
    for _ in range(200):
        low = rng.uniform([-8.0, -3.0], [14.0, 13.0])
        high = low + rng.uniform(0.0, 9.0, 2)
        rows, columns = grid.window(np.r_[low, high])
        inside = (grid.x >= low[0]) & (grid.x <= high[0])
        assert not np.delete(inside, columns).any()
        inside = (grid.y >= low[1]) & (grid.y <= high[1])
        assert not np.delete(inside, rows).any()


@needs_depot
def test_only_the_road_inside_an_area_counts(tmp_path: Path) -> None:
    rings = [
        [[-30, -20], [0, -20], [0, 20], [-30, 20], [-30, -20]],
        [[-28, -4], [-28, 4], [-24, 4], [-24, -4], [-28, -4]],
    ]
    path = tmp_path / "west.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    found = _coverage([str(DEPOT), "--resolution", "0.5", "--area", str(path)], tmp_path / "out")
    # half of the loop of 168 m, less the 8 m of its western side in the hole
    assert found["roads"]["m"] == pytest.approx(84.0 - 8.0)
    assert found["ground"]["m2"] == pytest.approx(30 * 40 - 4 * 8 - 20 * 20)
    assert 0.0 < found["roads"]["seen_share"] < 1.0

"""Cameras designed for the walls of a depot: certified anew, confirmed by rays, and kept in the closed loop."""

from __future__ import annotations

import csv
import itertools
import json
from pathlib import Path

import numpy as np
import pymap3d
import pytest
import yaml

from camnet.certification.design import place_cameras
from camnet.certification.hitting_set import HittingSet
from camnet.certification.way_limits import LimitedWays, ways_as_one
from camnet.cli.main import main
from camnet.config.catalogue import load_catalogue
from camnet.config.load import load_scenario
from camnet.errors import ConfigError, DataError
from camnet.experiments.design_mounts import candidates_at, outline_mounts, wall_mounts
from camnet.experiments.site_ways import site_ways
from camnet.geometry.frustum import Frustum
from camnet.geometry.regions import build_region
from camnet.geometry.rotations import look_at
from camnet.geometry.settings import Box
from camnet.importers.mounts import read_mounts
from camnet.simulation.run import run_network

_WALLS = ("--mounts", "walls:2,5", "--off-max", "30", "--existing", "replace")


def design(capsys, *words):
    """Run ``camnet design``; return the exit status and the report."""
    status = main(["design", *map(str, words), "--json", "--quiet"])
    out = capsys.readouterr().out
    return status, json.loads(out) if out else None


def refused(capsys, *words):
    """Run ``camnet design`` on what cannot be; return what it says."""
    assert main(["design", *map(str, words), "--quiet"]) == 2
    return capsys.readouterr().err


@pytest.fixture(scope="module")
def depot():
    return Path(__file__).parent / "data" / "depot.yaml"


@pytest.fixture(scope="module")
def coarse(depot, tmp_path_factory):
    """Return the folder of a design in few directions."""
    folder = tmp_path_factory.mktemp("design") / "depot"
    words = [*_WALLS, "--aim-step", "45", "--origin", "48.2,16.37,170", "--out", str(folder), "--quiet"]
    assert main(["design", str(depot), *words]) == 0
    return folder


def test_a_design_is_certified_and_rays_along_the_path_agree(coarse, rays, capsys):
    report = json.loads((coarse / "design.json").read_text())
    assert report["certified"]
    assert report["price"] == pytest.approx(sum(c["price"] for c in report["cameras"]))
    assert report["lower_bound"] <= report["price"] <= 1.15 * report["lower_bound"]
    hidden = rays.longest_hidden(yaml.safe_load((coarse / "world.yaml").read_text()))
    assert hidden / 0.8 <= 30.0
    assert report["promise"]["unseen_max_m"] == pytest.approx(hidden, abs=0.2)
    capsys.readouterr()
    assert main(["certify", str(coarse / "world.yaml"), "--json", "--quiet"]) == 0
    promise = json.loads(capsys.readouterr().out)["promise"]
    assert promise["limit_s"] == 30.0
    assert promise["limit_source"] == "certificate.off_max_s"
    assert promise["unseen_max_m"] == report["promise"]["unseen_max_m"]


def test_files_tell_the_same_cameras(coarse):
    world = load_scenario(coarse / "world.yaml")
    rows = list(csv.DictReader((coarse / "cameras.csv").open()))
    assert [r["name"] for r in rows] == [c.name for c in world.fixed_cameras]
    for row, camera in zip(rows, world.fixed_cameras, strict=True):
        place, look = np.array(camera.pose.position_m), np.array(camera.pose.look_at_m)
        np.testing.assert_allclose([float(row[a]) for a in "xyz"], place)
        axis = (look - place) / np.linalg.norm(look - place)
        assert np.degrees(np.arctan2(axis[1], axis[0])) == pytest.approx(float(row["pan_deg"]), abs=0.02)
        assert np.degrees(np.arcsin(-axis[2])) == pytest.approx(float(row["tilt_deg"]), abs=0.02)
        assert row["camera"] == camera.camera
    features = json.loads((coarse / "cameras.geojson").read_text())["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    assert [f["properties"]["name"] for f in points] == [r["name"] for r in rows]
    for feature, row in zip(points, rows, strict=True):
        lon, lat, up = feature["geometry"]["coordinates"]
        here = pymap3d.geodetic2enu(lat, lon, up, 48.2, 16.37, 170.0)
        np.testing.assert_allclose(here, [float(row[a]) for a in "xyz"], atol=0.01)
    assert {f["properties"]["name"] for f in features} == {r["name"] for r in rows}


@pytest.mark.slow
@pytest.mark.parametrize("pixels", ["detect", "recognise"])
def test_the_shipped_catalogue_on_the_depots_walls(capsys, depot, rays, tmp_path, pixels):
    status, report = design(capsys, depot, *_WALLS, "--class", pixels, "--out", tmp_path / "d")
    assert (status, report["certified"]) == (0, True)
    assert report["price"] <= 1.15 * report["lower_bound"]
    hidden = rays.longest_hidden(yaml.safe_load((tmp_path / "d" / "world.yaml").read_text()))
    assert hidden / 0.8 <= 30.0


@pytest.mark.slow
def test_the_closed_loop_keeps_the_guard_within_the_promise(coarse):
    promise = json.loads((coarse / "design.json").read_text())["promise"]
    longest = 0.0
    for seed in range(20):
        scenario = load_scenario(coarse / "world.yaml", ["run.estimators=[learned]"], seed=seed)
        log = run_network(scenario, seed).log.table().to_pydict()
        t, seen = np.array(log["t_s"]), np.array(log["guard.seen_by"]) >= 0
        edges = np.flatnonzero(np.diff(np.r_[False, ~seen, False].astype(int))).reshape(-1, 2)
        longest = max(longest, *((t[min(b, len(t) - 1)] - t[a]) for a, b in edges.tolist()))
    assert 0.0 < longest <= promise["unseen_max_s"] + 0.2  # the log's step at either end


def test_cameras_that_stand_are_kept(capsys, depot):
    status, report = design(capsys, depot, "--mounts", "walls:8,5", "--off-max", "30", "--aim-step", "45")
    assert (status, report["count"], report["price"]) == (0, 0, 0.0)  # they are enough already
    assert len(report["standing"]) == 6
    status, report = design(capsys, depot, "--mounts", "walls:8,5", "--off-max", "12", "--aim-step", "45")
    assert (status, report["certified"]) == (0, True)
    assert report["count"] > 0
    assert report["promise"]["unseen_max_s"] <= 12.0


def test_money_and_number_bound_a_design(capsys, depot):
    few = (depot, *_FEW)
    _, cheapest = design(capsys, *few)
    assert "allow more money" in refused(capsys, *few, "--budget", cheapest["price"] - 1.0)
    money = 2.0 * cheapest["price"]
    status, best = design(capsys, *few, "--objective", "margin", "--budget", money, "--time-limit", "5")
    assert status == 0
    assert best["price"] <= money
    assert best["promise"]["unseen_max_s"] < cheapest["promise"]["unseen_max_s"]
    _, fewest = design(capsys, *few, "--objective", "fewest")
    assert fewest["count"] <= cheapest["count"]
    assert fewest["price"] >= cheapest["price"]
    assert "allow more cameras" in refused(capsys, *few, "--count", fewest["count"] - 1)


_FEW = ("--mounts", "walls:8,5", "--off-max", "30", "--existing", "replace", "--aim-step", "45")


def test_a_design_survives_the_failure_of_any_camera(capsys, depot, rays, tmp_path):
    status, report = design(capsys, depot, *_FEW, "--survive", "1", "--out", tmp_path / "d")
    assert (status, report["certified"]) == (0, True)
    assert report["price"] <= 1.15 * report["lower_bound"]
    world = yaml.safe_load((tmp_path / "d" / "world.yaml").read_text())
    worst = report["after_failures"]
    assert worst["unseen_max_s"] <= 30.0
    (lost,) = worst["failed"]
    left = [c for c in world["fixed_cameras"] if c["name"] != lost]
    hidden = rays.longest_hidden({**world, "fixed_cameras": left})
    assert hidden == pytest.approx(worst["unseen_max_m"], abs=0.2)
    for camera in left[::3]:
        rays.clean()
        others = [c for c in world["fixed_cameras"] if c is not camera]
        assert rays.longest_hidden({**world, "fixed_cameras": others}) <= worst["unseen_max_m"] + 0.2


def test_no_camera_sees_a_private_area(capsys, depot, coarse, rays, tmp_path):
    low, high = (27.5, -5.0), (31.0, 5.0)
    ring = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]], [low[0], low[1]]]
    area = tmp_path / "private.geojson"
    area.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    points = np.random.default_rng(0).uniform((*low, 0.0), (*high, 2.0), (5000, 3))

    def seen(world):
        return any(rays.sees(world, camera, points).any() for camera in world["fixed_cameras"])

    world = yaml.safe_load((coarse / "world.yaml").read_text())
    for solid in world["occluders"]:
        rays.box(solid["shape"]["min_m"], solid["shape"]["max_m"])
    pose = {"position_m": [20.1, 0.0, 5.0], "look_at_m": [29.0, 0.0, 0.0]}  # on the wall before the area
    assert seen({**world, "fixed_cameras": [{**world["fixed_cameras"][0], "pose": pose}]})
    status, report = design(capsys, depot, *_FEW, "--private", area, "--out", tmp_path / "d")
    assert (status, report["certified"]) == (0, True)
    assert report["candidates_that_may"] < report["candidates"]
    assert not seen(yaml.safe_load((tmp_path / "d" / "world.yaml").read_text()))
    standing = (depot, "--mounts", "walls:8,5", "--off-max", "30", "--private", area, "--aim-step", "45")
    assert "which stands, sees a private area" in refused(capsys, *standing)


def test_a_design_holds_under_installation_error(capsys, depot, rays, tmp_path):
    words = ("--mount-tolerance", "0.05,2", "--out", tmp_path / "d")
    status, report = design(capsys, depot, *_FEW, *words)
    assert (status, report["certified"]) == (0, True)
    held = report["with_installation_error"]
    assert report["promise"]["unseen_max_s"] <= held["unseen_max_s"] <= 30.0
    world = yaml.safe_load((tmp_path / "d" / "world.yaml").read_text())
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(6):
        rays.clean()
        installed = [{**c, "pose": _misplaced(c["pose"], 0.05, 2.0, rng)} for c in world["fixed_cameras"]]
        worst = max(worst, rays.longest_hidden({**world, "fixed_cameras": installed}))
    assert worst <= held["unseen_max_m"] + 0.2


def _misplaced(pose, position_m, angle_deg, rng):
    """Return a pose at the border of what is tolerated; a turn about the optical axis is left to the frustum's test."""
    p, look = np.array(pose["position_m"]), np.array(pose["look_at_m"])
    axis = (look - p) / np.linalg.norm(look - p)
    across = np.cross(axis, rng.normal(size=3))
    turn = np.tan(np.radians(angle_deg)) * across / np.linalg.norm(across)
    off = rng.normal(size=3)
    p = p + position_m * off / np.linalg.norm(off)
    return {"position_m": p.tolist(), "look_at_m": (p + 10.0 * (axis + turn)).tolist()}


@pytest.mark.parametrize("seed", range(6))
def test_hitting_sets_that_need_several_agree_with_brute_force(seed):
    rng = np.random.default_rng(seed)
    cost = rng.integers(1, 6, 8).astype(float)
    problem = HittingSet(cost)
    sizes = [(int(rng.integers(3, 6)), int(rng.integers(1, 4))) for _ in range(6)]
    rows = [(rng.choice(8, size, replace=False).tolist(), need) for size, need in sizes]
    for row, need in rows:
        problem.add([row], need)
    sets = (np.flatnonzero([k >> j & 1 for j in range(8)]) for k in range(256))
    good = [s for s in sets if all(len(np.intersect1d(s, row)) >= need for row, need in rows)]
    best = min(cost[s].sum() for s in good)
    chosen, bound, _ = problem.exact(1000, 5.0)
    assert cost[chosen].sum() == pytest.approx(best)
    assert bound == pytest.approx(best)
    assert problem.relaxed()[1] <= best + 1e-9
    greedy = problem.greedy([1])
    assert any(np.array_equal(greedy, s) for s in good)
    found, flags = True, np.zeros(8, dtype=bool)
    flags[greedy] = True
    budget = cost[greedy].sum()
    while found:  # cheaper and cheaper, until nothing is
        found, _ = problem.within(budget, flags, 100_000, rng)
        if found:
            assert any(np.array_equal(np.flatnonzero(flags), s) for s in good)
            budget = cost[flags].sum() - 1.0
    assert budget == pytest.approx(best - 1.0)


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (("--off-max", "30"), "give --mounts"),
        ((*_WALLS, "--footprint", "30"), "--footprint 30"),
        ((*_WALLS, "--poles", "p.csv"), "--poles p.csv"),
        ((*_WALLS, "--spacing", "5"), "--spacing 5"),
        ((*_WALLS, "--check", "t.xml"), "--check t.xml"),
        ((*_WALLS, "--stop-s", "3"), "--stop-s 3"),
        ((*_WALLS, "--on-min", "3"), "--on-min 3"),
        ((*_WALLS, "--model-error", "3"), "--model-error 3"),
        ((*_WALLS, "--initial-error", "3"), "--initial-error 3"),
        ((*_WALLS, "--budget", "500", "--count", "3"), "money bounds the price"),
        ((*_WALLS, "--mount-tolerance", "0.05,60"), "such as 0.05,1"),
        (("--mounts", "walls:2,9"), "the highest wall ends at 5.5 m"),
        (("--mounts", "walls:2"), "such as walls:2,5"),
        (("--mounts", "walls:2,5", "--mounts", "walls:2,5"), "is there twice"),
    ],
)
def test_what_does_not_apply_is_refused(capsys, depot, words, advice):
    assert advice in refused(capsys, depot, *words)


_FOR_WORLDS = (
    "--mounts", "--catalogue", "--existing", "--budget", "--aim-step", "--set", "--survive", "--private",
    "--mount-tolerance",
)  # fmt: skip


@pytest.mark.parametrize("option", _FOR_WORLDS)
@pytest.mark.parametrize("source", ["--roads", "--tracks"])
def test_other_designs_refuse_what_is_for_worlds(capsys, source, option):
    value = {"--existing": "keep", "--budget": "3", "--aim-step": "3", "--survive": "1"}.get(option, "x")
    assert f"{option} {value}" in refused(capsys, source, "file", option, value)


def test_worlds_with_agents_or_free_targets_are_refused(capsys):
    assert "agents" in refused(capsys, "quickstart", "--mounts", "outline:5,4")


def test_mounts_stand_off_walls_and_look_away_from_them():
    house = build_region("house", Box(min_m=(0, 0, 0), max_m=(8, 4, 6)))
    shed = build_region("shed", Box(min_m=(8, 1, 0), max_m=(10, 3, 6)))
    fence = build_region("fence", Box(min_m=(0, 9, 0), max_m=(8, 9.2, 2)))
    mounts = wall_mounts([house, shed, fence], 2.0, 5.0)
    assert not any("fence" in m.name for m in mounts)  # too low
    for m in mounts:
        p = np.array([m.x_m, m.y_m, m.z_m])
        assert min(float(s.signed_distance(p)) for s in (house, shed)) == pytest.approx(0.1, abs=0.05)
    walls = [m for m in mounts if m.name.startswith("house wall")]
    south = [m for m in walls if m.y_m < 0]
    assert [m.x_m for m in south] == pytest.approx([1.0, 3.0, 5.0, 7.0])
    assert south[0].pan_deg == pytest.approx((-180.0, 0.0))
    assert not any(m.x_m > 8 and 1 < m.y_m < 3 for m in walls)  # behind the shed
    corners = [m for m in mounts if m.name.startswith("house corner")]
    assert {m.pan_deg[1] - m.pan_deg[0] for m in corners} == {270.0}
    masts = outline_mounts(np.array([[-20.0, 0.0], [30.0, 0.0], [0.0, 25.0]]), [house], 5.0, 4.0)
    assert max(np.hypot(a.x_m - b.x_m, a.y_m - b.y_m) for a, b in itertools.pairwise(masts)) < 5.01


def test_candidates_are_what_a_world_file_says():
    mounts = wall_mounts([build_region("house", Box(min_m=(0, 0, 0), max_m=(8, 4, 6)))], 3.0, 5.0)
    models = [c.model(25.0) for c in load_catalogue()]
    found = candidates_at(mounts, models, 20.0)
    rows = np.array([5, 17, 3, len(found) - 1])
    views = found.views(models, rows)
    for k, row in enumerate(rows.tolist()):
        p, look = found.position_m[row], found.look_at_m[row]
        own = Frustum.from_camera(models[found.model[row]]).in_world(p, look_at(p, look))
        np.testing.assert_allclose(views.normals[k], own.A, atol=1e-12)
        np.testing.assert_allclose(views.offsets[k], own.b, atol=1e-12)
        mount = mounts[found.mount[row]]
        assert mount.pan_deg[0] - 1e-9 <= found.pan_deg[row] <= mount.pan_deg[1] + 1e-9


def test_the_range_of_a_camera_has_the_pixels_that_are_asked_for():
    for camera in load_catalogue():
        model = camera.model(62.5)
        assert model.intrinsics.fx_px / model.far_m == pytest.approx(62.5, rel=1e-3)
        half = np.degrees(np.arctan(0.5 * camera.width_px / model.intrinsics.fx_px))
        assert 2.0 * half == pytest.approx(camera.fov_deg, abs=1e-3)
        with pytest.raises(ConfigError, match="fewer pixels per metre"):
            camera.model(1e5)


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("cameras: []", "cameras"),
        ("cameras: [{name: a, width_px: 10, height_px: 10, fov_deg: 200, price: 1}]", "fov_deg"),
        ("cameras: [{name: a, width_px: 10, height_px: 10, fov_deg: 90, price: 1, zoom: 3}]", "zoom"),
        ("cameras: [{name: a, width_px: 10, height_px: 10, fov_deg: 90}]", "price"),
        ("- 3", "cameras"),
    ],
)
def test_a_catalogue_is_strict(tmp_path, text, advice):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=advice):
        load_catalogue(path)


@pytest.mark.parametrize(
    ("row", "advice"),
    [
        ("a,0,0,5,90,-90", "pan_min, pan_max are 90, -90"),
        ("a,0,0,north,0,90", "z is 'north'"),
        (",0,0,5,0,90", "name is ''"),
        ("a,0,0,5,0", "5 fields"),
    ],
)
def test_a_table_of_mounts_is_strict(tmp_path, row, advice):
    path = tmp_path / "m.csv"
    path.write_text(f"name,x,y,z,pan_min,pan_max\n{row}\n")
    with pytest.raises(DataError, match=advice):
        read_mounts(path)


def test_a_table_of_mounts_has_defaults(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("name,x,y,z,tilt_max,cost\npole,1,2,5,,30\n")
    (mount,) = read_mounts(path)
    assert (mount.pan_deg, mount.tilt_deg, mount.cost) == ((-180.0, 180.0), (0.0, 90.0), 30.0)


def test_the_solver_agrees_with_brute_force_in_metres_and_seconds(depot):
    """All pairs of a few candidates, judged by the certifier's own longest stretches."""
    from camnet.certification.way_search import coverage_rows
    from camnet.certification.ways import cover_ways
    from camnet.experiments.promise_world import solids_of, target_features, watch

    (site,) = site_ways(load_scenario(depot))
    solids = [build_region(o.name, o.shape) for o in site.network.scenario.occluders]
    models = [load_catalogue()[0].model(25.0)]
    found = candidates_at(wall_mounts(solids, 20.0, 5.0), models, 60.0)
    views = found.views(models, np.arange(len(found)))
    covers = [cover_ways(w, views, solids_of(site.network), target_features(site.network)) for w in site.ways]

    def longest(chosen):
        parts = [
            watch(w, coverage_rows(c, np.isin(c.camera, chosen)))
            for w, c in zip(site.ways, covers, strict=True)
        ]
        return max(p.in_m.longest[0] for p in parts), max(p.in_s.longest[0] for p in parts)

    seeing = np.unique(np.concatenate([c.camera for c in covers])).tolist()[:24]
    pairs = {pair: longest(pair) for pair in itertools.combinations(seeing, 2)}
    best = min(pairs.values())
    for limit_m, limit_s in ((best[0] + 1.0, None), (None, best[1] + 1.0), (best[0] + 1.0, best[1] - 1.0)):
        parts = [
            LimitedWays(w, coverage_rows(c, np.isin(c.camera, seeing)), limit_m, limit_s)
            for w, c in zip(site.ways, covers, strict=True)
        ]
        roads, cover = ways_as_one(parts)
        possible = any(m <= (limit_m or np.inf) and s <= (limit_s or np.inf) for m, s in pairs.values())
        placed = place_cameras(roads, cover, len(found), 1.0, time_limit_s=20.0)
        m, s = longest(placed.chosen)
        assert m <= (limit_m or np.inf) + 1e-3
        assert s <= (limit_s or np.inf) + 1e-3
        assert (len(placed.chosen) <= 2) == possible
        assert placed.optimal


def _aimed(depot, tmp_path, looks):
    """Write the depot with cameras that look elsewhere; return the file."""
    world = yaml.safe_load(depot.read_text())
    for camera in world["fixed_cameras"]:
        if camera["name"] in looks:
            camera["pose"]["look_at_m"] = looks[camera["name"]]
    path = tmp_path / "aimed.yaml"
    path.write_text(yaml.safe_dump(world))
    return path


#: each camera that stands looks away from the site
_AWAY = {
    "sw": [-60, -60, 0], "se": [60, -60, 0], "ne": [60, 60, 0], "nw": [-60, 60, 0], "gate": [0, -70, 5],
    "dock": [0, 70, 5],
}  # fmt: skip


def test_a_world_is_repaired_by_turning_what_stands(capsys, depot, rays, tmp_path):
    broken = _aimed(depot, tmp_path, _AWAY)
    assert main(["certify", str(broken), "--off-max", "30", "--quiet"]) == 1
    capsys.readouterr()
    words = ("--off-max", "30", "--aim-step", "30", "--mounts", "walls:10,5", "--out", tmp_path / "d")
    status, report = design(capsys, "--repair", broken, *words)
    assert (status, report["certified"]) == (0, True)
    assert {c["change"] for c in report["cameras"]} == {"turn"}  # 25 each, a new camera costs more
    assert report["price"] == 25.0 * len(report["cameras"])
    assert report["lower_bound"] <= report["price"] <= 1.15 * report["lower_bound"]
    world = yaml.safe_load((tmp_path / "d" / "world.yaml").read_text())
    before = {c["name"]: c["pose"] for c in yaml.safe_load(broken.read_text())["fixed_cameras"]}
    turned = {c["name"] for c in report["cameras"]}
    assert [c["name"] for c in world["fixed_cameras"]] == list(before)
    for camera in world["fixed_cameras"]:
        own = before[camera["name"]]
        assert camera["pose"]["position_m"] == own["position_m"]
        assert (camera["pose"]["look_at_m"] != own["look_at_m"]) == (camera["name"] in turned)
    assert rays.longest_hidden(world) / 0.8 <= 30.0
    assert main(["certify", str(tmp_path / "d" / "world.yaml"), "--quiet"]) == 0


def test_moving_is_chosen_where_it_is_cheaper_than_turning(capsys, depot, rays, tmp_path):
    broken = _aimed(depot, tmp_path, _AWAY)
    words = ("--off-max", "30", "--aim-step", "45", "--mounts", "walls:10,5", "--existing", "movable")
    prices = ("--turn-price", "500", "--move-price", "40", "--out", tmp_path / "d")
    status, report = design(capsys, broken, *words, *prices)
    assert (status, report["certified"]) == (0, True)
    assert {c["change"] for c in report["cameras"]} == {"move"}
    world = yaml.safe_load((tmp_path / "d" / "world.yaml").read_text())
    assert len(world["fixed_cameras"]) == 6  # nothing was bought
    assert rays.longest_hidden(world) / 0.8 <= 30.0
    # at most as many can be moved as stand: with one camera the rest has to be bought
    one = yaml.safe_load(broken.read_text())
    one["fixed_cameras"] = one["fixed_cameras"][:1]
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(one))
    status, report = design(capsys, tmp_path / "one.yaml", *words, "--turn-price", "1", "--move-price", "1")
    assert (status, report["certified"]) == (0, True)
    changes = [c["change"] for c in report["cameras"]]
    assert changes.count("turn") + changes.count("move") <= 1
    assert "add" in changes


def test_what_needs_no_repair_is_left_alone(capsys, depot):
    status, report = design(
        capsys, "--repair", depot, "--off-max", "30", "--aim-step", "45", "--mounts", "walls:20,5"
    )
    assert (status, report["count"], report["price"]) == (0, 0, 0.0)
    assert len(report["standing"]) == 6


def test_repairs_refuse_what_contradicts_them(capsys, depot):
    assert "turns and moves the cameras" in refused(capsys, "--repair", depot, "--existing", "keep")
    words = ("--mounts", "walls:9,5", "--turn-price", "3")
    assert "goes with --existing movable" in refused(capsys, depot, *words)
    assert "give a world file, --roads NET" in refused(capsys, "--off-max", "3")


@pytest.mark.parametrize("seed", range(4))
def test_bounded_choices_agree_with_brute_force(seed):
    rng = np.random.default_rng(seed)
    cost = rng.integers(1, 6, 8).astype(float)
    groups = [(np.array([0, 1, 2]), 1), (np.array([2, 3, 4, 5]), 2)]
    problem = HittingSet(cost, groups)
    for _ in range(5):
        problem.add([rng.choice(8, int(rng.integers(2, 5)), replace=False).tolist()])
    sets = (np.flatnonzero([k >> j & 1 for j in range(8)]) for k in range(256))
    good = [
        s
        for s in sets
        if all(np.intersect1d(s, row).size for row in problem.rows)
        and all(np.intersect1d(s, members).size <= most for members, most in groups)
    ]
    found = problem.exact(1000, 60.0)
    if not good:
        assert found[0] is None
        return
    best = min(cost[s].sum() for s in good)
    assert cost[found[0]].sum() == pytest.approx(best)
    assert problem.relaxed()[1] <= best + 1e-9
    try:
        greedy = problem.greedy()
    except ValueError:
        return
    assert any(np.array_equal(greedy, s) for s in good)


def test_cameras_look_up_where_a_target_flies(capsys, tmp_path):
    words = ("--mounts", "outline:12,2", "--existing", "replace", "--off-max", "25", "--aim-step", "30")
    status, report = design(capsys, "drone_watch", *words, "--out", tmp_path / "d")
    assert (status, report["certified"]) == (0, True)
    assert min(c["tilt_deg"] for c in report["cameras"]) <= 0.0  # level or upwards: none looks at the ground
    assert report["lower_bound"] <= report["price"] <= 1.15 * report["lower_bound"]

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st

import camnet.worlds
from camnet.config import RecordedScenario, Scenario, dump_scenario, load_scenario, shipped_worlds
from camnet.config.merge import merge
from camnet.config.models import CameraModel
from camnet.config.yaml_nodes import Node, Origin, parse_yaml
from camnet.errors import CamnetError, ConfigError
from camnet.geometry.polytope import largest_ball
from camnet.types import Array


def network(source: str | Path, *overrides: str) -> Scenario:
    scenario = load_scenario(source, overrides)
    assert isinstance(scenario, Scenario)
    return scenario


@pytest.mark.parametrize("name", sorted(shipped_worlds()))
def test_shipped_worlds_come_back_from_their_dump(name: str, tmp_path: Path):
    scenario = load_scenario(name)
    (tmp_path / "world.yaml").write_text(dump_scenario(scenario), encoding="utf-8")
    assert load_scenario(tmp_path) == scenario
    assert load_scenario(tmp_path / "world.yaml") == scenario


def test_the_catalogue_counts_what_is_in_the_files():
    assert {"quickstart", "stationary_loop"} <= set(camnet.worlds.names())
    summary = camnet.worlds.describe("quickstart")
    assert (summary.regions, summary.agents, summary.fixed_cameras, summary.targets) == (4, 4, 0, 1)
    assert camnet.worlds.describe("stationary_loop").fixed_cameras == 6
    assert camnet.worlds.path("quickstart").is_file()
    with pytest.raises(ConfigError, match="did you mean 'quickstart'"):
        camnet.worlds.path("quikstart")


def test_recipes_load(project_root: Path, shared_data: Path):
    recipes = sorted((project_root / "configs").glob("*.yaml"))
    assert {path.stem for path in recipes} >= {"quickstart", "stationary_loop", "meva", "bologna"}
    for path in recipes:
        data = shared_data / path.stem
        scenario = load_scenario(path, [f"data={data}"] if data.is_dir() else [])
        assert scenario.name == path.stem


def test_the_recorded_site_reads_all_its_cameras_and_people(project_root: Path, shared_data: Path):
    scenario = load_scenario(project_root / "configs" / "meva.yaml", [f"data={shared_data / 'meva'}"])
    assert isinstance(scenario, RecordedScenario)
    assert len(scenario.read_cameras()) == 14
    tracks = scenario.read_tracks()
    assert len({track.id.partition("#")[0] for track in tracks}) == 53
    longest = scenario.tracks.max_fix_interval_s
    assert all(np.diff(track.t_s).max(initial=0.0) <= longest for track in tracks)


def test_a_recipe_is_merged_over_its_world(tmp_path: Path):
    (tmp_path / "mine.yaml").write_text(
        "world: quickstart\n"
        "targets:\n"
        "  - {name: robot, motion: {speed_mps: 0.2}}\n"
        "  - {name: second, motion: {kind: road, road: loop}}\n"
        "agents: [{name: camera_3, remove: true}]\n"
        "regions: [{name: south, remove: true}]\n"
        "cameras: [{name: gimbal_cam, far_m: 6}]\n",
        encoding="utf-8",
    )
    base, merged = network("quickstart"), network(tmp_path / "mine.yaml")
    assert [target.name for target in merged.targets] == ["robot", "second"]
    robot = base.targets[0]
    motion = robot.motion.model_copy(update={"speed_mps": 0.2})
    assert merged.targets[0] == robot.model_copy(update={"motion": motion})
    assert merged.agents == base.agents[:3]
    assert merged.cameras == (base.cameras[0].model_copy(update={"far_m": 6.0}),)
    assert merged.physics == base.physics


def test_a_recipe_of_a_recipe_finds_files_beside_each(tmp_path: Path):
    (tmp_path / "low").mkdir()
    (tmp_path / "low" / "a.yaml").write_text("world: quickstart\nseed: 3\nname: a\n", encoding="utf-8")
    (tmp_path / "b.yaml").write_text("world: low/a.yaml\nname: b\n", encoding="utf-8")
    scenario = network(tmp_path / "b.yaml")
    assert (scenario.name, scenario.seed) == ("b", 3)


def test_another_kind_replaces_the_mapping_whole():
    def parse(text: str) -> Node:
        return parse_yaml(text, Origin("x", 1))

    base = parse("motion: {kind: vector_field, field: loop}\nrest: {a: 1, b: 2}\nlist: [1, 2]")
    over = parse("motion: {kind: road, road: r}\nrest: {b: 3}\nlist: [4]")
    expected = {"motion": {"kind": "road", "road": "r"}, "rest": {"a": 1, "b": 3}, "list": [4]}
    assert merge(base, over).plain() == expected


def test_overrides_address_items_by_name_and_number():
    scenario = network(
        "quickstart",
        "targets.robot.motion.speed_mps=0.3",
        "agents.0.start_m=[4, 0.5, 2]",
        "agents[1].start_m[2]=1.5",
        "physics.wind.gust_std_mps=0.5",
        "run.duration_s=1e2",
    )
    assert scenario.targets[0].motion.speed_mps == 0.3
    assert scenario.agents[0].start_m == (4.0, 0.5, 2.0)
    assert scenario.agents[1].start_m == (0.0, 4.0, 1.5)
    assert scenario.physics.wind.gust_std_mps == 0.5
    assert scenario.run.duration_s == 100.0


def test_the_seed_argument_wins():
    assert load_scenario("quickstart", ["seed=4"], seed=9).seed == 9


def test_agents_without_a_start_begin_in_the_middle_of_their_region():
    scenario = network("quickstart", "agents.0={name: camera_0, region: east, camera: gimbal_cam}")
    assert scenario.agents[0].start_m == pytest.approx((4.0, 0.0, 1.75))


def test_data_is_where_relative_paths_start(valid_inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    home, data = tmp_path / "home", tmp_path / "data"
    for folder in (home, data):
        folder.mkdir()
        (folder / "walk.csv").write_text(valid_inputs.TRACK, encoding="utf-8")
    (home / "world.yaml").write_text(valid_inputs.TRACK_WORLD, encoding="utf-8")
    assert network(home).targets[0].motion.file == home / "walk.csv"
    assert network(home, f"data={data}").targets[0].motion.file == data / "walk.csv"
    monkeypatch.chdir(data)
    assert network(home, "targets.robot.motion.file=walk.csv").targets[0].motion.file == data / "walk.csv"
    assert network(home, "data=.").data == data


def view_volume(position: Array, look_at: Array, camera: CameraModel) -> tuple[Array, Array]:
    """Half-spaces of a camera without roll, written out again."""
    inside = camera.intrinsics
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    tan_x, tan_y = inside.width_px / 2 / inside.fx_px, inside.height_px / 2 / inside.fy_px
    rows = np.array(
        [[1, 0, -tan_x], [-1, 0, -tan_x], [0, 1, -tan_y], [0, -1, -tan_y], [0, 0, 1], [0, 0, -1]], dtype=float
    )
    a = rows @ axes
    b = np.array([0, 0, 0, 0, camera.far_m, -camera.near_m]) + a @ position
    length = np.linalg.norm(a, axis=1)
    return a / length[:, None], b / length


def test_the_stationary_cameras_see_disjoint_parts_of_the_road():
    scenario = network("stationary_loop")
    volumes = [
        view_volume(np.array(c.pose.position_m), np.array(c.pose.look_at_m), scenario.cameras[0])
        for c in scenario.fixed_cameras
    ]
    for i, (a, b) in enumerate(volumes):
        for other_a, other_b in volumes[:i]:
            assert largest_ball(np.vstack([a, other_a]), np.append(b, other_b))[1] < 0
    corners = np.array(scenario.roads[0].points_m)
    ends = np.roll(corners, -1, axis=0)
    road = (
        corners[:, None] + np.linspace(0, 1, 50, endpoint=False)[:, None] * (ends - corners)[:, None]
    ).reshape(-1, 2)
    top = np.column_stack([road, np.full(len(road), 0.3)])
    seen = [np.all(top @ a.T <= b, axis=1) for a, b in volumes]
    assert all(part.mean() > 0.05 for part in seen)
    assert 0.4 <= np.any(seen, axis=0).mean() <= 0.55


QUICKSTART = yaml.safe_load(shipped_worlds()["quickstart"].read_text(encoding="utf-8"))
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=4), st.integers(), max_size=2),
)


def paths(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    found = [path] if path else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        found += paths(child, (*path, key))
    return found


def item_at(value: object, path: tuple[str | int, ...]) -> object:
    for part in path:
        value = value[part]  # type: ignore[index]
    return value


def replaced(value: object, path: tuple[str | int, ...], junk: object) -> object:
    if not path:
        return junk
    if isinstance(value, dict):
        return {
            key: replaced(child, path[1:], junk) if key == path[0] else child for key, child in value.items()
        }
    assert isinstance(value, list)
    return [replaced(child, path[1:], junk) if i == path[0] else child for i, child in enumerate(value)]


def refusal(source: str | Path, overrides: list[str] | None = None) -> str | None:
    """Message with which the input is refused, None if it loads; anything else but our errors comes through."""
    try:
        load_scenario(source, overrides or [])
    except CamnetError as error:
        return str(error)
    return None


@given(path=st.sampled_from(paths(QUICKSTART)), junk=JUNK)
def test_corrupted_values_are_refused_in_words_or_load(tmp_path_factory, path, junk):
    file = tmp_path_factory.mktemp("corrupt") / "world.yaml"
    file.write_text(yaml.safe_dump(replaced(QUICKSTART, path, junk)), encoding="utf-8")
    message = refusal(file)
    assert message is None or str(file) in message


MAPPINGS = [path for path in [(), *paths(QUICKSTART)] if isinstance(item_at(QUICKSTART, path), dict)]
KNOWN = {
    *Scenario.model_fields,
    *(part for path in paths(QUICKSTART) for part in path),
    "world",
    "distortion",
}


@given(path=st.sampled_from(MAPPINGS), key=st.text(max_size=12), junk=JUNK)
def test_unknown_keys_are_refused(tmp_path_factory, path, key, junk):
    assume(key not in KNOWN)
    place = item_at(QUICKSTART, path)
    file = tmp_path_factory.mktemp("unknown") / "world.yaml"
    file.write_text(yaml.safe_dump(replaced(QUICKSTART, path, {**place, key: junk})), encoding="utf-8")
    message = refusal(file)
    assert message is not None
    assert str(file) in message


PLACES = ["{}", "run.{}", "agents.0={}", "seed={}", "{}=1", "targets.robot.motion.speed_mps={}"]


@given(place=st.sampled_from(PLACES), text=st.text(max_size=30))
def test_any_override_is_refused_in_words_or_loads(place: str, text: str):
    message = refusal("quickstart", [place.format(text)])
    assert message is None or "--set" in message

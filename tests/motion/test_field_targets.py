"""Targets on stated laws of motion: paths against closed forms, the certificate against the flown world, bad input."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from camnet.batch.network import Shown
from camnet.batch.simulation import BatchSimulation
from camnet.cli.main import main
from camnet.config.load import load_scenario
from camnet.env.batch_handoff import batch_filter
from camnet.errors import CamnetError, ConfigError
from camnet.motion.expression import parse_expression
from camnet.motion.factory import build_motion
from camnet.motion.settings import FieldTarget, TargetSettings
from camnet.simulation.network import build_network
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet import PyBulletWorld

CONFIGS = Path(__file__).parents[2] / "configs"
_SHOWN = Shown(0.5, 0, 1.0, (0.0,) * 6, terminate_on_collision=False, lost_limit_s=np.inf, in_world=True)


def target(law, **of):
    """Return a target of kind field."""
    settings = {"name": "it", "start_m": (3.0, 0.0), "v_max_mps": 20.0, **of}
    return TargetSettings(motion=FieldTarget(kind="field", **law), **settings)


def followed(motion, seconds, dt=0.01):
    """Step a motion; return times, places and velocities."""
    rng = np.random.default_rng(0)
    state, rows = motion.reset(rng), []
    rows.append([0.0, *state.p_world, *state.v_world])
    for k in range(round(seconds / dt)):
        state = motion.step(state, k * dt, dt, rng)
        rows.append([(k + 1) * dt, *state.p_world, *state.v_world])
    rows = np.array(rows)
    return rows[:, 0], rows[:, 1:4], rows[:, 4:]


def test_a_turning_field_makes_circles():
    law = {"velocity_mps": ["-w*y", "w*x"], "parameters": {"w": 0.3}}
    motion = build_motion(target(law), ())
    t, p, v = followed(motion, 40.0)
    np.testing.assert_allclose(p, np.c_[3 * np.cos(0.3 * t), 3 * np.sin(0.3 * t), 0 * t], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(v, axis=1)[:-1], 0.9, atol=1e-6)
    twist = motion.velocity(p[100], np.array([1.0, 0, 0, 0]), 1.0)
    np.testing.assert_allclose(twist.v, v[100], atol=1e-5)
    assert twist.w[2] == pytest.approx(0.3, abs=1e-4)


def test_a_thrown_ball_flies_a_parabola_and_lands():
    law = {
        "acceleration_mps2": ["0", "0", "-9.81"],
        "start_velocity_mps": (4.0, -1.0, 6.0),
        "start_height_m": 2.0,
    }
    motion = build_motion(target(law), ())
    t, p, _ = followed(motion, 2.0)
    lands = (6.0 + math.sqrt(36.0 + 4 * 9.81)) / 9.81
    assert motion.rests_s == pytest.approx(lands, abs=1e-9)
    up = t <= lands
    expected = np.c_[3 + 4 * t, -t, 2 + 6 * t - 4.905 * t**2]
    np.testing.assert_allclose(p[up], expected[up], atol=1e-6)
    np.testing.assert_allclose(p[~up], [[3 + 4 * lands, -lands, 0.0]] * int((~up).sum()), atol=1e-6)
    assert motion.velocity(p[0], np.array([1.0, 0, 0, 0]), 0.0) is None  # place does not decide


def test_a_law_of_time_and_one_that_comes_to_rest():
    t, p, _ = followed(build_motion(target({"velocity_mps": ["cos(t)", 0.5]}), ()), 6.0)
    np.testing.assert_allclose(p[:, :2], np.c_[3 + np.sin(t), 0.5 * t], atol=1e-6)
    motion = build_motion(target({"velocity_mps": ["-x", "-y"]}), ())
    t, p, _ = followed(motion, 20.0)
    np.testing.assert_allclose(p[:, 0], 3 * np.exp(-t), atol=1e-6)
    assert motion.rests_s == pytest.approx(math.log(3e6), abs=0.1)


def test_a_grid_and_a_module_give_the_law_that_formulas_give(tmp_path, monkeypatch):
    grid = tmp_path / "wind.csv"
    rows = [(x, y, -0.3 * y, 0.3 * x) for x in np.arange(-4, 5) for y in np.arange(-4.0, 4.5, 0.5)]
    np.random.default_rng(0).shuffle(rows)
    grid.write_text("x,y,vx,vy\n" + "\n".join(",".join(map(str, r)) for r in rows))
    (tmp_path / "whirls.py").write_text(
        "import numpy as np\n\n\ndef whirl(p, t):\n    return 0.3 * np.c_[-p[:, 1], p[:, 0]]\n\n\n"
        "def fall(p, v, t):\n    return np.tile([0.0, 0.0, -9.81], (len(p), 1))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    formula = followed(build_motion(target({"velocity_mps": ["-0.3*y", "0.3*x"]}), ()), 10.0)[1]
    for law in ({"grid": grid}, {"entry": "whirls:whirl"}):
        np.testing.assert_allclose(followed(build_motion(target(law), ()), 10.0)[1], formula, atol=1e-6)
    drop = {
        "entry": "whirls:fall",
        "dimensions": 3,
        "start_velocity_mps": (1.0, 0.0, 0.0),
        "start_height_m": 4.905,
    }
    assert build_motion(target(drop), ()).rests_s == pytest.approx(1.0)
    with pytest.raises(CamnetError, match="no value at"):
        build_motion(target({"grid": grid}, start_m=(3.0, 3.0)), ())


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("__import__('os').system('true')", "no part of a formula"),
        ("eval(x)", "is no function"),
        ("x.__class__", "no part of a formula"),
        ("(lambda: 1)()", "no part of a formula"),
        ("[x][0]", "no part of a formula"),
        ("'x'", "no part of a formula"),
        ("True", "no part of a formula"),
        ("x if y else z", "no part of a formula"),
        ("sin(x, y)", "sin takes 1 numbers, not 2"),
        ("x^2", "powers are written"),
        ("q + 1", "'q' is no part of a formula"),
        ("x +", "is no formula"),
        ("", "1 to 2000 characters"),
        ("x" + "+x" * 3000, "1 to 2000 characters"),
        ("-" * 200 + "x", "nested more than 50 deep"),
        ("9**9**9**9", None),
    ],
)
def test_formulas_are_formulas_alone(text, advice):
    if advice is None:
        assert not np.isfinite(parse_expression(text, {"x"})({"x": 1.0}))
        return
    with pytest.raises(ConfigError, match=advice):
        parse_expression(text, {"x", "y", "z"})


def test_formulas_agree_with_numpy():
    x, y = np.random.default_rng(1).normal(size=(2, 50))
    found = parse_expression("-2*x**2 + atan2(y, x) / max(abs(x), 1) % 3 - sqrt(x*x) + pi", {"x", "y"})
    expected = -2 * x**2 + np.arctan2(y, x) / np.maximum(np.abs(x), 1) % 3 - np.sqrt(x * x) + np.pi
    np.testing.assert_allclose(found({"x": x, "y": y}), expected)
    assert found.names == {"x", "y"}


@pytest.mark.parametrize(
    ("law", "advice"),
    [
        ({"velocity_mps": ["1", "0"], "v_max_mps": 0.5}, "moves it at 1 m/s near .* above v_max_mps = 0.5"),
        ({"velocity_mps": ["-y", "x"], "lipschitz_per_s": 0.9}, "slope of its velocity is 1 1/s near"),
        ({"velocity_mps": ["cos(t)", "0"], "lipschitz_per_s": 9.0}, "place alone does not decide"),
        ({"velocity_mps": ["1/(4-x)", "0"]}, "above v_max_mps|cannot be followed|no value"),
        ({"acceleration_mps2": ["0", "0", "-9"]}, "3 numbers were expected"),
        ({"velocity_mps": ["1", "0"], "start_m": None}, "start_m is missing"),
    ],
)
def test_what_the_target_cannot_do_is_refused(law, advice):
    of = {k: law.pop(k) for k in ("v_max_mps", "start_m") if k in law}
    with pytest.raises(CamnetError, match=advice):
        build_motion(target(law, **of), ())


def _world(tmp_path, **motion):
    content = yaml.safe_load((CONFIGS / "projectile.yaml").read_text())
    content["targets"][0]["motion"] = {"kind": "field", **motion}
    path = tmp_path / "w.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


@pytest.mark.parametrize(
    ("motion", "advice"),
    [
        ({}, "give one of velocity_mps, acceleration_mps2, grid, entry; there are 0"),
        ({"velocity_mps": ["1", "0"], "entry": "a:b"}, "there are 2"),
        ({"velocity_mps": ["1", "os.remove('x')"]}, "velocity_mps"),
        ({"velocity_mps": ["1", "0"], "dimensions": 3}, "is of no use with velocity_mps, only with entry"),
        ({"velocity_mps": ["1", "0"], "start_height_m": 2.0}, "give three for one in space"),
        ({"velocity_mps": ["x"]}, "velocity_mps"),
        ({"grid": "nowhere.csv"}, "no such file"),
        ({"entry": "no_such_module_here:law"}, "PYTHONPATH"),
        ({"entry": "math"}, "module:attribute was expected"),
        ({"velocity_mps": ["x", "0"], "parameters": {"x": 1.0}}, "is a variable of the formulas already"),
    ],
)
def test_bad_laws_in_a_world_file_name_the_field(capsys, tmp_path, motion, advice):
    assert main(["certify", _world(tmp_path, **motion)]) == 2
    assert advice in capsys.readouterr().err


@pytest.mark.parametrize("world", ["drone_watch", str(CONFIGS / "projectile.yaml")])
def test_the_engine_keeps_what_is_promised_of_a_target_in_space(capsys, world):
    """The engine moves the target among its own rays; the promise comes from the path and the views' geometry."""
    assert main(["certify", world, "--json", "--quiet"]) == 0
    promise = json.loads(capsys.readouterr().out)["promise"]
    network = build_network(load_scenario(world))
    flown = PyBulletWorld(network.description)
    test = network_visibility(network)
    try:
        now, seen, places = flown.reset(np.random.default_rng(0)), [], []
        for _ in range(round(min(network.scenario.run.duration_s, 45.0) / flown.control_dt_s)):
            seen.append(bool(test(now, flown.rays_clear).any()))
            places.append(now.target_p_world[0].copy())
            now = flown.step(CameraCommand.zeros(0))
    finally:
        flown.close()
    rests = network.description.targets[0].motion.rests_s
    n = min(len(seen), math.floor(rests / flown.control_dt_s)) if math.isfinite(rests) else len(seen)
    edges = np.flatnonzero(np.diff(np.r_[False, ~np.array(seen[:n]), False].astype(int))).reshape(-1, 2)
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
    longest = max(way[min(b, n - 1)] - way[max(a - 1, 0)] for a, b in edges.tolist())
    step = np.diff(way).max()
    assert promise["unseen_max_m"] - 2.1 * step <= longest <= promise["unseen_max_m"] + 2.1 * step
    assert longest > 0.3


def network_visibility(network):
    """Return the simulator's test of which camera sees which target."""
    from camnet.sensing.visibility import VisibilityTest

    features = [t.features_m for t in network.description.targets]
    return VisibilityTest(network.cameras, features, [None] * len(network.cameras))


def test_the_batch_back_end_moves_it_the_same():
    network = build_network(load_scenario("drone_watch", ["run.duration_s=20"]))
    scenario = network.scenario
    run = scenario.run.model_copy(update={"decision_hz": scenario.sensing.rate_hz})
    network = replace(network, scenario=scenario.model_copy(update={"run": run}))
    batch = BatchSimulation(network, _SHOWN, 2, batch_filter("ekf", network), duration_s=20.0)
    motion = network.description.targets[0].motion
    t, p, _ = followed(motion, 5.0, 1.0 / scenario.sensing.rate_hz)
    try:
        batch.reset(np.arange(2), [0, 1])
        for k in range(1, 40):
            batch.step(np.zeros((2, 0, 5)))
            now = batch.gather("target")[..., 0, :3]
            assert batch.outcome[0, 3] == pytest.approx(t[k])
            np.testing.assert_allclose(now, [p[k]] * 2, atol=1e-9)
    finally:
        batch.close()

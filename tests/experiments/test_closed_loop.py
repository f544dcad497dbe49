"""The closed-loop falsifier: plans keep to their class, the judge is right, false promises break, true ones hold."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camnet.cli.main import main
from camnet.config.load import load_scenario
from camnet.errors import CertificateError, ConfigError, DataError
from camnet.experiments.closed_loop.arena import hostile, parse_violation, violated, with_targets
from camnet.experiments.closed_loop.attack import falsify_closed_loop, prepare, read_attack, replay
from camnet.experiments.closed_loop.claims import Claims, ErrorBound, read_claims
from camnet.experiments.closed_loop.flight import GapRecord, TruthLog, fly, laps_of
from camnet.experiments.closed_loop.judge import judge, stretches
from camnet.experiments.closed_loop.plan import Plan, PlanSpace
from camnet.simulation.network import build_network

PROMISES = Path(__file__).parent / "data" / "promises"
WORLDS = Path(__file__).parents[1] / "certification" / "data"


def run(capsys, *words):
    """Run ``camnet falsify --closed-loop``; return the exit status and the report."""
    status = main(["falsify", *map(str, words), "--closed-loop", "--json", "--quiet"])
    return status, json.loads(capsys.readouterr().out)


def log_of(seen, speed=1.0, dt=0.5):
    """Return the truth about one target that drives straight on, seen as the string says (1: in view)."""
    flags = np.array([[c == "1"] for c in seen])
    t = dt * np.arange(len(seen))
    places = np.zeros((len(seen), 1, 3))
    places[:, 0, 0] = speed * t
    return TruthLog(t, flags, places, np.ones(flags.shape, dtype=int))


def test_laps_count_whether_anybody_sees_or_not():
    region = np.array([[-1, 2, 2, -1, 0, 0, -1, 2, -1, 2, 1, 2], [-1] * 12]).T
    assert laps_of(region)[:, 0].tolist() == [1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 3]
    assert laps_of(region)[:, 1].tolist() == [1] * 12


def test_stretches_run_from_the_first_to_the_last_instant_without_a_view():
    found = list(stretches(log_of("0011000100", speed=2.0)))
    assert [(s.from_s, s.time_s, s.length_m) for s in found] == [
        (0.0, 0.5, 1.0),
        (2.0, 1.0, 2.0),
        (4.0, 0.5, 1.0),
    ]
    assert [(s.first, s.open) for s in found] == [(True, False), (False, False), (False, True)]
    assert list(stretches(log_of("1111"))) == []
    assert [s.first and s.open for s in stretches(log_of("0000"))] == [True]


def test_each_way_between_two_regions_has_a_promise_of_its_own():
    regions, seen = ("west", "east", "north"), "1100110001100001"
    place = np.array([[0, -1, -1, -1, 1, 1, 1, -1, -1, 2, -1, -1, -1, -1, -1, 0]]).T
    log = replace(
        log_of(seen), region=place
    )  # 1 s from west to east, 1.5 s from there to north, lost still in east

    def broken(*ways):
        return judge(log, Claims(unseen_max_m=9.0, ways=ways), ("a",), regions).broken

    assert broken(("west", "east", 0.5), ("east", "north", 1.0), ("north", "west", 1.5)) == ()
    assert broken(("west", "east", 0.4)) == ("unseen_way_m",)
    assert broken(("east", "north", 0.9)) == ("unseen_way_m",)
    assert broken(("north", "west", 1.4)) == ("unseen_way_m",)
    assert broken(("east", "west", 0.1)) == ()  # nobody went there
    worst = judge(log, Claims(ways=(("east", "north", 0.8),)), ("a",), regions).worst["unseen_way_m"]
    assert (worst["from"], worst["to"], worst["value"]) == ("east", "north", 1.0)
    ways = Claims(ways=(("east", "north", 0.8),))
    assert Claims.from_dict(json.loads(json.dumps(ways.as_dict()))).ways == ways.ways
    assert ways.scaled(0.5).ways == (("east", "north", 0.4),)


def test_a_promise_is_broken_beyond_its_figures_alone():
    log = log_of("1000001", speed=2.0)
    exact = judge(log, Claims(unseen_max_m=4.0, unseen_max_s=2.0), ("a",))
    assert (exact.broken, exact.share, exact.stretches) == ((), 1.0, 1)
    less = judge(log, Claims(unseen_max_m=4.0, unseen_max_s=1.9), ("a",))
    assert less.broken == ("unseen_s",)
    assert less.worst["unseen_s"]["margin"] == pytest.approx(-0.1)
    before = log_of("00000001")
    assert judge(before, Claims(unseen_max_s=1.0), ("a",)).broken == ("unseen_s",)
    assert judge(before, Claims(unseen_max_s=1.0, into_first_view=False), ("a",)).worst == {}
    rest = judge(log, Claims(unseen_max_s=1.0, after_s=1.0), ("a",))
    assert (rest.broken, rest.worst["unseen_s"]["value"]) == (("unseen_s",), 1.5)
    assert judge(log, Claims(unseen_max_s=1.0, after_s=3.0), ("a",)).worst == {}
    blind = Claims(unseen_max_s=1.0, into_first_view=False, after_s=2.0)
    assert judge(log_of("00000001"), blind, ("a",)).worst["unseen_s"]["value"] == 1.0
    assert judge(log, Claims(unseen_max_s=1.0, after_laps=1), ("a",)).worst == {}


def test_errors_are_judged_by_the_bound_of_the_exit():
    table = {(0, 3): (np.array([0.0, 10.0]), np.array([0.0, 1.0]))}
    bound = ErrorBound(initial_m=0.1, growth_mps=0.5, max_m=2.0, tables=table)
    assert [bound.at(0, 3, 5.0), bound.at(0, 2, 1.0), bound.at(0, 2, 100.0)] == pytest.approx([0.5, 0.6, 2.0])
    log = log_of("111")
    gap = GapRecord(0, 3, 0.0, 5.0, 0.55)
    judged = judge(TruthLog(log.t_s, log.seen, log.p_world, log.lap, [gap]), Claims(error=bound), ("a",))
    assert judged.broken == ("error_m",)
    assert judged.share == pytest.approx(1.1)


@pytest.mark.parametrize("lateral", [0.0, 0.1])
def test_planned_drivers_keep_to_their_class(lateral):
    scenario = load_scenario(
        "patrol", ["run.duration_s=60", f"targets.vehicle.motion.lateral_std_m={lateral}"]
    )
    network = build_network(scenario)
    space, rng = PlanSpace(1, 60.0, 5.0), np.random.default_rng(3)
    lines = network.description.targets[0].motion.network.lines
    for genes in space.random(6, rng):
        plan = space.plan(genes)
        motion = hostile(network, plan).targets[0].motion
        state, dt = motion.reset(rng), 1.0 / 30.0
        speeds, away = [], []
        for k in range(1800):
            before = state
            state = motion.step(state, k * dt, dt, rng)
            speeds.append(np.linalg.norm(state.p_world - before.p_world) / dt)
            x, y, _ = state.p_world
            away.append(
                min(
                    math.hypot(
                        max(abs(x - c(line.x)) - h(line.x), 0.0), max(abs(y - c(line.y)) - h(line.y), 0.0)
                    )
                    for line in lines
                    for c, h in [(centre, half)]
                )
            )
            assert abs(state.w_body[2]) <= motion.w_max_radps + 1e-9
        moving = np.array(speeds)[np.array(speeds) > 0.0]
        assert moving.max() <= 1.2 + 1e-9
        assert moving.min() >= 0.8 * math.cos(0.5 * 1.5 * dt) - 1e-9
        assert (np.array(speeds) == 0.0).sum() * dt <= plan.targets[0].stop_s + 2 * dt
        assert max(away) <= 3.0 * lateral + 1.0  # corners are cut


def centre(values):
    """Return the middle of a road that runs along an axis."""
    return 0.5 * (min(values) + max(values))


def half(values):
    """Return half of its length along that axis."""
    return 0.5 * (max(values) - min(values))


def test_plans_survive_json_and_a_flight_is_repeatable():
    scenario = load_scenario("patrol", ["run.duration_s=20"])
    network = build_network(scenario)
    space = PlanSpace(1, 20.0, 2.0)
    plan = space.plan(space.random(1, np.random.default_rng(0))[0])
    again = Plan.from_dict(json.loads(json.dumps(plan.as_dict())))
    assert again == plan
    one, two = fly(network, plan, None), fly(network, again, None)
    assert np.array_equal(one.p_world, two.p_world)
    assert np.array_equal(one.seen, two.seen)
    with pytest.raises(DataError, match="seed"):
        Plan.from_dict({"targets": [], "wind_rad": 0.0})


@pytest.mark.parametrize("world", ["patrol", "stationary_certified"])
def test_targets_alone_are_seen_as_in_the_whole_loop(world):
    """Fixed cameras: what is judged without estimators is what the closed loop's own truth says."""
    network = build_network(load_scenario(world, ["run.duration_s=40", "controller.rate_hz=30"]))
    space = PlanSpace(1, 40.0)
    plan = space.plan(space.random(2, np.random.default_rng(5))[1])
    alone, whole = fly(network, plan, None), fly(network, plan, "ekf")
    assert len(whole.t_s) == len(alone.t_s)
    assert np.allclose(alone.p_world, whole.p_world, atol=1e-9)
    assert np.array_equal(alone.seen, whole.seen)
    assert 0.1 < alone.seen.mean() < 0.9


@pytest.mark.slow
def test_the_search_is_the_same_on_any_number_of_processes():
    scenario = load_scenario("patrol", ["run.duration_s=60"])
    attack = prepare(scenario, Claims(unseen_max_s=30.0), {})
    one, two = (falsify_closed_loop(attack, 14, 1, jobs=jobs) for jobs in (1, 2))
    assert one == two
    assert one["violations"] == 1
    assert one["attack"]["figures"]["broken"] == ["unseen_s"]


def test_patrol_keeps_its_promise_and_comes_close(capsys, tmp_path):
    out = tmp_path / "attack"
    status, report = run(capsys, "patrol", "--trials", 8, "--duration", 150, "--out", out)
    assert (status, report["violations"]) == (0, 0)
    assert 0.95 < report["closest_fraction"] <= 1.0
    status, again = run(capsys, "patrol", "--replay", out / "attack.json")
    assert (status, again["same"]) == (0, True)
    _, plan, figures = read_attack(out / "attack.json")
    assert again["closest_fraction"] == figures["share"]
    assert Plan.from_dict(again["plan"]) == plan


@pytest.mark.parametrize("change", ["promise=-20%", "speed=-20%", "footprint=-30%"])
def test_one_false_assumption_breaks_the_promise_of_patrol(capsys, change):
    status, report = run(capsys, "patrol", "--trials", 24, "--duration", 150, "--violate", change)
    assert (status, report["violations"] > 0) == (1, True)


@pytest.mark.parametrize("name", ["patrol_model_error", "patrol_off_max"])
def test_old_promises_about_errors_are_broken(capsys, name):
    words = ("--promise", PROMISES / f"{name}.json", "--trials", 6, "--set", "run.estimators=[learned]")
    status, report = run(capsys, "patrol", *words)
    assert (status, report["broken"]) == (1, ["error_m"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["big_regions", "eight"])
def test_old_promises_about_agents_are_broken(capsys, name):
    words = ("--promise", PROMISES / f"{name}.json", "--time-limit", 600, "--duration", 150)
    status, report = run(capsys, WORLDS / f"{name}.yaml", *words)
    assert (status, report["broken"]) == (1, ["unseen_s"])


def test_what_makes_no_sense_is_refused(capsys, tmp_path):
    patrol = load_scenario("patrol")
    with pytest.raises(CertificateError, match="promises nothing"):
        prepare(patrol, Claims(), {})
    with pytest.raises(ConfigError, match="--targets 2"):
        prepare(patrol, Claims(unseen_max_s=1.0, targets_at_once=1), {}, targets=2)
    with pytest.raises(ConfigError, match="no agent flies"):
        violated(patrol, {"wind": 2.0})
    with pytest.raises(ConfigError, match="states no wind"):
        violated(load_scenario("quickstart"), {"wind": 2.0})
    for text in ("speed", "speed=fast", "speed=+0%", "wind=x0", "mass=+2%"):
        with pytest.raises(ValueError, match=r"give speed|factor"):
            parse_violation(text)
    assert main(["falsify", "patrol", "--violate", "speed=+20%", "--quiet"]) == 2
    assert "--closed-loop" in capsys.readouterr().err
    wrong = tmp_path / "promise.json"
    wrong.write_text('{"unseen_max_s": -1}')
    with pytest.raises(DataError, match="unseen_max_s = -1"):
        read_claims(wrong)
    wrong.write_text('{"unseen": 1}')
    with pytest.raises(DataError, match="unseen_max_m"):
        read_claims(wrong)


def test_certificates_of_earlier_versions_are_promises_too():
    claims, world = read_claims(PROMISES / "big_regions.json")
    assert (world, claims.unseen_max_s, claims.unseen_max_m) == ("big_regions", 15.0, None)
    assert claims.into_first_view is False


def test_more_targets_are_copies_and_violations_change_the_world_flown():
    patrol = load_scenario("patrol")
    assert [t.name for t in with_targets(patrol, 3).targets] == ["vehicle", "vehicle_2", "vehicle_3"]
    faster = violated(patrol, {"speed": 1.2}).targets[0]
    assert faster.motion.speed_mps == (0.8, pytest.approx(1.44))
    assert violated(patrol, {"footprint": 0.7}).cameras[0].intrinsics.fx_px == pytest.approx(500.0 / 0.7)
    attack = prepare(patrol, Claims(unseen_max_s=10.0), {"promise": 0.8})
    assert attack.claims.unseen_max_s == pytest.approx(8.0)
    assert replay(attack, PlanSpace(1, 300.0).plan(np.full(25, 0.5))).broken == ("unseen_s",)

"""Second experiment of parikh2018 (VII-B): one quadrotor, two robots on a road network, random turns, one stack.

The world is the simulator's; the rows run side by side on the same measurements, and `learned` (both robots' estimators
share one memory) steers the quadrotor. Errors are root mean squares after the first 300 s, in which one robot is
followed. The paper shows plots alone (its Figures 13 to 16), no figures to compare with.

What cannot be predicted is which way a robot takes at a junction that nobody watches. Errors while unseen are
therefore given a second time over the instants before the robot has passed a junction unseen
(`position_rmse_unseen_same_road_m`): there its motion is a function of its pose, as the theory asks.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.learning_estimator import LearningEstimator, shared_memories
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EstimatorSettings
from camnet.experiments.motion_learning import interval
from camnet.experiments.motion_learning_published import PUBLISHED_SETTINGS
from camnet.experiments.road_network_policy import NearestIntersection
from camnet.experiments.road_network_scene import ROADS, RoadSceneSettings, lane_basis, road_scenario
from camnet.experiments.road_network_score import RoadTrace, conduct, passed_unseen, score
from camnet.geometry.frustum import Frustum
from camnet.geometry.road_graph import RoadGraph
from camnet.geometry.rotations import gaze_angles
from camnet.processes import Workers
from camnet.report.experiments import write_road_map, write_states
from camnet.simulation.filters import TargetTruth
from camnet.simulation.loop import FilterMaker, NetworkSimulation, Setpoints
from camnet.simulation.network import Network, build_network
from camnet.types import Array
from camnet.world.protocol import Flown
from camnet.world.pybullet import PyBulletWorld

__all__ = ["EXPERIMENT", "ROWS", "assemble", "print_table", "run"]

EXPERIMENT = "road-network"
ROWS = ("learned", "learned_published", "ideal", "ekf", "ukf")


def _row(settings: EstimatorSettings, shared: bool) -> FilterMaker:
    """Make a learning row on the published kernels, with one memory for both robots or private ones."""

    def make(network: Network, truths: Sequence[TargetTruth]) -> list[TargetFilter]:
        basis, rate = lane_basis(), network.scenario.sensing.rate_hz
        common = shared_memories(settings, basis, 1, rate) if shared else None
        roads = network.scenario.roads
        return [
            LearningEstimator(settings, basis, 1, rate, network.bounds, "learned", common, roads)
            for _ in truths
        ]

    return make


def row_makers(scene: RoadSceneSettings) -> dict[str, FilterMaker]:
    """Rows beside the named ones; those not in `ROWS` are for `record` alone: private memories, other priors, pace."""
    ours = scene.estimator

    def changed(**gap: Any) -> EstimatorSettings:  # noqa: ANN401 - fields of GapSettings
        return ours.model_copy(update={"gap": ours.gap.model_copy(update=gap)})

    stack = PUBLISHED_SETTINGS.stack.model_copy(update={"size": 2000, "rule": "d_optimal"})
    return {
        "learned": _row(ours, True),
        "learned_turn": _row(changed(prior="constant_turn"), True),
        "learned_private": _row(ours, False),
        "learned_pace": _row(changed(pace=True), True),
        "learned_published": _row(PUBLISHED_SETTINGS.model_copy(update={"stack": stack}), True),
    }


class _NoStatistics:
    """Counts nothing: this experiment keeps its own record."""

    def after_control(self, simulation: NetworkSimulation) -> None:
        """See ``RunStatistics.after_control``."""

    def after_flight(self, simulation: NetworkSimulation, flown: Flown) -> None:
        """See ``RunStatistics.after_flight``."""

    def after_sense(self, simulation: NetworkSimulation) -> None:
        """See ``RunStatistics.after_sense``."""


def record(
    scene: RoadSceneSettings,
    seed: int,
    rows: Sequence[str] = ROWS,
    progress: Callable[[float], None] | None = None,
) -> RoadTrace:
    """Fly one run."""
    network = build_network(road_scenario(scene))
    simulation = NetworkSimulation(network, PyBulletWorld(network.description), rows, seed, row_makers(scene))
    simulation.statistics = _NoStatistics()  # type: ignore[assignment]
    roads = network.scenario.roads
    graph = RoadGraph.from_settings(roads)
    speed = float(np.mean(scene.speed_mps))
    policy = NearestIntersection(roads, scene.follow_one_s, speed, network.n_targets)
    frustum, dt = Frustum.from_camera(network.cameras[0]), 1.0 / scene.decision_hz
    steps = round(scene.duration_s * scene.decision_hz)
    kept: list[tuple[Any, ...]] = []
    try:
        for k in range(steps):
            now = simulation.snapshot
            view = frustum.in_world(now.camera_p_world[0], now.camera_q_world[0])
            estimates = [f.estimate for f in simulation.driving]
            place = policy.decide(now.t_s, dt, estimates, view, now.camera_p_world[0])
            simulation.advance(_above(place, now.camera_p_world[0], scene.camera_height_m))
            kept.append(_sample(simulation, graph, policy))
            if progress is not None and k % 50 == 0:
                progress(k / steps)
    finally:
        simulation.world.close()
    return _trace(kept, rows)


def _above(place: Array, camera_p: Array, height_m: float) -> Setpoints:
    """Fly above ``place`` (3,), look at it."""
    wanted = np.array([place[0], place[1], height_m])
    pan, tilt = gaze_angles(place - camera_p)
    gaze = np.clip(np.array([float(pan), float(tilt)]), -0.5, 0.5)
    return Setpoints(wanted[None], gaze[None])


def _sample(simulation: NetworkSimulation, graph: RoadGraph, policy: NearestIntersection) -> tuple[Any, ...]:
    now = simulation.snapshot
    robots = range(len(simulation.driving))
    rows = [[f.estimate for f in simulation.filters[name]] for name in simulation.filter_names]
    return (
        now.t_s,
        now.target_p_world,
        now.target_q_world,
        simulation.visible.any(axis=0),
        [graph.locate(now.target_p_world[m, :2])[0] for m in robots],
        [[e.p_world for e in row] for row in rows],
        [[e.q_world for e in row] for row in rows],
        now.camera_p_world[0],
        policy.followed,
        [policy.lost(m) for m in robots],
    )


def _trace(kept: list[tuple[Any, ...]], rows: Sequence[str]) -> RoadTrace:
    t, p, q, seen, road, rows_p, rows_q, camera, followed, lost = (
        np.array(c) for c in zip(*kept, strict=True)
    )
    estimates = {name: (rows_p[:, i], rows_q[:, i]) for i, name in enumerate(rows)}
    return RoadTrace(t, p, q, seen.astype(bool), road, estimates, camera, followed, lost.astype(bool))


NOTES = {
    "scored_from_s": "after the first 300 s, in which one robot is followed (camnet.experiments.road_network_scene)",
    "learned": "our settings; both robots' estimators share one memory; steers the quadrotor",
    "learned_published": (
        "published gains, kernels, form and stack (2000, shared), no remedies; windows of 0.1 s one after another, "
        "D-optimal choice, where the paper's rule chooses by an eigenvalue below rounding"
    ),
    "same_road": (
        "instants before the robot has passed a junction unseen; beyond it the way taken is a draw that nobody can know"
    ),
}
WORKERS = 2


def run(
    seeds: int = 5,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    scene: RoadSceneSettings | None = None,
    workers: int = WORKERS,
) -> dict[str, Any]:
    """Run the experiment for ``seeds`` seeds from ``seed`` on; with ``out_dir`` also draw the first one's figures.

    Raises
    ------
    ConfigError
        If ``seeds`` is not positive.
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of runs; give at least 1")
    scene = scene or RoadSceneSettings()
    folder = None if out_dir is None else Path(out_dir)
    return assemble(_run_all(range(seed, seed + seeds), scene, folder, progress, workers))


def assemble(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Means and confidence intervals over the seeds."""
    rows = {
        name: {key: interval([r["rows"][name][key] for r in results]) for key in results[0]["rows"][name]}
        for name in ROWS
    }
    policy = {key: interval([r["policy"][key] for r in results]) for key in results[0]["policy"]}
    return {
        "experiment": EXPERIMENT,
        "seeds": len(results),
        "rows": rows,
        "published": {},
        "policy": policy,
        "ratio_to_ekf": {f"target_{m}": _ratio(rows, f"position_rmse_unseen_target_{m}_m") for m in (1, 2)},
        "notes": NOTES,
        "runs": list(results),
    }


def _ratio(rows: Mapping[str, Any], key: str) -> float | None:
    learned, ekf = (rows[name][key]["mean"] for name in ("learned", "ekf"))
    return float(learned / ekf) if ekf > 0.0 else None


def _run_all(
    numbers: Sequence[int],
    scene: RoadSceneSettings,
    folder: Path | None,
    progress: Callable[[float], None] | None,
    workers: int,
) -> list[dict[str, Any]]:
    """Results in the order of ``numbers``, in ``workers`` processes; each seed has generators of its own."""
    jobs = [(number, scene, folder if number == numbers[0] else None) for number in numbers]
    if workers == 1 or len(jobs) == 1:
        results = []
        for i, job in enumerate(jobs):
            results.append(
                _job(*job, None if progress is None else lambda x, i=i: progress((i + x) / len(jobs)))  # type: ignore[misc]
            )
        return results
    found: dict[int, dict[str, Any]] = {}
    with Workers(workers) as pool:
        for k, result in pool.finished(_packed_job, jobs):
            found[k] = result
            if progress is not None:
                progress(len(found) / len(jobs))
    return [found[k] for k in range(len(jobs))]


def _packed_job(job: tuple[int, RoadSceneSettings, Path | None]) -> dict[str, Any]:
    return _job(*job)


def _job(
    number: int,
    scene: RoadSceneSettings,
    folder: Path | None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Fly and score one seed; with a folder also draw it."""
    trace = record(scene, number, progress=progress)
    if folder is not None:
        _draw(trace, scene, folder)
    return {
        "seed": number,
        "rows": {name: score(trace, name, scene.follow_one_s) for name in ROWS},
        "policy": conduct(trace, scene.follow_one_s),
    }


def _draw(trace: RoadTrace, scene: RoadSceneSettings, folder: Path) -> None:
    """Write the map, and of each robot the figures that correspond to the paper's 13 to 16."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = ("learned", "learned_published", "ekf")
    for m in range(trace.seen.shape[1]):
        poses: dict[str, Array] = {
            "t_s": trace.t_s,
            "seen": trace.seen[:, m].astype(float),
            "truth.p_world": trace.p_world[:, m],
            "truth.q_world": trace.q_world[:, m],
        }
        for name in shown:
            p, q = trace.estimates[name]
            poses |= {f"{name}.p_world": p[:, m], f"{name}.q_world": q[:, m]}
        write_states(
            poses,
            folder / f"robot_{m + 1}_states.png",
            folder / f"robot_{m + 1}_errors.png",
            scene.follow_one_s,
        )
    late = trace.t_s >= scene.follow_one_s
    learned = trace.estimates["learned"][0][late]
    write_road_map(
        [np.array(road.points_m) for road in ROADS],
        trace.p_world[late],
        learned,
        trace.seen[late],
        passed_unseen(trace)[late],
        trace.camera_p[late],
        folder / "map.png",
    )


def print_table(result: dict[str, Any]) -> None:
    """Print rows and what the policy did."""
    head = f"{'robot 1':>26s} {'robot 2':>26s} {'same road':>10s} {'orientation (deg)':>18s}"
    _say(f"{'unseen position RMSE (m)':24s} {head}")
    for name, row in result["rows"].items():
        cells = [_with_interval(row[f"position_rmse_unseen_target_{m}_m"]) for m in (1, 2)]
        same, turn = (
            row[k]["mean"] for k in ("position_rmse_unseen_same_road_m", "orientation_rmse_unseen_deg")
        )
        _say(f"{name:24s} {cells[0]:>26s} {cells[1]:>26s} {same:10.3f} {turn:18.1f}")
    policy = {key: value["mean"] for key, value in result["policy"].items()}
    _say(
        f"unseen {policy['unseen_share']:.0%} of the time, {policy['gaps']:.0f} gaps of "
        f"{policy['gap_mean_s']:.1f} s (longest {policy['gap_longest_s']:.0f} s); "
        f"{policy['turned_unseen_share_of_unseen']:.0%} of the unseen time came after a turn that nobody saw"
    )
    ratio = result["ratio_to_ekf"]
    shown = ["-" if value is None else f"{value:.2f}" for value in ratio.values()]
    _say(f"learned / EKF: robot 1 {shown[0]}, robot 2 {shown[1]}; {result['seeds']} seeds")


def _with_interval(entry: dict[str, Any]) -> str:
    low, high = entry["ci95"]
    return f"{entry['mean']:.3f} [{low:.3f}, {high:.3f}]"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")

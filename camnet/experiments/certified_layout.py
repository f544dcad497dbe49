"""A layout of fixed cameras that ``learned`` certifies, confirmed by closed-loop runs, and lost when a camera is moved.

1. The motion of the robot of ``stationary_certified`` is learned in simulation, and its network certified with it.
2. In every run the estimator learns anew, with its own noise and its own start on the road. From the second lap on, a
   target is *lost* if it stays out of view for longer than allowed, or if the prediction is further off at its
   re-sighting than the largest ball in that view; further off than the tube of its exit is a violation.
3. With camera ``north`` moved 2.4 m outward the network is not certified, and hostile targets are lost.
4. Split conformal e_v: half of the runs calibrate the drift of the prediction in a gap, the others must keep to it with
   the stated confidence; the count has to lie in its (beta-)binomial 99 % interval.

``run_mobile`` does the same with four quadrotors, ``mobile_certified``, on the rigid-body engine: a target is lost too
if it is not in its agent's view in time. There the region ``north`` is moved 2.7 m outward, off the road.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import betabinom

from camnet.certification.growth import Tube, conformal_model_error, error_tube
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.experiments.certify_flow import FlowCase, flow_case
from camnet.experiments.certify_world import certify_world
from camnet.experiments.falsify import falsify_world
from camnet.experiments.kinematic_world import KinematicWorld
from camnet.experiments.learned_model import LearnedModel, learn_model
from camnet.report.certificate import write_certificate
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import build_network
from camnet.simulation.run import decide, setpoints_for
from camnet.types import Array
from camnet.world.protocol import World
from camnet.world.pybullet import PyBulletWorld

__all__ = ["MOBILE", "MOVED", "STATIONARY", "Layout", "confirm", "print_table", "run", "run_mobile"]

#: the move that takes the certificate away: camera "north" 2.4 m outward
MOVED = "fixed_cameras.north.pose.position_m=[0, 6.6, 3.4]"


@dataclass(frozen=True)
class Layout:
    """A world, settings for its runs, and the changes that take its certificate away."""

    world: str
    settings: tuple[str, ...]
    moved: tuple[str, ...]


# control has nothing to steer in the first: at the sensors' rate it costs half as much
STATIONARY = Layout("stationary_certified", ("controller.rate_hz=30",), (MOVED,))
MOBILE = Layout(
    "mobile_certified",
    (),
    (
        "regions.north.shape.min_m=[-2.0, 4.9, 0.0]",
        "regions.north.shape.max_m=[2.0, 8.9, 3.8]",
        "agents.camera_1.start_m=[0.0, 6.9, 2.5]",
    ),
)
CONFIDENCE = 0.9
#: length of a run: a little more than two laps, s
_RUN_S = 145.0
_TRIALS = 2000


def run(
    *,
    seeds: int = 100,
    out_dir: Path | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Certify the layout of fixed cameras, confirm it in ``seeds`` runs, move a camera."""
    return _run(STATIONARY, seeds, out_dir, seed, progress)


def run_mobile(
    *,
    seeds: int = 30,
    out_dir: Path | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Certify the layout of quadrotors, confirm it in ``seeds`` runs, move a region."""
    return _run(MOBILE, seeds, out_dir, seed, progress)


def _run(
    layout: Layout, seeds: int, out_dir: Path | None, seed: int, progress: Callable[[float], None] | None
) -> dict[str, Any]:
    def report(share: float) -> None:
        if progress is not None:
            progress(share)

    scenario, elsewhere = _load(layout), _load(layout, *layout.moved)
    model = learn_model(scenario, scenario.run.duration_s, seed)
    report(0.1)
    certified = certify_world(scenario, model)
    moved = certify_world(elsewhere, model, find_largest=False)
    if out_dir is not None:
        for name, part in (("certified", certified), ("moved", moved)):
            (out_dir / name).mkdir(parents=True, exist_ok=True)
            write_certificate(out_dir / name, part.report, part.views, part.lines)
        model.save(out_dir / "model.npz")
    attack = falsify_world(elsewhere, _TRIALS, seed, model)
    held = falsify_world(scenario, _TRIALS, seed, model)
    report(0.2)
    runs = confirm(scenario, model, seeds, seed, lambda share: report(0.2 + 0.8 * share))
    return {
        "world": layout.world,
        "certified": _summary(certified.report),
        "falsified": {k: held[k] for k in ("trials", "violations", "closest_fraction", "lost")},
        "runs": runs,
        "moved": {
            "change": " ".join(layout.moved),
            **_summary(moved.report),
            "uncertified": moved.report["uncertified"],
            "falsifier": {k: attack[k] for k in ("trials", "violations", "lost")},
        },
    }


def _load(layout: Layout, *overrides: str) -> Scenario:
    scenario = load_scenario(layout.world, (*overrides, *layout.settings))
    if not isinstance(scenario, Scenario):
        raise ConfigError(f"{layout.world}: a network was expected")
    return scenario


def _summary(report: dict[str, Any]) -> dict[str, Any]:
    keys = ("margin_m", "margin_s", "seen_again_s", "largest_model_error_mps", "trust_horizon_s")
    return {
        "verdict": report["certificates"]["learned"]["verdict"],
        "model_error_mps": report["constants"]["model_error_mps"],
        "transitions": [
            {"from": t["from"], "to": t["to"], "verdict": t["learned"]["verdict"]}
            | {k: t["learned"].get(k) for k in keys}
            for t in report["transitions"]
            if "learned" in t
        ],
    }


def confirm(
    scenario: Scenario, model: LearnedModel, runs: int, seed: int, progress: Callable[[float], None]
) -> dict[str, Any]:
    """Run the closed loop ``runs`` times and compare every gap after the first lap with the certificate."""
    case = flow_case(build_network(scenario), model)
    tubes = _tubes(case, model)
    lost = violations = count = 0
    closest = 0.0
    drift = []
    for k in range(runs):
        gaps = _gaps_of_run(scenario, seed + 1000 + k)
        later = gaps[len(case.ground) :]
        for source, sink, duration, error in later.tolist():
            tube = tubes[int(source)]
            share = error / float(np.interp(duration, tube.t_s, tube.radius_m))
            count, closest = count + 1, max(closest, share)
            violations += share > 1.0
            lost += duration > case.off_max_s or error > case.ground[int(sink)].radius_m
        drift.append(later[0, 3] / later[0, 2] if len(later) else np.inf)
        lost += len(later) == 0
        progress((k + 1) / runs)
    return {
        "runs": runs,
        "gaps": count,
        "lost": int(lost),
        "violations": int(violations),
        "closest_fraction": closest,
        "statistical": _coverage(np.array(drift)),
    }


def _tubes(case: FlowCase, model: LearnedModel) -> dict[int, Tube]:
    """Return the tube of each view's exit, from where the robot was last seen."""
    tubes = {}
    for source, _, lost_s, _, _ in model.gaps[-len(case.ground) :].tolist():
        k = int(np.argmin(np.abs(model.path[:, 0] - lost_s)))
        target = case.target
        tubes[int(source)] = error_tube(
            case.fields[int(source)],
            model.path[k, 1:3],
            target.e0_m + target.spread_m,
            target.model_error_mps,
            target.v_max_mps,
            case.off_max_s,
            case.step_s,
            tolerance=1e-2,
            max_cells=600,
        )
    return tubes


def _gaps_of_run(scenario: Scenario, seed: int) -> Array:
    """Return camera before and after, duration (s) and error of the prediction (m) of every gap of one run, (g, 4)."""
    start = scenario.targets[0].model_copy(update={"start_m": None, "start_heading_rad": None})
    network = build_network(scenario.model_copy(update={"targets": (start,)}))
    flies = network.n_agents > 0
    world: World = PyBulletWorld(network.description) if flies else KinematicWorld(network.description)
    simulation = NetworkSimulation(network, world, ("learned",), seed)
    for _ in range(round(_RUN_S * scenario.run.decision_hz)):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
    world.close()
    rows = [
        (g.from_camera, g.to_camera, g.seen_s - g.lost_s, g.error_m["learned"])
        for g in simulation.gaps[0].gaps
    ]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _coverage(drift: Array) -> dict[str, Any]:
    """Calibrate the drift of the prediction on half of the runs and count how many of the others keep to it."""
    half = len(drift) // 2
    limit = conformal_model_error(drift[:half], CONFIDENCE)
    test = drift[half:]
    kept = int((test <= limit).sum())
    rank = min(math.ceil((half + 1) * CONFIDENCE - 1e-12), half)
    # the level is calibrated on a finite sample: the count is binomial with a beta-distributed probability
    low, high = (
        betabinom.interval(0.99, len(test), max(rank, 1), half + 1 - max(rank, 1)) if half else (0.0, 0.0)
    )
    return {
        "confidence": CONFIDENCE,
        "model_error_mps": float(limit) if np.isfinite(limit) else None,
        "runs": len(test),
        "kept": kept,
        "interval": [float(low), float(high)],
        "inside": bool(low <= kept <= high),
    }


def print_table(result: dict[str, Any]) -> None:
    """Print what was found."""
    certified, runs, moved = result["certified"], result["runs"], result["moved"]
    _say(f"{result['world']}: learned {certified['verdict']}, e_v = {certified['model_error_mps']:.4f} m/s")
    for t in certified["transitions"]:
        largest = t["largest_model_error_mps"]
        words = "-" if largest is None else f"{largest:.3f} m/s"
        margins = f"margin {t['margin_m']:.2f} m, {t['margin_s']:.1f} s"
        _say(f"  {t['from']:>6s} > {t['to']:6s} {margins}, largest e_v {words}")
    _say(
        f"{runs['runs']} runs, {runs['gaps']} gaps after the first lap: {runs['lost']} targets lost, "
        f"{runs['violations']} beyond the bound, closest {runs['closest_fraction']:.3f}"
    )
    s = runs["statistical"]
    _say(
        f"statistical e_v at {s['confidence']:.0%}: {s['kept']} of {s['runs']} runs keep to it, interval from "
        f"{s['interval'][0]:.1f} to {s['interval'][1]:.0f}: {'inside' if s['inside'] else 'OUTSIDE'}"
    )
    held = result["falsified"]
    _say(
        f"hostile targets: {held['violations']['learned']} violations of {held['trials']}, "
        f"closest {held['closest_fraction']['learned']:.3f}"
    )
    _say(
        f"moved ({moved['change']}): {moved['verdict']}; the falsifier loses {moved['falsifier']['lost']} of "
        f"{moved['falsifier']['trials']} targets"
    )


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")

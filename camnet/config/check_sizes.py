"""Sizes that settings only imply: rows, steps, samples and matrices, refused before any memory is taken.

Each is computed from the settings alone, in the same way as where it is used, and compared with a limit that no
sensible run comes near. Counts that one setting states have their limits in the settings' own types.
"""

from __future__ import annotations

from collections.abc import Iterator

from camnet.config.diagnose import Problem, show
from camnet.config.models import Scenario
from camnet.config.yaml_nodes import FieldPath

__all__ = ["size_problems"]

#: steps of one prediction
_MOST_ROLLOUT = 10_000
#: steps of the physics in one run: some hours of computing
_MOST_PHYSICS = 1_000_000_000
#: numbers in a log, eight bytes each
_MOST_LOGGED = 100_000_000
#: measurements that are on their way, or in a window
_MOST_SAMPLES = 100_000
#: pixels of an image
_MOST_PIXELS = 100_000_000
#: bytes of all history stacks and their matrices
_MOST_LEARNING = 8_000_000_000
#: fixes that a traffic simulation makes for one vehicle
_MOST_TRAFFIC = 1_000_000


def size_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield a problem for every implied size beyond its limit."""
    run, handoff, rate = scenario.run, scenario.handoff, scenario.sensing.rate_hz
    estimator, gap = scenario.estimator, scenario.estimator.gap
    sizes: list[tuple[FieldPath, float, str, float, int]] = [
        (("handoff", "rollout_dt_s"), handoff.rollout_dt_s, "handoff.lookahead_s / handoff.rollout_dt_s steps",
         handoff.lookahead_s / handoff.rollout_dt_s, _MOST_ROLLOUT),
        (("run", "duration_s"), run.duration_s, "run.duration_s * physics.step_hz steps",
         run.duration_s * scenario.physics.step_hz, _MOST_PHYSICS),
        (("run", "duration_s"), run.duration_s, "run.duration_s * run.log_hz rows of the log, in numbers,",
         run.duration_s * run.log_hz * _log_columns(scenario), _MOST_LOGGED),
        (("sensing", "latency_s"), scenario.sensing.latency_s, "sensing.latency_s * sensing.rate_hz measurements",
         scenario.sensing.latency_s * rate, _MOST_SAMPLES),
        (("estimator", "stack", "window_s"), estimator.stack.window_s, "window_s * sensing.rate_hz samples",
         estimator.stack.window_s * rate, _MOST_SAMPLES),
        (("estimator", "gap", "max_gap_s"), gap.max_gap_s, "max_gap_s * sensing.rate_hz samples",
         gap.max_gap_s * rate, _MOST_SAMPLES),
        (("estimator", "stack", "size"), estimator.stack.size, "bytes of the history stacks",
         _learning_bytes(scenario), _MOST_LEARNING),
    ]  # fmt: skip
    for i, camera in enumerate(scenario.cameras):
        inside = camera.intrinsics
        pixels = inside.width_px * inside.height_px
        sizes.append(
            (("cameras", i, "intrinsics", "width_px"), inside.width_px, "pixels", pixels, _MOST_PIXELS)
        )
    if scenario.traffic is not None:
        traffic = scenario.traffic
        steps = (traffic.warm_up_s + traffic.duration_s) / traffic.step_s
        words = "(traffic.warm_up_s + traffic.duration_s) / traffic.step_s steps"
        sizes.append((("traffic", "step_s"), traffic.step_s, words, steps, _MOST_TRAFFIC))
    for path, value, words, size, limit in sizes:
        if size > limit:
            yield Problem(path, show(value), f"too much: {size:.4g} {words}; at most {limit:,} are possible")


def _log_columns(scenario: Scenario) -> int:
    """Return the columns of the log, as `camnet.simulation.log_columns` names them."""
    uncertain = sum(a.pose.may_be_lost or a.exit_budget_s > 0.0 for a in scenario.agents)
    targets = len(scenario.targets) * (16 + 11 * len(scenario.run.estimators))
    unsized = sum(t.assumed_size is not None for t in scenario.targets)
    if scenario.run.instruments:
        targets += 8 * len(scenario.targets)
    return 1 + targets + 24 * len(scenario.agents) + 7 * uncertain + 2 * unsized


def _learning_bytes(scenario: Scenario) -> float:
    """Return what the learning estimators keep: a stack of regressors and three matrices a model."""
    kernels, size = scenario.estimator.basis.max_kernels, scenario.estimator.stack.size
    models = 1 if scenario.estimator.share else len(scenario.regions) + len(scenario.fixed_cameras)
    learning = sum(name in ("learned", "printed") for name in scenario.run.estimators) * len(scenario.targets)
    learning += "learned_shared" in scenario.run.estimators
    return 8.0 * learning * models * (size * kernels + 3 * kernels**2)

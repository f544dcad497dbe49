"""Speed of the handoff environment on both back ends, beside bare PyBullet and beside other environments.

All cases run by turns in one process. CPU time is counted as well as wall-clock time, so that other work on the machine
disturbs little. What is compiled is compiled before, and its time given apart. One environment-step is one decision of
all agents, 0.1 s of simulated time in ``quickstart``; the time of the policy is in it on PyBullet alone. Peers are
measured where they are installed.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camnet.batch.frozen_model import FrozenModel, warm_up
from camnet.env.batch_handoff import BatchHandoff
from camnet.experiments.bench_simulation import measure_environment

__all__ = ["follow", "run"]

_WORLD = "quickstart"
#: turns of every case of the batch back end, and of every size
_ROUNDS, _SIZE_ROUNDS = 15, 5
#: cases of the batch back end: estimator, environments, steps of warm-up (estimators learn) and measured
_BATCH = {"frozen": ("frozen", 1024, 50, 20), "learning": ("learned", 128, 150, 20)}
#: sizes for the growth of the cost, and environment-steps measured at each
_SIZES, _SCALED_STEPS = (64, 256, 1024, 4096), 20_000


def follow(env: BatchHandoff, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Actions (E, N, 5): stay above the first target's estimate while it is inside, else in the middle; look down."""
    where = env.layout.slices
    inside = observations[:, :, where["target_0.inside"]] > 0
    actions = np.zeros((*observations.shape[:2], 5), dtype=np.float32)
    actions[:, :, :2] = np.where(inside, observations[:, :, where["target_0.position"]][..., :2], 0.0)
    actions[:, :, 2] = 0.5
    return np.clip(actions, -1.0, 1.0)


def _batch_seconds(env: BatchHandoff, observations: NDArray[np.float32], steps: int) -> tuple[float, float]:
    """CPU and wall-clock time of so many steps, without the policy's."""
    cpu = wall = 0.0
    for _ in range(steps):
        actions = follow(env, observations)
        start = time.process_time(), time.perf_counter()
        observations = env.step(actions).observations
        cpu, wall = cpu + time.process_time() - start[0], wall + time.perf_counter() - start[1]
    return cpu, wall


def _open_batch(
    filter_name: str, environments: int, warm_steps: int, seed: int, threads: int, held: FrozenModel
) -> BatchHandoff:
    model = held if filter_name == "frozen" else None
    env = BatchHandoff(
        _WORLD, environments, filter_name=filter_name, model=model, threads=threads, max_cycles=3000
    )
    observations = env.reset(seed=seed)
    for _ in range(warm_steps):
        observations = env.step(follow(env, observations)).observations
    return env


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Measure.

    Returns
    -------
    dict
        ``backend``: ``pybullet`` as in `camnet.experiments.bench_simulation.measure_environment`; ``batch`` with
        ``env_steps_per_s`` (wall clock, the held model, all threads), ``batch`` (environments), ``threads``, then
        ``frozen`` and ``learning`` apart, each on one thread and on all (medians over turns, the quartiles beside them;
        CPU time as median and least), and ``scaling``: CPU time of an environment-step and memory of an environment
        against the number of environments. ``peers``: steps/s of one core.
    """
    report = progress if progress is not None else _silent
    held = warm_up(BatchHandoff(_WORLD, 1, filter_name="ekf").network)
    pybullet = measure_environment(seed)
    report(0.3)
    compiled = {name: _first_call(case[0], seed, held) for name, case in _BATCH.items()}
    report(0.5)
    batch = _measure_batches(seed, held)
    report(0.8)
    scaling = [_scaled(environments, seed, held) for environments in _SIZES]
    report(0.9)
    peers = _measure_peers(seed)
    report(1.0)
    main = {key: batch["frozen"]["all_threads"][key] for key in ("env_steps_per_s", "batch", "threads")}
    return {
        "world": _WORLD,
        "backend": {
            "pybullet": pybullet,
            "batch": {**main, **batch, "scaling": scaling, "first_call_cpu_s": compiled},
        },
        "peers": peers,
    }


def _silent(share: float) -> None:
    """Tell nobody."""


def _first_call(filter_name: str, seed: int, held: FrozenModel) -> float:
    """CPU time until an environment has made its first step: compiling, or loading what is compiled already; s."""
    start = time.process_time()
    _open_batch(filter_name, 1, 1, seed, 1, held).close()
    return time.process_time() - start


def _measure_batches(seed: int, held: FrozenModel) -> dict[str, dict[str, Any]]:
    """All cases by turns, each on one thread and on as many as there are processors."""
    processors = len(os.sched_getaffinity(0))
    cases = {
        (name, label): (*case, threads)
        for name, case in _BATCH.items()
        for label, threads in (("one_thread", 1), ("all_threads", processors))
    }
    envs = {key: _open_batch(*case[:3], seed, case[4], held) for key, case in cases.items()}
    rounds: dict[tuple[str, str], list[tuple[float, float]]] = {key: [] for key in cases}
    for _ in range(_ROUNDS):
        for key, env in envs.items():
            rounds[key].append(_batch_seconds(env, env.simulation.observations.copy(), cases[key][3]))
    result: dict[str, dict[str, Any]] = {name: {} for name in _BATCH}
    for (name, label), spent in rounds.items():
        env, total = envs[name, label], cases[name, label][1] * cases[name, label][3]
        cpu_s = statistics.median(cpu for cpu, _ in spent)
        slow, middle, fast = (total / wall for wall in np.quantile([w for _, w in spent], [0.75, 0.5, 0.25]))
        result[name][label] = {
            "env_steps_per_s": middle,
            "env_steps_per_s_quartiles": [slow, fast],
            "env_steps_per_cpu_s": total / cpu_s,
            "cpu_us_per_env_step": 1e6 * cpu_s / total,
            "least_cpu_us_per_env_step": 1e6 * min(cpu for cpu, _ in spent) / total,
            "batch": env.environments,
            "threads": env.simulation.threads,
        }
        env.close()
    return result


def _bytes_of(group: Any) -> int:  # noqa: ANN401 - a group of `BatchSimulation`
    """Bytes of the arrays that have rows of their own for each of a group's environments."""
    arrays = [a for a in (*group.state, *group.estimators.rows) if isinstance(a, np.ndarray)]
    return sum(a.nbytes for a in arrays if a.shape[0] % group.count == 0)


def _scaled(environments: int, seed: int, held: FrozenModel) -> dict[str, float]:
    """Cost of the held model with so many environments, on one thread."""
    env = _open_batch("frozen", environments, 5, seed, 1, held)
    steps = max(3, _SCALED_STEPS // environments)
    rounds = [_batch_seconds(env, env.simulation.observations.copy(), steps)[0] for _ in range(_SIZE_ROUNDS)]
    own = sum(_bytes_of(group) for group in env.simulation.groups)
    start = time.process_time()
    env.reset(seed=seed)
    again = time.process_time() - start
    env.close()
    return {
        "batch": environments,
        "cpu_us_per_env_step": 1e6 * statistics.median(rounds) / (steps * environments),
        "kib_per_env": own / 1024 / environments,
        "cpu_us_per_reset": 1e6 * again / environments,
    }


def _timed(step: Callable[[], None], steps: int) -> float:
    """Return steps a second of CPU time."""
    step()
    start = time.process_time()
    for _ in range(steps):
        step()
    return steps / (time.process_time() - start)


def _parallel_env(module: str, seed: int, steps: int) -> float | None:
    """Return steps a second of a PettingZoo environment under random actions; None where it is not installed."""
    try:
        if importlib.util.find_spec(module) is None:
            return None
        env: Any = importlib.import_module(module).parallel_env()
    except ImportError:
        return None
    env.reset(seed=seed)

    def step() -> None:
        if not env.agents:
            env.reset()
        env.step({agent: env.action_space(agent).sample() for agent in env.agents})

    rate = _timed(step, steps)
    env.close()
    return rate


def _velocity_aviary(seed: int) -> float | None:
    """Return environment-steps a second of four drones of gym-pybullet-drones under velocity commands, 240/48 Hz."""
    try:
        module = importlib.import_module("gym_pybullet_drones.envs.VelocityAviary")
    except ImportError:
        return None
    env: Any = module.VelocityAviary(num_drones=4, pyb_freq=240, ctrl_freq=48, gui=False)
    env.reset(seed=seed)
    action = np.tile([0.1, 0.0, 0.0, 0.5], (4, 1))
    rate = _timed(lambda: env.step(action), 200)
    env.close()
    return rate


def _measure_peers(seed: int) -> dict[str, float]:
    """Return steps a second of each peer that is installed; what a peer prints goes to standard error."""
    with contextlib.redirect_stdout(sys.stderr):
        return {name: rate for name, measure in _PEERS.items() if (rate := measure(seed)) is not None}


_PEERS: dict[str, Callable[[int], float | None]] = {
    "mpe2.simple_spread": lambda seed: _parallel_env("mpe2.simple_spread_v3", seed, 500),
    "pettingzoo.pursuit": lambda seed: _parallel_env("pettingzoo.sisl.pursuit_v5", seed, 50),
    "gym_pybullet_drones.VelocityAviary": _velocity_aviary,
}

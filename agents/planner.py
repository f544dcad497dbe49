"""A team that looks ahead: every agent flies to the pose from which it expects to see most in the next seconds.

Candidates are positions all over the region and near the agent, and gazes on targets, on the middle of pairs of them,
and on the region's rim; each is valued by time in view and open handoffs over the next seconds
(`camnet.agents.planner_kernel`), with targets where their estimates say (`camnet.agents.planner_belief`). The best is
flown to, and all is decided anew at the next decision.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from camnet.agents.planner_belief import FIELDS, MEMORY, expect, futures, remember
from camnet.agents.planner_kernel import AHEAD_S, choose
from camnet.agents.planner_roads import RoadMap, Seeds, road_map
from camnet.agents.policy import Action, AgentContext
from camnet.compiled import cached_njit
from camnet.control.setpoints import loiter
from camnet.env.settings import RewardSettings
from camnet.errors import ConfigError
from camnet.geometry.regions import BoxRegion, CylinderRegion
from camnet.types import Array, BoolArray, IntArray

__all__ = ["Planner", "PlannerRows"]

#: particles of a target; of how many targets at once poses are tried
PARTICLES, MOST = 24, 5


class PlannerRows:
    """The planners of many environments at once: observations (E, N, D) in, actions (E, N, 5) out.

    What is remembered belongs to an environment; a target that is unknown again begins a new episode's memory.

    Parameters
    ----------
    known : fixed facts of the agents of one environment
    seeds : of the particles, one an environment
    searches : whether particles stand in for targets that nobody sees; of no use to who is shown the truth

    Raises
    ------
    ConfigError
        A region is neither a box nor a cylinder, or has occluders in it.
    """

    def __init__(
        self, known: Mapping[str, AgentContext], seeds: Sequence[int] = (0,), *, searches: bool = True
    ) -> None:
        contexts = list(known.values())
        slices = contexts[0].layout.slices
        targets = range(contexts[0].layout.n_targets)
        self._columns: IntArray = np.array(
            [[slices[f"target_{m}.{name}"].start for name in FIELDS] for m in targets], dtype=np.int64
        ).reshape(-1, len(FIELDS))
        self._facts = np.array([_facts(context) for context in contexts])
        self._speeds = np.asarray(contexts[0].speeds, dtype=float)
        self._dt_s, self._roads = contexts[0].decision_s, road_map(contexts[0].roads if searches else ())
        e, m = len(seeds), len(targets)
        self._memory: Array = np.zeros((e, m, MEMORY))
        self._memory[..., 6] = -1.0
        self._trust = np.zeros((e, 2))
        self._particles = np.zeros((e, m, PARTICLES if contexts[0].roads and searches else 0, 5))
        states = [np.random.SeedSequence([seed, 2]).generate_state(1, np.uint64)[0] for seed in seeds]
        self._seeds = np.maximum(np.array(states, dtype=np.uint64), 1)

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """Return actions (E, N, 5) for observations (E, N, D) of the agents that work (E, N)."""
        shown = np.ascontiguousarray(observations, dtype=np.float32)
        return _decide(
            shown,
            alive,
            self._columns,
            self._speeds,
            self._facts,
            self._dt_s,
            self._roads,
            self._memory,
            self._trust,
            self._particles,
            self._seeds,
        )


class Planner:
    """The same for one environment: a batch of one.

    Parameters
    ----------
    known : fixed facts of every agent
    seed, searches : see `PlannerRows`
    """

    def __init__(self, known: Mapping[str, AgentContext], seed: int = 0, *, searches: bool = True) -> None:
        self._names, self._contexts = list(known), dict(known)
        self._rows = PlannerRows(known, (seed,), searches=searches)
        self._size = next(iter(known.values())).layout.size

    def __call__(
        self, observations: Mapping[str, NDArray[np.float32] | Mapping[str, NDArray[np.float32]]]
    ) -> dict[str, Action]:
        """Return an action for every observation, flat or named part by part."""
        rows = np.zeros((1, len(self._names), self._size), dtype=np.float32)
        alive = np.zeros((1, len(self._names)), dtype=bool)
        for j, name in enumerate(self._names):
            if name in observations:
                alive[0, j], seen = True, observations[name]
                if isinstance(seen, Mapping):
                    seen = np.concatenate([seen[field] for field in self._contexts[name].layout.slices])
                rows[0, j] = seen
        actions = self._rows(rows, alive)[0]
        return {name: actions[self._names.index(name)] for name in observations}


def _facts(context: AgentContext) -> list[float]:
    """Return ``facts`` of an agent, in the order of `camnet.agents.planner_kernel`."""
    region, camera, s = context.region, context.camera, context.controller
    if context.viewpoints is not None or not isinstance(region, BoxRegion | CylinderRegion):
        raise ConfigError(
            f"agent 'planner': region {region.name!r} of {context.name!r} must be a box or a cylinder without occluders"
        )
    margin, (low, high), k, reward = s.region_margin_m, region.bounds, camera.intrinsics, RewardSettings()
    disc, radius = [0.0, 0.0, 0.0], 0.0
    if isinstance(region, CylinderRegion):
        disc, radius = [*region.center[:2], region.radius_m - margin], region.radius_m
    n_targets = max(context.layout.n_targets, 1)
    return [
        *context.center,
        *context.half_size,
        *(low + margin),
        *(high - margin),
        *disc,
        radius,
        (k.cx_px + 0.5) / k.fx_px,
        (k.width_px - 0.5 - k.cx_px) / k.fx_px,
        (k.cy_px + 0.5) / k.fy_px,
        (k.height_px - 0.5 - k.cy_px) / k.fy_px,
        camera.near_m,
        camera.far_m,
        _EXTENT * s.target_extent_m,
        s.reference_v_max_mps,
        s.reference_position_gain_per_s,
        s.gaze_max_rad,
        context.gaze_max_rad,
        context.width_m,
        context.lookahead_s,
        *loiter(region, camera, s).p_world,
        s.min_height_m,
        context.grace_s,
        reward.in_view / n_targets,
        reward.reacquired,
        reward.lost,
        reward.effort,
        *np.maximum(context.half_size - margin, 1e-6),
        math.tan(s.gaze_max_rad),
    ]


#: the ball that controllers keep in view is wider than the features
_EXTENT = 0.6


@cached_njit
def _poses(shown: NDArray[np.float32], facts: Array) -> Array:
    """Positions, m, and tangents of the gaze (N, 5) of the agents."""
    poses = np.empty((shown.shape[0], 5))
    for n in range(shown.shape[0]):
        for k in range(3):
            poses[n, k] = facts[n, k] + np.float64(shown[n, k]) * facts[n, 3 + k]
        for k in range(2):
            poses[n, 3 + k] = math.tan(min(max(np.float64(shown[n, 6 + k]) * facts[n, 26], -1.4), 1.4))
    return poses


@cached_njit
def _decide(
    shown: NDArray[np.float32],
    alive: BoolArray,
    columns: IntArray,
    speeds: Array,
    facts: Array,
    dt_s: float,
    roads: RoadMap,
    memory: Array,
    trust: Array,
    particles: Array,
    seeds: Seeds,
) -> NDArray[np.float32]:
    out = np.zeros((*shown.shape[:2], 5), dtype=np.float32)
    m_targets, steps = columns.shape[0], len(AHEAD_S)
    most = m_targets * (1 + particles.shape[2])
    places, spreads = np.empty((steps, most, 3)), np.empty((steps, most))
    chances = np.zeros((steps + 2, most))
    for e in range(shown.shape[0]):
        poses = _poses(shown[e], facts)
        remember(
            shown[e],
            alive[e],
            columns,
            speeds,
            facts,
            poses,
            dt_s,
            roads,
            memory[e],
            trust[e],
            particles[e],
            seeds,
            e,
        )
        ahead = futures(roads, memory[e], particles[e], seeds, e)
        for n in range(shown.shape[1]):
            if alive[e, n]:
                f = facts[n]
                estimates, k = expect(
                    shown[e, n],
                    n,
                    columns,
                    speeds,
                    memory[e],
                    trust[e],
                    particles[e],
                    ahead,
                    f,
                    places,
                    spreads,
                    chances,
                )
                x, y, z, pan, tilt = choose(
                    poses[n, :3],
                    poses[n, 3:],
                    places[:, :k],
                    spreads[:, :k],
                    chances[:, :k],
                    estimates,
                    MOST,
                    f,
                )
                asked = (
                    (x - f[0]) / f[38],
                    (y - f[1]) / f[39],
                    (z - f[2]) / f[40],
                    pan / f[26],
                    tilt / f[26],
                )
                for i in range(5):
                    out[e, n, i] = min(max(asked[i], -1.0), 1.0)
    return out

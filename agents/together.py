"""The agents for many environments at once: observations (E, N, D) in, actions (E, N, 5) out.

The same rules as `camnet.agents.roster` builds one by one, on arrays: no loop over environments but where an
assignment is solved. A row's action depends on that row alone, except for the auction's teams.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from camnet.agents.auction import INSIDE, NO_BID
from camnet.agents.features import FeatureMap
from camnet.agents.oracle import CAUTION_M
from camnet.agents.planner import PlannerRows
from camnet.agents.policy import AgentContext
from camnet.agents.policy_file import PolicyNet, load_policy
from camnet.agents.roster import estimator_of
from camnet.agents.trained import check_net
from camnet.control.setpoint_rows import SetpointRows
from camnet.env.layout import ObservationLayout
from camnet.types import Array, BoolArray

__all__ = ["Together", "build_together"]

#: acts for all agents of all environments: observations (E, N, D) and which agents work (E, N) in, actions out
Together = Callable[[NDArray[np.float32], BoolArray], NDArray[np.float32]]

_ACTION_SIZE = 5
#: decisions whose random actions are drawn at once
_BLOCK = 64


class _Facts:
    """Fixed facts of the N agents as arrays, and what their observations' columns mean."""

    def __init__(self, known: Mapping[str, AgentContext]) -> None:
        contexts = list(known.values())
        first = contexts[0]
        self.layout: ObservationLayout = first.layout
        self.rows = SetpointRows([c.region for c in contexts], [c.camera for c in contexts], first.controller)
        self.center, self.half = (
            np.stack([c.center for c in contexts]),
            np.stack([c.half_size for c in contexts]),
        )
        self.reach = np.maximum(self.half - first.controller.region_margin_m, 1e-6)
        self.width = self.half[:, :2].min(axis=1)
        self.speeds, self.lookahead_s = first.speeds, first.lookahead_s
        self.gaze_max_rad = first.gaze_max_rad
        self._first = {
            name: np.array([self.layout.slices[f"target_{m}.{name}"].start for m in range(len(self.speeds))])
            for name in _FIELDS
        }

    def field(self, shown: Array, name: str) -> Array:
        """Field (E, N, M) of all targets."""
        return np.asarray(shown[..., self._first[name]])

    def raise_to(self, shown: Array, names: Sequence[str], least: Array) -> None:
        """Make fields of all targets at least what ``least`` (N,) says for the agent."""
        for name in names:
            shown[..., self._first[name]] = np.maximum(shown[..., self._first[name]], least[:, None])

    def triple(self, shown: Array, name: str, m: NDArray[np.intp]) -> Array:
        """Field (E, N, 3) of the targets ``m`` (E, N)."""
        columns = self._first[name][m][..., None] + np.arange(3)
        return np.take_along_axis(shown, columns, axis=2)

    def world(self, relative: Array) -> Array:
        """Positions (E, N, 3) from those in half-sizes about the regions' centres."""
        return np.asarray(self.center + relative * self.half)

    def actions(self, p_world: Array, gaze: Array) -> NDArray[np.float32]:
        """Actions (E, N, 5) that ask for positions and gaze."""
        flat = np.concatenate([(p_world - self.center) / self.reach, gaze / self.gaze_max_rad], axis=-1)
        return np.asarray(np.clip(flat, -1.0, 1.0), dtype=np.float32)


_FIELDS = (
    "known",
    "position",
    "velocity",
    "radius",
    "seen_by_me",
    "seen",
    "inside",
    "coming",
    "entry_position",
    "entry_velocity",
    "entry_time",
    "entry_radius",
)


def _pick(values: Array, m: NDArray[np.intp]) -> Array:
    """Of fields (E, N, M) those (E, N) of the targets ``m``."""
    return np.take_along_axis(values, m[..., None], axis=2)[..., 0]


class _Rule:
    """`camnet.agents.learned.Learned` on arrays: track what is inside, meet what comes, else loiter."""

    def __init__(self, facts: _Facts) -> None:
        self._facts = facts

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`."""
        return self.decide(np.asarray(observations, dtype=float))

    def decide(self, shown: Array, only: NDArray[np.intp] | None = None) -> NDArray[np.float32]:
        """Actions for observations as float64; each agent minds the target ``only`` (E, N) alone (-1: none)."""
        facts, field = self._facts, self._facts.field
        own_p = facts.world(shown[..., :3])
        mine, radius, coming = field(shown, "seen_by_me"), field(shown, "radius"), field(shown, "coming")
        present = (mine > 0) | ((field(shown, "inside") > 0) & (radius <= 1))
        expected = (coming > 0) & (field(shown, "entry_radius") <= 1)
        if only is not None:
            minded = np.arange(mine.shape[2]) == only[..., None]
            present, expected = present & minded, expected & minded
        # a target in view before one only believed to be there, then the one best known (radii are at most 20)
        held = np.where(present, 100.0 * (1.0 - mine) + radius, np.inf).argmin(axis=2)
        soon = np.where(expected, 10.0 * (1.0 - coming) + field(shown, "entry_time"), np.inf).argmin(axis=2)
        p_world = facts.rows.ease(np.broadcast_to(facts.rows.rest_p_world, own_p.shape), own_p)
        gaze = np.zeros((*own_p.shape[:2], 2))
        meets, tracks = (np.any(which, axis=2, keepdims=True) for which in (expected, present))
        if meets.any():
            p, g = self._meet(shown, soon, own_p)
            p_world, gaze = np.where(meets, p, p_world), np.where(meets, g, gaze)
        if tracks.any():
            p, g = self._track(shown, held, own_p)
            p_world, gaze = np.where(tracks, p, p_world), np.where(tracks, g, gaze)
        return facts.actions(p_world, gaze)

    def _track(self, shown: Array, m: NDArray[np.intp], own_p: Array) -> tuple[Array, Array]:
        facts = self._facts
        return facts.rows.track(
            facts.world(facts.triple(shown, "position", m)),
            facts.triple(shown, "velocity", m) * facts.speeds[m][..., None],
            _pick(facts.field(shown, "radius"), m) * facts.width,
            _pick(facts.field(shown, "seen"), m) > 0,
            own_p,
        )

    def _meet(self, shown: Array, m: NDArray[np.intp], own_p: Array) -> tuple[Array, Array]:
        facts = self._facts
        goal, gaze = facts.rows.intercept(
            facts.world(facts.triple(shown, "entry_position", m)),
            facts.triple(shown, "entry_velocity", m) * facts.speeds[m][..., None],
            _pick(facts.field(shown, "entry_radius"), m) * facts.width,
        )
        left_s = _pick(facts.field(shown, "entry_time"), m) * facts.lookahead_s
        return facts.rows.ease(goal, own_p, left_s), gaze


class _Auction:
    """`camnet.agents.auction.Auction` on arrays: one assignment an environment."""

    def __init__(self, facts: _Facts) -> None:
        self._facts, self._rule = facts, _Rule(facts)

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`."""
        shown = np.asarray(observations, dtype=float)
        return self._rule.decide(shown, self._shared_out(shown, alive))

    def _shared_out(self, shown: Array, alive: BoolArray) -> NDArray[np.intp]:
        """Targets (E, N) that the agents have won (-1: none)."""
        field = self._facts.field
        expected = (field(shown, "coming") > 0) & (field(shown, "entry_radius") <= 1)
        bids = np.where(expected, INSIDE + field(shown, "entry_time"), NO_BID)
        bids[(field(shown, "inside") > 0) & (field(shown, "radius") <= 1)] = INSIDE
        bids[field(shown, "seen_by_me") > 0] = 0.0
        bids[~alive] = NO_BID
        won = np.full(bids.shape[:2], -1)
        for e in np.flatnonzero((bids < NO_BID).any(axis=(1, 2))).tolist():
            agents, targets = linear_sum_assignment(bids[e])
            taken = bids[e, agents, targets] < NO_BID
            won[e, agents[taken]] = targets[taken]
        return won


class _Oracle(_Auction):
    """`camnet.agents.oracle.Oracle` on arrays."""

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`."""
        least = (CAUTION_M / self._facts.width).astype(np.float32)
        shown = np.array(observations, dtype=float)
        self._facts.raise_to(shown, ("radius", "entry_radius"), least)
        won = self._shared_out(shown, alive)
        return np.where(won[..., None] < 0, self._rule.decide(shown), self._rule.decide(shown, won))


class _Nearest:
    """`camnet.agents.nearest.Nearest` on arrays."""

    def __init__(self, facts: _Facts) -> None:
        self._facts = facts

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`."""
        facts, shown = self._facts, np.asarray(observations, dtype=float)
        own_p = facts.world(shown[..., :3])
        known = facts.field(shown, "known") > 0
        targets = [
            facts.triple(shown, "position", np.full(own_p.shape[:2], m)) for m in range(known.shape[2])
        ]
        places = facts.world(np.stack(targets))  # (M, E, N, 3)
        away = np.where(np.moveaxis(known, 2, 0), np.linalg.norm(places - own_p, axis=-1), np.inf)
        goal = np.take_along_axis(places, away.argmin(axis=0)[None, ..., None], axis=0)[0]
        above = goal.copy()
        above[..., 2] = facts.center[:, 2] + 0.5 * facts.half[:, 2]
        p_world = facts.rows.project(above)
        way = goal - p_world
        gaze = np.arctan2(way[..., :2], np.maximum(-way[..., 2:], 0.0))
        some = np.any(known, axis=2, keepdims=True)
        return facts.actions(np.where(some, p_world, facts.center), np.where(some, gaze, 0.0))


class _Static:
    """`camnet.agents.static.Static` on arrays."""

    def __init__(self, facts: _Facts) -> None:
        self._actions = facts.actions(facts.rows.rest_p_world, np.zeros((len(facts.center), 2)))

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`."""
        return np.tile(self._actions, (len(observations), 1, 1))


class _Random:
    """`camnet.agents.random_walk.RandomWalk` on arrays: one generator an agent and environment."""

    def __init__(self, agents: int, seeds: Sequence[int]) -> None:
        self._streams = [
            [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(agents)]
            for seed in seeds
        ]
        self._drawn: list[Any] = []

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`; the draws of an agent that no longer works are nobody's."""
        if not self._drawn:
            blocks = [
                [rng.uniform(-1.0, 1.0, (_BLOCK, _ACTION_SIZE)) for rng in row] for row in self._streams
            ]
            self._drawn = list(np.array(blocks, dtype=np.float32).transpose(2, 0, 1, 3)[::-1])
        return np.asarray(self._drawn.pop())


class _Trained:
    """`camnet.agents.trained.Trained` on arrays."""

    def __init__(self, facts: _Facts, net: PolicyNet) -> None:
        check_net(net)
        self._facts, self._net, self._features = facts, net, FeatureMap(facts.layout)
        self._rule = _Rule(facts) if net.header.residual_of else None

    def __call__(self, observations: NDArray[np.float32], alive: BoolArray) -> NDArray[np.float32]:
        """See `Together`."""
        e, n, width = observations.shape
        half = np.broadcast_to(self._facts.half, (e, n, 3)).reshape(-1, 3)
        out = self._net(self._features(observations.reshape(-1, width), half)).reshape(e, n, -1)
        if self._rule is not None:
            out = np.clip(self._rule(observations, alive) + self._net.header.residual_scale * out, -1.0, 1.0)
        return out.astype(np.float32)


def build_together(name: str, known: Mapping[str, AgentContext], seeds: Sequence[int]) -> Together:
    """Build what acts for all agents of many environments of one network.

    Parameters
    ----------
    name : of an agent, or of a policy file
    known : fixed facts of the agents of one environment (`camnet.agents.network_contexts`)
    seeds : of the random agents, one for every environment

    Raises
    ------
    ConfigError, DataError
        There is no such agent, its policy file cannot be read, or a region is neither a box nor a cylinder.
    """
    estimator_of(name)  # names are checked in one place
    facts = _Facts(known)
    if name.endswith(".npz"):
        return _Trained(facts, load_policy(Path(name)))
    if name in ("planner", "planner_oracle"):
        return PlannerRows(known, seeds, searches=name == "planner")
    if name == "random":
        return _Random(len(known), seeds)
    kinds: dict[str, Callable[[_Facts], Together]] = {
        "auction": _Auction,
        "oracle": _Oracle,
        "nearest": _Nearest,
        "static": _Static,
        "blind": _Static,
    }
    return kinds.get(name, _Rule)(facts)

"""What is asked of the truth at every sensing step, in one compiled call: who is where, and who sees whom.

`camnet.sensing.visibility` has the parts one by one, which are the test oracles: membership in regions, who may see,
the frusta.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.geometry.pinned import Pins
from camnet.geometry.triples import Triple, borrowing, into, matrix, norm, out_of, quaternion, triple
from camnet.types import Array, BoolArray, IntArray, Snapshot

__all__ = ["Lookout", "Survey", "facts_at", "first_seers", "survey_truth"]


class Survey(NamedTuple):
    """What `Lookout.look` finds; of several regions or cameras the first counts, -1: none.

    Attributes
    ----------
    visible : (C,M) which camera sees which target
    outside : (N,) which agents are outside their regions
    region, seen_by : for each target
    spacing_m : least distance between two agents, m
    """

    visible: BoolArray
    outside: BoolArray
    region: IntArray
    seen_by: list[int]
    spacing_m: float


class _Facts(NamedTuple):
    """What stays the same from look to look, and where the results go.

    | field | shape | what |
    | --- | --- | --- |
    | ``low``, ``high`` | (C,3) | corners of the boxes about the regions, world, m |
    | ``a``, ``b`` | (C,6,3), (C,6) | frusta, camera frame: points p with a p <= b |
    | ``features``, ``first`` | (F,3), (M+1,) | features, target frame, m; where those of each target begin |
    | ``visible``, ``outside`` | (C,M), (N,) | as in `Survey` |
    | ``who`` | (2,M) | regions and seers of the targets |
    """

    low: Array
    high: Array
    a: Array
    b: Array
    features: Array
    first: IntArray
    visible: BoolArray
    outside: BoolArray
    who: IntArray


_PINS = Pins(_Facts)
#: in compiled code: the facts at an address
facts_at = _PINS.of


@borrowing
def _in_box(p: Array, k: int, low: Array, high: Array, c: int) -> bool:
    return bool(
        low[c, 0] <= p[k, 0] <= high[c, 0]
        and low[c, 1] <= p[k, 1] <= high[c, 1]
        and low[c, 2] <= p[k, 2] <= high[c, 2]
    )


@borrowing
def _in_frustum(a: Array, b: Array, c: int, point: Triple) -> bool:
    beyond = 0
    for k in range(6):
        beyond += a[c, k, 0] * point[0] + a[c, k, 1] * point[1] + a[c, k, 2] * point[2] > b[c, k]
    return beyond == 0


@borrowing
def _sees(
    c: int,
    m: int,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    a: Array,
    b: Array,
    features: Array,
    first: IntArray,
) -> bool:
    """Whether all features of target ``m`` are in the frustum of camera ``c``."""
    turn, view = matrix(quaternion(target_q, m, 0)), matrix(quaternion(camera_q, c, 0))
    for f in range(first[m], first[m + 1]):
        arm = out_of(turn, triple(features, f, 0))
        way = (
            target_p[m, 0] + arm[0] - camera_p[c, 0],
            target_p[m, 1] + arm[1] - camera_p[c, 1],
            target_p[m, 2] + arm[2] - camera_p[c, 2],
        )
        if not _in_frustum(a, b, c, into(view, way)):
            return False
    return True


@borrowing
def survey_truth(
    at: int,
    agent_p: Array,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    exceptions: BoolArray,
    working: BoolArray,
) -> float:
    """Write what `Lookout.look` returns; the least distance between two agents, m."""
    x = facts_at(at)
    n_targets, n_agents = target_p.shape[0], agent_p.shape[0]
    for m in range(n_targets):
        x.who[0, m] = x.who[1, m] = -1
        for c in range(camera_p.shape[0] - 1, -1, -1):
            inside = _in_box(target_p, m, x.low, x.high, c) and not exceptions[m, c]
            if inside:
                x.who[0, m] = c
            may = working[c] and (inside or c >= n_agents)
            x.visible[c, m] = may and _sees(
                c, m, camera_p, camera_q, target_p, target_q, x.a, x.b, x.features, x.first
            )
            if x.visible[c, m]:
                x.who[1, m] = c
    least = math.inf
    for j in range(n_agents):
        x.outside[j] = not _in_box(agent_p, j, x.low, x.high, j) or exceptions[n_targets + j, j]
        p = triple(agent_p, j, 0)
        for i in range(j):
            y = triple(agent_p, i, 0)
            least = min(least, norm((p[0] - y[0], p[1] - y[1], p[2] - y[2])))
    return least


class Lookout:
    """Looks at the truth of N agents, C cameras and M targets.

    Parameters
    ----------
    low, high : (C,3) corners of the boxes about the regions, m
    n_agents : N
    packed : frusta and features, as in `camnet.sensing.visibility.VisibilityTest.packed`
    """

    def __init__(
        self, low: Array, high: Array, n_agents: int, packed: tuple[Array, Array, Array, IntArray]
    ) -> None:
        targets = len(packed[3]) - 1
        #: as `survey_truth` left it
        self.visible: BoolArray = np.zeros((len(low), targets), dtype=np.bool_)
        self._outside: BoolArray = np.zeros(n_agents, dtype=np.bool_)
        self._who: IntArray = np.zeros((2, targets), dtype=np.int64)
        self._pinned = _PINS.pin(_Facts(low, high, *packed, self.visible, self._outside, self._who))

    @property
    def at(self) -> int:
        """Address of the facts, for `survey_truth`."""
        return self._pinned.at

    def look(self, now: Snapshot, exceptions: BoolArray, working: BoolArray) -> Survey:
        """Find out who is where, and who sees whom; sight lines are not looked at.

        Parameters
        ----------
        now : the truth
        exceptions : who (M + N, C) is not in a region though in the box about it; targets first
        working : which cameras (C,) work
        """
        spacing_m = survey_truth(
            self.at,
            now.agent_p_world,
            now.camera_p_world,
            now.camera_q_world,
            now.target_p_world,
            now.target_q_world,
            exceptions,
            working,
        )
        return self.found(spacing_m)

    def found(self, spacing_m: float) -> Survey:
        """Return what `survey_truth` has written, in arrays of its own."""
        region, seen_by = self._who.copy()
        return Survey(self.visible.copy(), self._outside.copy(), region, seen_by.tolist(), spacing_m)


def first_seers(visible: BoolArray) -> list[int]:
    """Return the first camera that sees each target, from ``visible`` (C,M); -1: none does."""
    seers: list[int] = np.where(visible.any(axis=0), visible.argmax(axis=0), -1).tolist()
    return seers

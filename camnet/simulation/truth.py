"""What the rows that are told the truth may ask of a running simulation; it holds the world, not the loop."""

from __future__ import annotations

from collections import deque

from camnet.simulation.filters import TargetTruth
from camnet.types import Array, Pose, Snapshot, Twist
from camnet.world.protocol import Foresees, World

__all__ = ["TruthRecord", "truth_of"]


class TruthRecord:
    """The truth now, and at the last sensing instants.

    Parameters
    ----------
    now : the truth at the start
    kept : how many sensing instants are kept
    """

    def __init__(self, now: Snapshot, kept: int) -> None:
        self.now = now
        self.past: deque[Snapshot] = deque(maxlen=kept)


class _TargetView:
    """The truth of one target."""

    def __init__(self, record: TruthRecord, world: World, m: int) -> None:
        self._record, self._world, self._m = record, world, m

    def twist(self, t_s: float) -> Twist:
        """Velocity at a sensing instant, the last one at or before ``t_s``."""
        record = self._record
        then = next((s for s in reversed(record.past) if s.t_s <= t_s + 1e-9), record.now)
        return Twist(then.target_v_world[self._m], then.target_w_body[self._m])

    def pose(self) -> Pose:
        """Pose now."""
        now = self._record.now
        return Pose(now.target_p_world[self._m], now.target_q_world[self._m])

    def future(self, t_s: Array) -> tuple[Array, Array]:
        """Poses at times to come."""
        world: Foresees = self._world  # type: ignore[assignment] # asked of such worlds alone
        return world.foresee(self._m, t_s)


def truth_of(record: TruthRecord, world: World, m: int) -> TargetTruth:
    """Return what the rows that are told the truth of target ``m`` may ask for."""
    view = _TargetView(record, world, m)
    if not isinstance(world, Foresees):
        return TargetTruth(view.twist)
    return TargetTruth(view.twist, view.pose, view.future)

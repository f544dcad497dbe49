"""Late measurements: they correct the past, and the present follows from it.

| symbol | meaning |
| --- | --- |
| ``t`` | now |
| ``L`` | horizon: how late a measurement may come, s |
| ``t_k`` | instants of the frames; at each the filter is either corrected or goes on without |
| settled | the filter itself, at the newest ``t_k <= t - L``: nothing can be said any more about what came before |
| open | the frames after that, each with its measurement once it has come |

    settled: correct or predict at t_k, in the order of the t_k, however late and in whatever order they became known
    present: settled, then the open frames, then the prediction up to t

So the settled filter goes through exactly the calls that it would get if every measurement came in time. With one
constant latency L no open frame has a measurement, and the present is the settled filter's own prediction, which
costs a roll-out; measurements that are early or out of order are run through a copy of the settled filter.
"""

from __future__ import annotations

import copy
import math
from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.own_pose.considered import ConsideredFilter
from camnet.estimation.protocol import Rollout, TargetFilter
from camnet.geometry.rotations_compiled import conjugate, log, multiply
from camnet.types import PoseMeasurement, TargetEstimate

__all__ = ["DelayedFilter", "underlying"]

#: instants closer than this are one, s
_SAME_S = 1e-9
#: longest step of the prediction from which the present velocity is taken, s
_STEP_S = 0.05


@dataclass(slots=True)
class _Frame:
    t_s: float
    measurement: PoseMeasurement | None = None
    region: int = -1

    def apply(self, filter_: TargetFilter) -> None:
        """Correct or predict."""
        if self.measurement is None:
            filter_.predict(self.t_s)
        else:
            filter_.correct(self.measurement, self.region)


def underlying(filter_: TargetFilter) -> TargetFilter:
    """Return the filter inside a `DelayedFilter` or a `ConsideredFilter`, or the filter itself."""
    if isinstance(filter_, ConsideredFilter):
        return underlying(filter_.inner)
    return filter_.settled if isinstance(filter_, DelayedFilter) else filter_


class DelayedFilter:
    """Any filter of one target, for measurements that come up to ``horizon_s`` late; the interface is the filter's.

    A caller feeds `correct` with what has come, whenever it was taken, and then calls `predict` with the present time.
    One measurement an instant is taken; a second one of the same instant takes its place. What comes later than the
    horizon is left out and counted (``late`` in the diagnostics).

    Parameters
    ----------
    settled : the filter; its state lags by the horizon
    horizon_s : the greatest latency

    Raises
    ------
    ConfigError
        If the horizon is negative or not finite.
    """

    def __init__(self, settled: TargetFilter, horizon_s: float) -> None:
        if not (horizon_s >= 0.0 and math.isfinite(horizon_s)):
            raise ConfigError(f"horizon_s {horizon_s}: must be finite and not negative")
        self.name = settled.name
        self.settled = settled
        self._horizon_s = horizon_s
        self._open: list[_Frame] = []
        self._now = self._settled_s = -math.inf
        self._late = 0
        self._replayed: TargetFilter | None = None
        self._estimate: TargetEstimate | None = None

    # --- advancing ---------------------------------------------------------------------------------------------------

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """Take a measurement, of now or of the past; its frame is settled once the present is the horizon later."""
        if measurement.t_s <= self._settled_s + _SAME_S:
            self._late += 1
            return
        frame = self._frame(measurement.t_s)
        frame.measurement, frame.region = measurement, region
        self._moved(measurement.t_s)

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``: ``t_s`` is the present time."""
        if t_s > self._now + _SAME_S:
            self._frame(t_s)
        self._moved(t_s)

    def _frame(self, t_s: float) -> _Frame:
        """Return the open frame at ``t_s``, a new one if there is none."""
        i = bisect_left(self._open, t_s - _SAME_S, key=lambda frame: frame.t_s)
        if i == len(self._open) or self._open[i].t_s > t_s + _SAME_S:
            self._open.insert(i, _Frame(t_s))
        return self._open[i]

    def _moved(self, t_s: float) -> None:
        self._now = max(self._now, t_s)
        self._replayed = self._estimate = None
        while self._open and self._open[0].t_s <= self._now - self._horizon_s + _SAME_S:
            frame = self._open.pop(0)
            frame.apply(self.settled)
            self._settled_s = frame.t_s

    # --- results -----------------------------------------------------------------------------------------------------

    @property
    def estimate(self) -> TargetEstimate:
        """What is believed of the present; ``seen`` is whether a measurement was in force when last one could be."""
        if self._estimate is None:
            early = any(frame.measurement is not None for frame in self._open)
            self._estimate = self._present().estimate if early else self._carried()
        return self._estimate

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``; from the present on."""
        return (self._present() if self._open else self.settled).rollout(horizon_s, dt_s)

    def diagnostics(self) -> dict[str, float]:
        """Figures of the settled filter, and ``late``: measurements beyond the horizon."""
        return {**self.settled.diagnostics(), "late": float(self._late)}

    def _present(self) -> TargetFilter:
        """Copy of the settled filter, brought to now through the open frames."""
        if self._replayed is None:
            self._replayed = copy.deepcopy(self.settled)
            for frame in self._open:
                frame.apply(self._replayed)
        return self._replayed

    def _carried(self) -> TargetEstimate:
        """Settled estimate moved along its own prediction to now; velocities by central difference."""
        then = self.settled.estimate
        lag = self._now - then.t_s
        if then.region < 0 or not lag > _SAME_S:
            return then
        steps = math.ceil(lag / _STEP_S)
        dt = lag / steps
        path = self.settled.rollout(lag + dt, dt)
        p = np.concatenate([then.p_world[None], path.p_world])
        q = np.concatenate([then.q_world[None], path.q_world])
        turn = log(multiply(conjugate(q[steps - 1]), q[steps + 1]))
        return replace(
            then,
            t_s=self._now,
            p_world=p[steps],
            q_world=q[steps],
            v_world=(p[steps + 1] - p[steps - 1]) / (2.0 * dt),
            w_body=turn / (2.0 * dt),
            radius_m=float(path.radius_m[steps - 1]),
        )

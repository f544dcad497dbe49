"""The smallest single changes that certify one transition of a road network."""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.certification.transitions import RoadTargetClass

__all__ = ["Repair", "smallest_repairs"]


@dataclass(frozen=True, slots=True)
class Repair:
    """One change that certifies a transition by itself.

    Attributes
    ----------
    change : what to change
    amount : by how much, in ``unit``
    unit : of the amount
    cost : for ranking: the amount relative to what it changes
    """

    change: str
    amount: float
    unit: str
    cost: float


def smallest_repairs(
    longest_m: float, chord_m: float, target: RoadTargetClass, off_max_s: float, on_min_s: float
) -> list[Repair]:
    """Return single changes that certify an uncertified transition, the cheapest first.

    Parameters
    ----------
    longest_m, chord_m : unseen length and seen length behind it, m
    target : class of the targets
    off_max_s, on_min_s : dwell times

    Notes
    -----
    Each change follows from l / v_lo <= Dt_off and chord / v_max >= Dt_on with everything else fixed. An empty list
    means that the transition is certified already.
    """
    allowed = target.v_lo_mps * off_max_s
    needed = target.v_max_mps * on_min_s
    too_long, too_short = longest_m - allowed, needed - chord_m
    repairs: list[Repair] = []
    if too_long > 0.0 and math.isfinite(too_long):
        cameras = math.ceil(longest_m / allowed) - 1 if allowed > 0.0 else math.inf
        repairs.append(
            Repair("move or widen views along the road by", too_long, "m", too_long / max(chord_m, 1e-9))
        )
        repairs.append(Repair("add cameras on the way", cameras, "cameras", float(cameras)))
        faster = longest_m / off_max_s if off_max_s > 0.0 else math.inf
        if faster <= target.v_max_mps:
            raised = faster - target.v_lo_mps
            repairs.append(
                Repair("raise the class's least speed by", raised, "m/s", raised / target.v_lo_mps)
            )
    if too_short > 0.0:
        repairs.append(
            Repair("lengthen the view along the road by", too_short, "m", too_short / max(chord_m, 1e-9))
        )
        slower = target.v_max_mps - chord_m / on_min_s
        if chord_m / on_min_s >= target.v_lo_mps:
            repairs.append(Repair("limit the class's top speed by", slower, "m/s", slower / target.v_max_mps))
    if too_long > 0.0 and too_short > 0.0:  # both constraints fail: only changes of the views meet both
        both = too_long + too_short
        return [Repair("widen views along the road by", both, "m", both / max(chord_m, 1e-9))]
    return sorted(repairs, key=lambda r: r.cost)

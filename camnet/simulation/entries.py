"""Where and when a predicted path enters each region.

The predictor runs on until the estimate meets a neighbouring region, whose agent is told where to intercept
(harris2020, ch. 4). While the path itself meets no region, a region that the growing error ball touches is warned
instead: on a first crossing the model knows nothing, and a warned agent costs little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.estimation.protocol import Rollout
from camnet.geometry.regions import BoxRegion, Region
from camnet.simulation.entry_kernel import ENTERS, box_entries
from camnet.types import Array

__all__ = ["Entry", "first_entry", "predict_entries"]


@dataclass(frozen=True, eq=False, slots=True)
class Entry:
    """Predicted entry of one target into one region.

    Attributes
    ----------
    region : index of the region
    t_s : predicted time of entry, s
    p_world, v_world : (3,), (3,) predicted position and velocity at entry
    radius_m : error radius of the prediction at entry, m
    direct : whether the path itself enters (else only its error ball touches the region)
    """

    region: int
    t_s: float
    p_world: Array
    v_world: Array
    radius_m: float
    direct: bool


def predict_entries(rollout: Rollout, regions: Sequence[Region]) -> list[Entry | None]:
    """Predict the entry into every region along one rollout.

    Returns
    -------
    list of Entry or None
        One per region; None for the region that the path starts in and for those it never comes near.
    """
    boxes = [j for j, region in enumerate(regions) if isinstance(region, BoxRegion)]
    found: list[Entry | None] = [None] * len(regions)
    if boxes:
        corners = np.array([regions[j].bounds for j in boxes])
        met = box_entries(rollout.p_world, rollout.radius_m, corners[:, 0], corners[:, 1])
        for j, (how, k) in zip(boxes, met.tolist(), strict=True):
            if how:
                found[j] = _entry(j, rollout, k, how == ENTERS)
    for j, region in enumerate(regions):
        if not isinstance(region, BoxRegion):
            found[j] = first_entry(j, rollout, region)
    return found


def first_entry(index: int, rollout: Rollout, region: Region) -> Entry | None:
    """Return the entry into one region of any kind."""
    distance = region.signed_distance(_levelled(rollout, region))
    if distance[0] <= 0.0:
        return None
    inside = np.flatnonzero(distance <= 0.0)
    touching = inside if inside.size else np.flatnonzero(distance <= rollout.radius_m)
    if touching.size == 0:
        return None
    k = int(touching[0]) if inside.size else int(touching[np.argmin(distance[touching])])
    return _entry(index, rollout, k, bool(inside.size))


def _entry(index: int, rollout: Rollout, k: int, direct: bool) -> Entry:
    before = max(k - 1, 0)
    dt = rollout.t_s[k] - rollout.t_s[before]
    velocity = (rollout.p_world[k] - rollout.p_world[before]) / dt if dt > 0 else np.zeros(3)
    return Entry(
        region=index,
        t_s=float(rollout.t_s[k]),
        p_world=rollout.p_world[k].copy(),
        v_world=velocity,
        radius_m=float(rollout.radius_m[k]),
        direct=direct,
    )


def _levelled(rollout: Rollout, region: Region) -> Array:
    """Return the path (K, 3) with heights moved into the region's range, by no more than the error radius.

    Regions end at the ground, targets are on it, and the estimate of the height is as often below as above: a path a
    millimetre under the ground would otherwise meet no region at all.
    """
    p = rollout.p_world.copy()
    low, high = region.bounds[:, 2]
    rise = np.clip(p[:, 2], low, high) - p[:, 2]
    p[:, 2] += np.clip(rise, -rollout.radius_m, rollout.radius_m)
    return p

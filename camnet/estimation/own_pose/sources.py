"""Pose sources as numbers, and one control period of one of them in compiled code: the same for every back end.

| column | of ``numbers`` | unit |
| --- | --- | --- |
| 0, 1, 2 | standard deviations of scale, gyro bias, and the gyro's white noise of one sample | -, rad/s, rad/s |
| 3, 4 | of a fix: position, heading | m, rad |
| 5, 6 | of white noise after one second: position, heading | m, rad |
| 7 | 1: scale and bias are learned | |
| 8, 10 | of a rotation between images; images a second (0: none) | rad, Hz |
| 9 | fixes a second | Hz |

A source's ``truth`` (4,) is x, y, m, heading, and heading at the last image, rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.own_pose.dead_reckoning import OwnErrors, OwnModel, advance_own, fix_own, own_model
from camnet.estimation.structure.key_frames.augmented_filter import FilterNoise
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array

__all__ = ["DRAWS", "pack_sources", "step_source"]

#: standard normal numbers of one period: velocity (2), turn, rotation, fix (3)
DRAWS = 7
_NUMBERS = 11
#: times within this share of a period, or so many seconds, count as equal
_EARLY = 1e-6


def pack_sources(sources: Sequence[PoseSource], dt_s: float) -> tuple[Array, Array]:
    """Return numbers (A,11) of sources that are read every ``dt_s``, and outages (K,3): source, from, to."""
    rows, outages = [], []
    for a, source in enumerate(sources):
        m = own_model(source, dt_s)
        n, images = m.noise, 1.0 / source.visual.every_s if source.source == "key_frames" else 0.0
        row = [n.scale, n.gyro_bias, n.gyro_noise, n.landmark_m, n.landmark_rad, m.walk_p, m.walk_th]
        rows.append([*row, float(m.calibrate), m.turn_sd, source.fixes.rate_hz, images])
        outages += [[float(a), begin, end] for begin, end in source.outages_s]
    return np.array(rows, dtype=float).reshape(-1, _NUMBERS), np.array(outages, dtype=float).reshape(-1, 3)


@cached_njit
def _ticks(t_s: float, dt_s: float, rate_hz: float) -> bool:
    """Whether a clock ticks in the period that ends at ``t_s``."""
    return math.floor(t_s * rate_hz + _EARLY) > math.floor((t_s - dt_s) * rate_hz + _EARLY)


@cached_njit
def _wrapped(angle: float) -> float:
    return float(angle - 2.0 * math.pi * round(angle / (2.0 * math.pi)))


@cached_njit
def step_source(
    x: Array, cov: Array, truth: Array, errors: Array, numbers: Array, outages: Array, a: int, now: Array,
    draws: Array, outside: bool, t_s: float, dt_s: float,
) -> tuple[float, bool]:  # fmt: skip
    """Take one period of source ``a``, which ends at ``t_s`` with the true pose ``now`` (3,).

    Parameters
    ----------
    x, cov, truth : (9,), (9,9), (4,) the source's state, changed in place
    errors, numbers, draws : (2,), (11,), (7,) of the source
    outages : (K,3) of all sources
    outside : whether the agent is where there is no external pose

    Returns
    -------
    turn, lost : error of the believed heading, rad; whether there is no external pose
    """
    c = numbers
    noise = FilterNoise(c[0], c[1], 0.0, 0.0, 1.0, c[2], c[3], c[4], 50.0, 1.0)
    model = OwnModel(noise, c[5], c[6], c[7] > 0.0, c[8])
    rotation = math.nan
    if c[10] > 0.0 and _ticks(t_s, dt_s, c[10]):
        rotation = _wrapped(now[2] - truth[3]) + c[8] * draws[3]
        truth[3] = now[2]
    own = OwnErrors(errors[0], errors[1])
    advance_own(x, cov, model, own, truth[:3].copy(), now, dt_s, draws[:3], rotation)
    lost = outside
    for k in range(outages.shape[0]):
        lost = lost or (int(outages[k, 0]) == a and outages[k, 1] <= t_s + _EARLY < outages[k, 2])
    if not lost and _ticks(t_s, dt_s, c[9]):
        fix_own(x, cov, model, now, draws[4:])
    truth[:3] = now
    return _wrapped(x[2] - now[2]), lost

"""Steps 1 and 3 of an update: the new state with its observations, and how much each observation counts."""

from __future__ import annotations

import numpy as np

from camnet.estimation.adate.track import Track
from camnet.estimation.adate.weights import NONE, combine, reweight
from camnet.estimation.pls.noise import transition
from camnet.types import Array

__all__ = ["append", "begin", "weigh"]


def append(track: Track, obs: Array, cov: Array, ids: list[int]) -> None:
    """Step 1: one more state, predicted, with the observations (m,3) of the observers ``ids``."""
    win = track.win
    new = [i for i in ids if i not in track.ids]
    for i in new:
        track.ids[i] = len(track.ids)
    if len(track.ids) > win.slots:
        win.widen(2 * len(track.ids))
        extra = win.slots - len(track.weight)
        track.scale = np.concatenate([track.scale, np.tile(np.eye(3), (extra, 1, 1))])
        track.weight = np.concatenate([track.weight, np.zeros(extra)])
    win.append()
    for row, i in enumerate(ids):
        slot = track.ids[i]
        win.obs[-1, slot], win.given[-1, slot], win.has[-1, slot] = obs[row], cov[row], True
    win.tau[-1] = track.dt_s
    if win.n > 1:
        win.tau[-2] = track.elapsed_s
        transition(track.par, win.s[-2], track.elapsed_s, track.rest, win.s[-1], win.jac[-2])


def begin(track: Track) -> None:
    """Prior of the first state: where it was seen, with a wide velocity."""
    win, start = track.win, track.settings.start
    win.s[0] = 0.0
    weigh(track)
    win.s[0, :3] = win.z[0]
    track.mean[:] = win.s[0]
    spread = [100.0 * float(np.trace(win.rbar[0]))] * 3 + [start.speed_sd_m_s**2] * 3
    track.cov = np.diag([*spread, start.power_sd**2, *[start.turn_sd_rad_s**2] * 3])


def weigh(track: Track, plain: bool = False) -> None:
    """Step 3: covariances of the observations in force, and their combination."""
    w = track.win
    rule = NONE if plain or track.steps == 0 else track.rule
    reweight(
        rule,
        w.n,
        w.s,
        w.tau,
        w.obs,
        w.given,
        w.has,
        track.scale,
        track.weight,
        track.rule_par,
        w.r,
        w.sound,
    )
    combine(w.n, w.obs, w.has, w.r, w.z, w.rbar, w.seen)

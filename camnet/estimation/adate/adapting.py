"""Steps 5 and 6 of an update: adapted densities and scales, the trajectory written, and states frozen."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from camnet.estimation.adate.rollout import predict_step
from camnet.estimation.adate.scores import fade, scores
from camnet.estimation.adate.smoothing import keep_frozen
from camnet.estimation.adate.track import Track
from camnet.estimation.adate.weights import learn_scale

__all__ = ["adapt", "store", "truncate"]

#: weights of the truncation index: position, velocity, power and turn rate (40)
_PSI: Final = np.array([1.0] * 3 + [0.25] * 3 + [1.0 / 9.0] * 4)


def adapt(track: Track) -> None:
    """Step 5: densities of the process, scales of the observers."""
    w, a = track.win, track.settings.adaptation
    if a.process == "score" and not track.rest:
        num_p, den_p, num_s, den_s = scores(
            w.n, a.process_lag, w.jac, w.seen, w.gain, w.s_inv, w.lam, w.q_power, w.q_steer
        )
        if den_p > 0.0:
            top = math.log(a.process_range)
            g = a.process_gain
            for name, num, den in (("power_scale", num_p, den_p), ("steering_scale", num_s, den_s)):
                log = math.log(getattr(track, name)) + g * min(num / den - 1.0, 3.0)
                setattr(track, name, math.exp(min(max(log, -top), top)))
    elif a.process == "fading":
        fade(w.n, w.s, w.nxt, w.q, w.tau, a.memory_s)
        track.keep_q = not track.rest
    row = w.n - 1 - a.process_lag
    if a.learn_scale and row >= 0 and not track.rest:
        learn_scale(
            w.s[row], w.obs[row], w.given[row], w.has[row], w.sound[row], 10.0 * a.scale_memory,
            track.scale, track.weight,
        )  # fmt: skip


def store(track: Track) -> None:
    """Write the window into the trajectory and take the truncation index (40).

    Steps after the last observation hold the mean of the prediction (`rollout`); the window keeps the flow.
    """
    w, t = track.win, track.settings.truncation
    old = track.all[track.start : track.steps]
    theta = ((w.s - old) ** 2) @ _PSI
    known = np.isfinite(w.change)
    w.change[:] = np.where(
        known, (1.0 - t.average) * np.where(known, w.change, 0.0) + t.average * theta, theta
    )
    w.change[-1] = np.inf
    if w.seen[-1]:
        old[:] = w.s
        track.causal_cov = w.filt_p[-1].copy()
        return
    blind = int(np.argmax(w.seen[::-1])) if w.seen.any() else w.n
    old[: w.n - blind] = w.s[: w.n - blind]
    mean = track.all[track.steps - 2].copy()
    predict_step(
        track.par,
        mean,
        track.causal_cov,
        track.elapsed_s,
        track.rest,
        track.power_scale,
        track.steering_scale,
    )
    old[-1] = mean


def truncate(track: Track) -> None:
    """Step 6: freeze what no longer changes (41); its marginal becomes the window's prior."""
    w, t = track.win, track.settings.truncation
    seen = np.flatnonzero(w.seen)
    last = int(seen[-t.keep]) if len(seen) > t.keep else 0
    loud = np.flatnonzero(w.change > t.threshold)
    quiet = int(loud[0]) if len(loud) else last
    drop = max(min(last, quiet), w.n - t.limit)
    if drop > 0:
        keep_frozen(track, drop)
        track.mean = track.pred_mean[drop].copy()
        track.cov = w.pred_p[drop].copy()
        w.drop(drop)
        track.pred_mean = track.pred_mean[drop:]
        track.start += drop

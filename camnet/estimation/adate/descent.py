"""Steps 2 and 4 of an update: Gauss-Newton on the window, and what is done when it does not close.

A track starts with a linear constant-velocity smoother (``track.rest``) and hands over to the steering model once its
velocity is significant: before that the heading, on which the model turns, is not known at all.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.estimation.adate.chain import backward, forward
from camnet.estimation.adate.observing import weigh
from camnet.estimation.adate.track import Track, largest_defect, linearise_window, mix
from camnet.types import Array

__all__ = ["engage", "solve"]


def solve(track: Track) -> None:
    """Take Gauss-Newton steps until the transitions close, from a linear start when they do not."""
    weigh(track)
    if track.rest:
        linearise(track)
        sweep(track)
        track.win.s[:] += track.win.d
        return
    before = track.win.s.copy()
    if not converge(track) and not restart(track, before):
        fall_back(track, before)


def converge(track: Track) -> bool:
    """Gauss-Newton steps; whether every transition is closed to within its noise."""
    most = max(track.settings.iterations, track.settings.rescue)
    linearise(track)
    for k in range(most):
        sweep(track)
        moved = move(track)
        linearise(track)
        closed = defect(track) < track.settings.closed
        if closed and (k + 1 >= track.settings.iterations or moved < track.settings.tolerance):
            return True
    return False


def restart(track: Track, before: Array) -> bool:
    """Start the window again from the linear constant-velocity smoother, which has one solution."""
    track.restarts += 1
    smooth_linearly(track, before)
    steer(track)
    return converge(track)


def fall_back(track: Track, before: Array) -> None:
    """Leave the window at the linear solution for this step."""
    track.fallbacks += 1
    smooth_linearly(track, before)


def smooth_linearly(track: Track, before: Array) -> None:
    """Replace the window ``before`` by the solution of the constant-velocity smoother."""
    w = track.win
    w.s[:] = before
    track.rest, track.keep_q = True, False
    linearise(track)
    sweep(track)
    w.s[:] += w.d
    track.rest = False


def steer(track: Track) -> None:
    """Power and turn rate of the window for its velocities: equilibrium power, no turn."""
    w = track.win
    speed = np.linalg.norm(w.s[:, 3:6], axis=1)
    w.s[:, 6] = speed * (track.par[1] * speed + track.par[2])
    w.s[:, 7:10] = 0.0


def linearise(track: Track) -> None:
    """Step 2: transitions, their derivatives and their covariances about the present trajectory."""
    w = track.win
    linearise_window(w.n, track.par, w.s, w.tau, track.rest, w.nxt, w.jac, w.q_power, w.q_steer, w.q_iso)
    first = w.n - 2 if track.keep_q else 0  # (35) keeps what it adapted
    mix(first, w.n, track.power_scale, track.steering_scale, w.q_power, w.q_steer, w.q_iso, w.q)


def defect(track: Track) -> float:
    """Largest squared transition error of the window in units of its variances (inf when not finite)."""
    w = track.win
    return float(largest_defect(w.n, w.s, w.nxt, w.q))


def sweep(track: Track) -> None:
    """Solve the normal equations for the step of the whole window, by a forward and a backward pass."""
    w = track.win
    forward(
        w.n, w.s, w.nxt, w.jac, w.q, w.z, w.rbar, w.seen, track.mean, track.cov,
        w.pred_d, w.pred_p, w.filt_d, w.filt_p, w.gain, w.s_inv, w.y,
    )  # fmt: skip
    backward(w.n, w.jac, w.seen, w.pred_d, w.pred_p, w.gain, w.s_inv, w.y, w.d, w.lam)
    track.pred_mean = w.s + w.pred_d


def move(track: Track) -> float:
    """Apply the step, shortened so that no velocity turns over; returns the largest change."""
    w = track.win
    speed = np.linalg.norm(w.s[:, 3:6], axis=1)
    change = np.linalg.norm(w.d[:, 3:6], axis=1)
    share = min(1.0, float(np.min((speed + 0.3) / (change + 1e-12))))
    w.s[:] += share * w.d
    return float(np.max(np.abs(share * w.d)))


def engage(track: Track) -> None:
    """Hand over from constant velocity to the steering model once the velocity is significant."""
    w, start = track.win, track.settings.start
    v, p = w.s[-1, 3:6], w.filt_p[-1, 3:6, 3:6]
    if w.n < 5 or v @ np.linalg.solve(p, v) < start.significance:
        return
    track.rest = False
    linear = w.s.copy()
    steer(track)
    anchor(track)
    if not converge(track):
        w.s[:] = linear
        linearise(track)
        track.rest = True


def anchor(track: Track) -> None:
    """Prior of the window's first state for the steering model: near its equilibrium speed (below (10))."""
    w, start = track.win, track.settings.start
    v = w.s[0, 3:6]
    speed = float(np.linalg.norm(v))
    along = v / speed
    slope = 1.0 / math.sqrt(track.par[2] ** 2 + 4.0 * track.par[1] * w.s[0, 6]) if track.par[2] else 0.0
    track.mean[3:] = w.s[0, 3:]
    cov = np.zeros((10, 10))
    cov[:3, :3] = track.cov[:3, :3]
    cov[3:6, 3:6] = start.speed_sd_m_s**2 * (np.eye(3) - np.outer(along, along))
    cov[3:6, 3:6] += (start.balance_sd_m_s**2 + (slope * start.power_sd) ** 2) * np.outer(along, along)
    cov[3:6, 6] = cov[6, 3:6] = slope * start.power_sd**2 * along
    cov[range(6, 10), range(6, 10)] = [start.power_sd**2, *[start.turn_sd_rad_s**2] * 3]
    track.cov = cov

"""What the estimators of held models remember of a target: latest poses, and how far they were off.

The prior mean is the fit to the poses of the sighting, as in `camnet.estimation.gap`; the error radius is that of
`camnet.estimation.radius`. The arrays are in the table of `camnet.batch.frozen`.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_learn import fit_motion
from camnet.batch.frozen_motion import Frozen
from camnet.batch.state import State
from camnet.estimation.radius import BLIND_SHARE, MARGIN, REMEMBERED_GAPS

__all__ = ["growth_rate", "model_in_force", "refresh_prior", "remember", "set_radius"]


@inner
def refresh_prior(f: Frozen, e: int, m: int) -> None:
    """Fit the present motion to the poses of the sighting, if there are enough and it is due."""
    held, next_ = f.held[e, m, 0], f.held[e, m, 1]
    if f.held[e, m, 2] == 0 or 3 * held < f.samples or held < 3:
        return
    f.held[e, m, 2] = 0
    last = next_ + f.samples
    rows = f.history[e, m, last - held : last]
    if not rows[held - 1, 0] > rows[0, 0]:
        return
    fit_motion(rows, held, rows[held - 1, 0], f.fitted[e, m])
    for i in range(6):
        f.pose[e, m, 8 + i] = f.fitted[e, m, 7 + i]


@inner
def remember(f: Frozen, state: State, e: int, m: int, t_s: float) -> None:
    """Note the measured pose for the next fit."""
    size, at = f.samples, f.held[e, m, 1]
    for row in (at, at + size):
        f.history[e, m, row, 0] = t_s
        for i in range(7):
            f.history[e, m, row, 1 + i] = state.measured[e, m, i]
    f.held[e, m, 0] = min(f.held[e, m, 0] + 1, size)
    f.held[e, m, 1] = at + 1 if at + 1 < size else 0
    f.held[e, m, 2] = 1


@inner
def model_in_force(f: Frozen, state: State, e: int, m: int) -> int:
    """Which of the target's models is in force: one a region, or one for all."""
    return f.model_of[m, int(state.estimate[e, m, 15])] - f.model_of[m, 0]


@inner
def growth_rate(f: Frozen, state: State, e: int, m: int) -> float:
    """Growth of the error radius while unseen, m/s: `ErrorRadius.growth`."""
    r = model_in_force(f, state, e, m)
    count = int(f.rates[e, m, r, REMEMBERED_GAPS])
    if count == 0:
        s = state.estimate
        return BLIND_SHARE * math.sqrt(s[e, m, 7] ** 2 + s[e, m, 8] ** 2 + s[e, m, 9] ** 2)
    worst = 0.0
    for i in range(min(count, REMEMBERED_GAPS)):
        worst = max(worst, f.rates[e, m, r, i])
    return MARGIN * worst


@inner
def set_radius(f: Frozen, state: State, e: int, m: int) -> None:
    """Show the error radius at the estimate's instant."""
    r, s = model_in_force(f, state, e, m), state.estimate
    since = max(0.0, f.pose[e, m, 0] - s[e, m, 14])
    per_s = growth_rate(f, state, e, m) if since > 0.0 else 0.0
    s[e, m, 16] = 3.0 * math.sqrt(f.square[e, m, r]) + per_s * since

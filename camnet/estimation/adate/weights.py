r"""Adaptation of the observation covariances (li2019, section IV.C): drift, outliers and wrong scales.

| symbol | name | shape | equation |
| --- | --- | --- | --- |
| dz_ij | residual z_ij - H s_i of observer j at step i | (3,) | (37) |
| R0_ij | covariance as given | (3,3) | |
| C_ij | R0_ij rescaled by what the whitened residuals of observer j showed | (3,3) | |
| m_ij | mean of the residuals of observer j within `span` steps of i (N of them), less the observers' median | (3,) | |

`local` (the default):  R_ij = C_ij + N max(0, 1 - g/t) m m^T,  t = N m^T C_ij^-1 m: a drift is a residual that
does not average
out, so it is tested, and charged, on the local mean; the factor N is the number of steps over which it stays the same.
`gate` is the paper's rule: an observation whose squared deviation (38) exceeds min((3 rms)^2, `outlier_gate`) gets
R = (t_m R0 + tau dz dz^T)/(t_m + tau) (39), restarted from R0 at each update. `student` divides R0 by the
Student-t weight.

**Departure.** (39) with t_m well above tau hardly changes R for a residual of a few deviations, and looks at
one observation at a
time: a slow drift passes under its gate for as long as it stays under three deviations. Hence `local`.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.kalman.linalg import invert3
from camnet.types import Array, BoolArray, IntArray

__all__ = ["GATE", "LOCAL", "NONE", "STUDENT", "combine", "learn_scale", "reweight"]

NONE, LOCAL, GATE, STUDENT = 0, 1, 2, 3


@cached_njit(error_model="numpy")
def _deviation(e: Array, inv: Array) -> float:
    """E' inv e for three components."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += e[a] * inv[a, b] * e[b]
    return total


@cached_njit(error_model="numpy")
def _root(a: Array, low: Array) -> None:
    """Lower Cholesky factor of a symmetric positive definite (3,3)."""
    low[:] = 0.0
    low[0, 0] = math.sqrt(a[0, 0])
    low[1, 0] = a[1, 0] / low[0, 0]
    low[2, 0] = a[2, 0] / low[0, 0]
    low[1, 1] = math.sqrt(a[1, 1] - low[1, 0] * low[1, 0])
    low[2, 1] = (a[2, 1] - low[2, 0] * low[1, 0]) / low[1, 1]
    low[2, 2] = math.sqrt(a[2, 2] - low[2, 0] * low[2, 0] - low[2, 1] * low[2, 1])


@cached_njit(error_model="numpy")
def _scaled(given: Array, scale: Array, weight: float, prior: float, low: Array, out: Array) -> None:
    """Covariance L ((prior I + weight scale)/(prior + weight)) L^T with L L^T the given one."""
    _root(given, low)
    t = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(a + 1):
                mix = weight * scale[c, b] + (prior if c == b else 0.0)
                t[a, b] += low[a, c] * mix
    for a in range(3):
        for b in range(3):
            acc = 0.0
            for c in range(b + 1):
                acc += t[a, c] * low[b, c]
            out[a, b] = acc / (prior + weight)


@cached_njit(error_model="numpy")
def _gate(n: int, s: Array, obs: Array, given: Array, has: BoolArray, ceiling: float) -> float:
    """Squared deviation above which the printed rule acts: nine mean squares, at most ``ceiling``."""
    low = np.empty((3, 3))
    inv = np.empty((3, 3))
    e = np.empty(3)
    total, hits = 0.0, 0
    for i in range(n):
        for j in range(obs.shape[1]):
            if has[i, j]:
                _root(given[i, j], low)
                invert3(given[i, j], inv)
                for a in range(3):
                    e[a] = obs[i, j, a] - s[i, a]
                total += _deviation(e, inv)
                hits += 1
    gate: float = min(9.0 * total / max(hits, 1), ceiling)
    return gate


@cached_njit(error_model="numpy")
def _middle(values: Array, count: int) -> float:
    """Median of the first ``count`` values, which are sorted in place."""
    for i in range(1, count):
        x = values[i]
        k = i
        while k > 0 and values[k - 1] > x:
            values[k] = values[k - 1]
            k -= 1
        values[k] = x
    half = count // 2
    middle: float = values[half] if count % 2 else 0.5 * (values[half - 1] + values[half])
    return middle


@cached_njit(error_model="numpy")
def _consensus(
    n: int, s: Array, obs: Array, has: BoolArray, span: int, single: Array, local: Array, hits: IntArray
) -> None:
    """Residuals, and their means within ``span`` steps, less the observers' median.

    The median takes away what is common to the observers: a trajectory that lags behind a manoeuvre, which is no fault
    of theirs. It needs three observers; with fewer the residuals stay as they are and ``hits`` is set to 0.

    Parameters
    ----------
    single, local, hits : outputs (n,m,3), (n,m,3), (n,m)
    """
    m = obs.shape[1]
    column = np.empty(m)
    for j in range(m):
        total = np.zeros(3)
        inside = 0
        for k in range(-span, n):  # running sum over [k - span, k + span] with k the centre
            ahead = k + span
            if ahead < n and ahead >= 0 and has[ahead, j]:
                inside += 1
                for a in range(3):
                    total[a] += obs[ahead, j, a] - s[ahead, a]
            behind = k - span - 1
            if behind >= 0 and has[behind, j]:
                inside -= 1
                for a in range(3):
                    total[a] -= obs[behind, j, a] - s[behind, a]
            if k >= 0:
                hits[k, j] = inside
                for a in range(3):
                    local[k, j, a] = total[a] / max(inside, 1)
                    single[k, j, a] = obs[k, j, a] - s[k, a]
    for i in range(n):
        for a in range(3):
            c1, c2 = 0, 0
            for j in range(m):
                if has[i, j]:
                    column[c1] = single[i, j, a]
                    c1 += 1
            mid = _middle(column, c1) if c1 >= 3 else 0.0
            for j in range(m):
                single[i, j, a] -= mid
            for j in range(m):
                if hits[i, j] > 0:
                    column[c2] = local[i, j, a]
                    c2 += 1
            mid = _middle(column, c2) if c2 >= 3 else 0.0
            for j in range(m):
                local[i, j, a] -= mid
                if c2 < 3:
                    hits[i, j] = 0


@cached_njit(error_model="numpy")
def reweight(
    rule: int,
    n: int,
    s: Array,
    tau: Array,
    obs: Array,
    given: Array,
    has: BoolArray,
    scale: Array,
    weight: Array,
    par: Array,
    r: Array,
    sound: BoolArray,
) -> None:
    """Fill ``r`` (n,m,3,3) with the covariances in force and ``sound`` (n,m) with whether they are not inflated.

    Parameters
    ----------
    rule : one of `LOCAL`, `GATE`, `STUDENT`, `NONE`
    s, tau : trajectory (n,10) and steps (n,)
    obs, given, has : observations (n,m,3), covariances as given (n,m,3,3), which exist (n,m)
    scale, weight : learnt second moment of the whitened residuals (m,3,3) and the number behind it (m,)
    par : span, drift gate, outlier gate, memory, degrees of freedom, prior count
    """
    base = np.empty((3, 3))
    inv = np.empty((3, 3))
    low = np.empty((3, 3))
    e = np.empty(3)
    gate = _gate(n, s, obs, given, has, par[2]) if rule == GATE else par[2]
    m = obs.shape[1]
    single = np.empty((n, m, 3))
    local = np.empty((n, m, 3))
    hits = np.zeros((n, m), dtype=np.int64)
    _consensus(n, s, obs, has, int(par[0]), single, local, hits)
    for j in range(m):
        for i in range(n):
            if not has[i, j]:
                continue
            _scaled(given[i, j], scale[j], weight[j], par[5], low, base)
            for a in range(3):
                e[a] = single[i, j, a] if rule == LOCAL else obs[i, j, a] - s[i, a]
                for b in range(3):
                    r[i, j, a, b] = base[a, b]
            sound[i, j] = True
            if rule == NONE:
                continue
            invert3(base, inv)
            dev = _deviation(e, inv)
            factor, keep = 0.0, 1.0
            if rule == STUDENT:
                keep = (par[4] + dev) / (par[4] + 3.0)
            elif rule == GATE:
                if dev > gate:
                    keep = par[3] / (par[3] + tau[i])
                    factor = tau[i] / (par[3] + tau[i])
            elif dev > gate:  # a lone outlier
                factor = 1.0
            if dev > gate:
                sound[i, j] = False
            for a in range(3):
                for b in range(3):
                    r[i, j, a, b] = keep * r[i, j, a, b] + factor * e[a] * e[b]
            if rule == LOCAL and hits[i, j] > 0:
                for a in range(3):
                    e[a] = local[i, j, a]
                t = hits[i, j] * _deviation(e, inv)
                if t > par[1]:
                    sound[i, j] = False
                    factor = hits[i, j] * (1.0 - par[1] / t)
                    for a in range(3):
                        for b in range(3):
                            r[i, j, a, b] += factor * e[a] * e[b]


@cached_njit(error_model="numpy")
def combine(n: int, obs: Array, has: BoolArray, r: Array, z: Array, rbar: Array, seen: BoolArray) -> None:
    """Combine the observers of each step into one observation ``z`` (n,3) of covariance ``rbar`` (n,3,3)."""
    inv = np.empty((3, 3))
    info = np.empty((3, 3))
    vec = np.empty(3)
    for i in range(n):
        seen[i] = False
        info[:] = 0.0
        vec[:] = 0.0
        for j in range(obs.shape[1]):
            if has[i, j]:
                seen[i] = True
                invert3(r[i, j], inv)
                for a in range(3):
                    for b in range(3):
                        info[a, b] += inv[a, b]
                        vec[a] += inv[a, b] * obs[i, j, b]
        if seen[i]:
            invert3(info, rbar[i])
            for a in range(3):
                z[i, a] = rbar[i, a, 0] * vec[0] + rbar[i, a, 1] * vec[1] + rbar[i, a, 2] * vec[2]


@cached_njit(error_model="numpy")
def learn_scale(
    s: Array,
    obs: Array,
    given: Array,
    has: BoolArray,
    sound: BoolArray,
    memory: float,
    scale: Array,
    weight: Array,
) -> None:
    """Take the residuals of one step into the learnt second moments, unless their covariance is inflated.

    Parameters
    ----------
    s, obs, given, has, sound : one step's state (10,), (m,3), (m,3,3), (m,), (m,)
    memory : number of residuals beyond which later ones displace earlier ones
    """
    low = np.empty((3, 3))
    e = np.empty(3)
    for j in range(obs.shape[0]):
        if not has[j] or not sound[j]:
            continue
        _root(given[j], low)
        for a in range(3):
            acc = obs[j, a] - s[a]
            for b in range(a):
                acc -= low[a, b] * e[b]
            e[a] = acc / low[a, a]
        w = min(weight[j], memory)
        for a in range(3):
            for b in range(3):
                scale[j, a, b] = (w * scale[j, a, b] + e[a] * e[b]) / (w + 1.0)
        weight[j] = w + 1.0

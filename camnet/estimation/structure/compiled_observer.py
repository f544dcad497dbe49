"""Distance observers 1 and 2 compiled: `distance_observer`, `stack` and `flow` in one pass over the features.

The symbols and equations are those of the three plain modules, which are its oracle; numbers in comments name them. The
past is kept in rings: ``place`` holds the index of the oldest entry and how many there are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.structure.key_view import KeyView
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.geometry.rotations_compiled import conjugate, exp, multiply, to_matrix
from camnet.types import Array, BoolArray, IntArray

__all__ = ["CompiledDistanceObserver"]

#: entries of a ring at first; it grows
_ENTRIES = 64


class _State(NamedTuple):
    d_ic: Array
    d_ik: Array
    d_kc: Array
    yy: Array
    yu: Array
    samples: IntArray
    psi: Array
    integral: Array
    last_u: Array
    last_k: Array
    last_v: Array
    q: Array


class _Ring(NamedTuple):
    """Entries: time, and for each of N features some numbers; ``pose`` holds q and v of a frame (flow)."""

    place: IntArray
    t: Array
    pose: Array
    value: Array


class _Gains(NamedTuple):
    k1: float
    k: float
    window_s: float
    least_y: float
    least_u: float
    low: float
    high: float
    lambda_a: float
    stack_lambda: float
    stack_size: int
    flow_s: float


class CompiledDistanceObserver:
    """Observer 1, or 2 where ``extended``; the interface is that of `DistanceObserver`.

    Parameters
    ----------
    count : number N of the key frame's features
    settings : see `ObserverSettings`
    extended : use the optical flow (observer 2)
    """

    def __init__(self, count: int, settings: ObserverSettings, extended: bool) -> None:
        s = settings
        self._extended = extended
        self._gains = _Gains(
            s.k1, s.k, s.window_s, s.least_y, s.least_u_m, *s.distance_m, s.lambda_a, s.stack_lambda, s.stack_size,
            s.flow_s,
        )  # fmt: skip
        self._state = _State(
            d_ic=np.full(count, s.start_m),
            d_ik=np.full(count, s.start_m),
            d_kc=np.zeros(1),
            yy=np.zeros(count),
            yu=np.zeros(count),
            samples=np.zeros(count, dtype=np.int64),
            psi=np.full((count, 2), np.nan),
            integral=np.zeros((count, 2)),
            last_u=np.full((count, 3), np.nan),
            last_k=np.full(3, np.nan),
            last_v=np.zeros(3),
            q=np.array([1.0, 0.0, 0.0, 0.0]),
        )
        # psi and the integral of Om (4 numbers a feature); u and the way so far (4)
        self._stack, self._flow = _ring(count), _ring(count)

    @property
    def d_ic(self) -> Array:
        """Distances (N,) from the camera, m."""
        return self._state.d_ic

    @property
    def d_ik(self) -> Array:
        """Distances (N,) from the key frame, m."""
        return self._state.d_ik

    @property
    def d_kc(self) -> float:
        """Distance of the key frame, m."""
        return float(self._state.d_kc[0])

    @property
    def learned(self) -> BoolArray:
        """Whether each distance is learned (N,)."""
        return np.asarray(self._state.yy > self._gains.stack_lambda)

    def depths(self, view: KeyView) -> Array:
        """``z`` (N,) in m: the estimated distances along the optical axis of a view."""
        return np.asarray(self.d_ic * view.u_ic[:, 2])

    def update(self, view: KeyView) -> None:
        """Advance over the frame that led to ``view`` and take it in."""
        self._stack, self._flow = _roomy(self._stack), _roomy(self._flow)
        _step(
            self._state, self._stack, self._flow, self._gains, self._extended, view.t_s, view.dt_s, view.u_ic,
            view.u_ik, view.r_kc, view.u_kc, view.v_cam, view.w_cam, view.informed, view.at_key,
        )  # fmt: skip


def _ring(count: int, entries: int = _ENTRIES) -> _Ring:
    return _Ring(
        np.zeros(2, dtype=np.int64), np.zeros(entries), np.zeros((entries, 7)), np.zeros((entries, count, 4))
    )


def _roomy(ring: _Ring) -> _Ring:
    """Return the ring, twice as large if it is full."""
    first, entries = int(ring.place[0]), len(ring.t)
    if ring.place[1] < entries:
        return ring
    larger = _ring(ring.value.shape[1], 2 * entries)
    order = (first + np.arange(entries)) % entries
    larger.place[1] = entries
    larger.t[:entries], larger.pose[:entries] = ring.t[order], ring.pose[order]
    larger.value[:entries] = ring.value[order]
    return larger


@cached_njit
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@cached_njit
def _push(ring: _Ring, t: float) -> int:
    """Index of a new entry."""
    at = (ring.place[0] + ring.place[1]) % len(ring.t)
    ring.place[1] += 1
    ring.t[at] = t
    return int(at)


@cached_njit
def _drop(ring: _Ring) -> None:
    ring.place[0] = (ring.place[0] + 1) % len(ring.t)
    ring.place[1] -= 1


@cached_njit
def _way(s: _State, i: int, u: Array, v: Array, dt: float) -> float:
    """``int -u^T v`` over the frame, by the trapezoidal rule; zero where it was seen at neither end."""
    then, now = -_dot(s.last_u[i], s.last_v), -_dot(u, v)
    if math.isnan(then):
        then = now
    if math.isnan(now):
        now = then
    return 0.0 if math.isnan(now) else 0.5 * dt * (then + now)


@cached_njit
def _step(
    s: _State, stack: _Ring, flow: _Ring, g: _Gains, extended: bool, t: float, dt: float, u_ic: Array, u_ik: Array,
    r_kc: Array, u_kc: Array, v: Array, w: Array, informed: bool, at_key: bool,
) -> None:  # fmt: skip
    """One view; see `DistanceObserver.update`."""
    count = len(s.d_ic)
    moving = dt > 0.0 and not at_key
    k_now, k_then = -_dot(u_kc, v), -_dot(s.last_k, s.last_v)
    if math.isnan(k_then):
        k_then = k_now
    k_way = 0.5 * dt * (k_now + k_then) if moving and not math.isnan(k_now) else 0.0
    way = np.zeros(count)
    if moving:
        for i in range(count):
            way[i] = _way(s, i, u_ic[i], v, dt)
    s.last_u[:], s.last_k[:], s.last_v[:] = u_ic, u_kc, v
    _learn(s, stack, g, t, way, k_way, u_ic, u_ik, r_kc, u_kc, informed, at_key)
    full, a, m, b, r_ba, r_bm = _window(s, flow, g, extended, t, dt, way, u_ic, v, w)
    total, learned = 0.0, 0
    keep = math.exp(-g.k1 * dt)
    for i in range(count):
        pull, target = 0.0, 0.0
        if full:
            power, drive = _drive(flow, i, a, m, b, r_ba, r_bm)
            if math.isfinite(power + drive):
                pull, target = g.k * power, g.k * drive
        if s.yy[i] > g.stack_lambda:
            x = s.yu[i] / s.yy[i]
            h = s.psi[i, 0] * x
            if math.isfinite(h):
                pull, target = pull + g.k1, target + g.k1 * h
                total, learned = total + s.psi[i, 1] * x, learned + 1
            s.d_ik[i] = keep * s.d_ik[i] + (1.0 - keep) * x
        d = s.d_ic[i] + way[i]
        decay = math.exp(-pull * dt)
        reach = (1.0 - decay) / pull if pull * dt > 1e-9 else dt
        s.d_ic[i] = decay * d + reach * target
    s.d_kc[0] += k_way
    if learned > 0:
        s.d_kc[0] = keep * s.d_kc[0] + (1.0 - keep) * total / learned


@cached_njit
def _learn(
    s: _State, ring: _Ring, g: _Gains, t: float, way: Array, k_way: float, u_ic: Array, u_ik: Array, r_kc: Array,
    u_kc: Array, informed: bool, at_key: bool,
) -> None:  # fmt: skip
    """`DistanceStack.update`."""
    count = len(way)
    for i in range(count):
        s.integral[i, 0] += way[i]
        s.integral[i, 1] += k_way
    if at_key:
        s.integral[:] = 0.0
        s.psi[:, 0], s.psi[:, 1] = 1.0, 0.0
        ring.place[1] = 0
    elif not informed:
        s.psi[:] = math.nan
        return
    else:
        while ring.place[1] > 0 and t - ring.t[ring.place[0]] > g.window_s:
            _drop(ring)
        first, there = ring.place[0], ring.place[1] > 0
        for i in range(count):
            f0, f1, f2 = _dot(r_kc[0], u_ik[i]), _dot(r_kc[1], u_ik[i]), _dot(r_kc[2], u_ik[i])
            c = _dot(u_ic[i], u_kc)
            along_i = u_ic[i, 0] * f0 + u_ic[i, 1] * f1 + u_ic[i, 2] * f2
            along_k = u_kc[0] * f0 + u_kc[1] * f1 + u_kc[2] * f2
            if not 1.0 - abs(c) > g.lambda_a:
                s.psi[i] = math.nan
                continue
            s.psi[i, 0] = (along_i - c * along_k) / (1.0 - c * c)
            s.psi[i, 1] = (c * along_i - along_k) / (1.0 - c * c)
            if there:
                _sample(s, g, i, ring.value[first, i])
    at = _push(ring, t)
    ring.value[at, :, :2], ring.value[at, :, 2:] = s.psi, s.integral


@cached_njit
def _sample(s: _State, g: _Gains, i: int, then: Array) -> None:
    """`DistanceStack._learn` of one feature."""
    y0, y1 = s.psi[i, 0] - then[0], s.psi[i, 1] - then[1]
    u0, u1 = s.integral[i, 0] - then[2], s.integral[i, 1] - then[3]
    yy, yu = y0 * y0 + y1 * y1, y0 * u0 + y1 * u1
    if not (yy >= g.least_y**2 and u0 * u0 + u1 * u1 >= g.least_u**2 and s.samples[i] < g.stack_size):
        return
    if g.low <= yu / yy <= g.high:
        s.yy[i] += yy
        s.yu[i] += yu
        s.samples[i] += 1


@cached_njit
def _window(
    s: _State, ring: _Ring, g: _Gains, extended: bool, t: float, dt: float, way: Array, u_ic: Array, v: Array,
    w: Array,
) -> tuple[bool, int, int, int, Array, Array]:  # fmt: skip
    """`FlowWindow.update`: whether a window is full, its first, middle and last entry, and the turns to the last."""
    r_ba, r_bm = np.eye(3), np.eye(3)
    if not extended:
        return False, 0, 0, 0, r_ba, r_bm
    entries = len(ring.t)
    s.q[:] = multiply(s.q, exp(dt * w))
    before = (ring.place[0] + ring.place[1] - 1) % entries
    had = ring.place[1] > 0
    b = _push(ring, t)
    ring.pose[b, :4], ring.pose[b, 4:] = s.q, v
    ring.value[b, :, :3] = u_ic
    for i in range(len(way)):
        ring.value[b, i, 3] = way[i] + (ring.value[before, i, 3] if had else 0.0)
    while ring.place[1] > 2 and t - ring.t[(ring.place[0] + 1) % entries] >= g.flow_s - 1e-9:
        _drop(ring)
    a = ring.place[0]
    m = (a + ring.place[1] // 2) % entries
    if t - ring.t[a] < g.flow_s - 1e-9:
        return False, 0, 0, 0, r_ba, r_bm
    to_b = conjugate(s.q)
    return (
        True,
        a,
        m,
        b,
        to_matrix(multiply(to_b, ring.pose[a, :4])),
        to_matrix(multiply(to_b, ring.pose[m, :4])),
    )


@cached_njit
def _drive(ring: _Ring, i: int, a: int, m: int, b: int, r_ba: Array, r_bm: Array) -> tuple[float, float]:
    """``xi^T xi`` and ``xi^T rho - xi^T xi lag`` of one feature."""
    h = ring.t[b] - ring.t[a]
    u_a, u_b, u_m, v_m = ring.value[a, i], ring.value[b, i], ring.value[m, i], ring.pose[m, 4:]
    along = _dot(u_m, v_m)
    f0, f1, f2 = u_m[0] * along - v_m[0], u_m[1] * along - v_m[1], u_m[2] * along - v_m[2]
    power, drive = 0.0, 0.0
    for k in range(3):
        xi = (u_b[k] - _dot(r_ba[k], u_a)) / h
        rho = r_bm[k, 0] * f0 + r_bm[k, 1] * f1 + r_bm[k, 2] * f2
        power += xi * xi
        drive += xi * rho
    return power, drive - power * (u_m[3] - u_b[3])

r"""The objective of a plan and its Gauss-Newton system, block-tridiagonal, in banded storage, compiled.

Negative logarithm of the plan's probability (li2019, (42)-(44)), over the states s_0 .. s_n of the horizon:

    1/2 sum |s_{i+1} - f(s_i)|^2_{Q_i^-1} + 1/2 sum |z_w - x(t_w)|^2_{R_w^-1} - sum log(1 - P_h(x(t_j)))
    + 1/2 int |x''|^2 / S_a dt

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| s | `s`: x, v, p, cT | (n,10) | m, m/s, m^2/s^3, rad/s | (14) |
| Q_i^-1 | `weight` | (n-1,10,10) | | (72) |
| z, R^-1 | `points[:,2:5]`, `points[:,5:14]`; step `points[:,0]`, share of it `points[:,1]` | (m,14) | m | (28) |
| d, m, l | distance to an obstacle, `shape[0]` margin, `shape[1]` softness | | m | |
| 1 - P_h | 1/(1 + exp((m - d)/l)) to the power `shape[2]` dt (a rate in 1/s) | | | (44) |
| h(u) | cubic Hermite weights of x_i, v_i, x_{i+1}, v_{i+1} | (4,) | | |

**Departures.** The last term is ours: in the steering model a constant power and turn rate cost nothing,
so that the most probable plan through far-off waypoints is a chain of wide fast loops, and descent creeps along
the flat valley towards it; weighing the acceleration gives the fewer manoeuvres the paper asks for. (44) looks
at the states alone; between them a plan can cross an obstacle. Here x(t) is the cubic
Hermite curve through the states' positions and velocities and P_h is taken several times a step. A point of the
curve depends on two neighbouring states, so the system stays block-tridiagonal. Q is frozen at the start of a
plan; otherwise Gauss-Newton would have no objective that decreases. The region's faces are obstacles from inside.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.control.planner.distance_kernel import signed_distance
from camnet.estimation.pls.noise import process_covariance, transition
from camnet.types import Array, BoolArray

__all__ = ["BAND", "evaluate", "hermite", "system", "weights"]

#: rows of the banded storage: a state and its neighbour
BAND = 20


@cached_njit(error_model="numpy")
def hermite(u: float, tau: float, h: Array) -> None:
    """Fill the weights ``h`` (4,) of x_i, v_i, x_{i+1}, v_{i+1} in the position at the share ``u`` of a step."""
    h[0] = (1.0 + 2.0 * u) * (1.0 - u) ** 2
    h[1] = tau * u * (1.0 - u) ** 2
    h[2] = u * u * (3.0 - 2.0 * u)
    h[3] = tau * u * u * (u - 1.0)


@cached_njit(error_model="numpy")
def weights(par: Array, tau: float, s: Array, rest_speed: float, resting: BoolArray) -> Array:
    """Inverse process covariances (n-1,10,10) about a trajectory ``s`` (n,10); ``resting`` (n-1,) is filled.

    Steps slower than ``rest_speed`` keep the constant-velocity limit for the whole descent: near rest the model's
    heading and dv/dp = 1/|v| change faster than a linearisation can follow.
    """
    n = s.shape[0] - 1
    out = np.empty((n, 10, 10))
    jac, nxt, q = np.empty((6, 7)), np.empty(10), np.empty((10, 10))
    for i in range(n):
        slow = s[i, 3] * s[i, 3] + s[i, 4] * s[i, 4] + s[i, 5] * s[i, 5] < rest_speed * rest_speed
        resting[i] = transition(par, s[i], tau, slow, nxt, jac)
        process_covariance(par, s[i], nxt, tau, resting[i], jac, q)
        inverse = np.linalg.inv(q)
        out[i] = 0.5 * (inverse + inverse.T)
    return out


@cached_njit(error_model="numpy")
def _softplus(x: float) -> float:
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


@cached_njit(error_model="numpy")
def _add_point(i: int, h: Array, grad: Array, hess: Array, g: Array, ab: Array) -> None:
    """Add gradient (3,) and curvature (3,3) by a point of the curve to those by the states i and i + 1."""
    base = 10 * i
    for a in range(4):
        ra = base + (3 * a if a < 2 else 10 + 3 * (a - 2))
        for k in range(3):
            g[ra + k] += h[a] * grad[k]
        for b in range(a + 1):
            rb = base + (3 * b if b < 2 else 10 + 3 * (b - 2))
            f = h[a] * h[b]
            for k in range(3):
                for m in range(3):
                    row, col = ra + k, rb + m
                    if row >= col:
                        ab[row - col, col] += f * hess[k, m]


@cached_njit(error_model="numpy")
def _position(s: Array, i: int, h: Array, p: Array) -> None:
    for k in range(3):
        p[k] = h[0] * s[i, k] + h[1] * s[i, 3 + k] + h[2] * s[i + 1, k] + h[3] * s[i + 1, 3 + k]


@cached_njit(error_model="numpy")
def _blocked(d: float, normal: Array, shape: Array, dt: float, grad: Array, hess: Array) -> float:
    """-log(1 - P_h) at distance ``d`` whose gradient is ``normal``; adds to ``grad`` and ``hess``."""
    x = (shape[0] - d) / shape[1]
    if x < -30.0:
        return 0.0
    rate = shape[2] * dt
    share = 1.0 / (1.0 + math.exp(-x))
    first, second = -rate * share / shape[1], rate * share * (1.0 - share) / shape[1] ** 2
    for k in range(3):
        grad[k] += first * normal[k]
        for m in range(3):
            hess[k, m] += second * normal[k] * normal[m]
    return float(rate * _softplus(x))


@cached_njit(error_model="numpy")
def _outline(p: Array, polygon: Array, normal: Array) -> float:
    """Depth of ``p`` inside a polygon (K,2), counter-clockwise, and its gradient."""
    best, inside = math.inf, False
    n = polygon.shape[0]
    for k in range(n):
        a, b = polygon[k], polygon[(k + 1) % n]
        ex, ey, px, py = b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1]
        t = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        dx, dy = px - t * ex, py - t * ey
        size = math.hypot(dx, dy)
        if size < best:
            best = size
            normal[0], normal[1] = dx / max(size, 1e-12), dy / max(size, 1e-12)
        if (a[1] > p[1]) != (b[1] > p[1]) and p[0] < a[0] + (p[1] - a[1]) * ex / ey:
            inside = not inside
    normal[2] = 0.0
    if inside:
        return float(best)
    normal[0], normal[1] = -normal[0], -normal[1]
    return float(-best)


@cached_njit(error_model="numpy")
def _region(
    p: Array, planes: Array, disc: Array, polygon: Array, shape: Array, dt: float, grad: Array, hess: Array
) -> float:
    cost, normal = 0.0, np.empty(3)
    for f in range(planes.shape[0]):
        for k in range(3):
            normal[k] = -planes[f, k]
        depth = planes[f, 3] - planes[f, 0] * p[0] - planes[f, 1] * p[1] - planes[f, 2] * p[2]
        cost += _blocked(depth, normal, shape, dt, grad, hess)
    if disc[2] > 0.0:
        x, y = p[0] - disc[0], p[1] - disc[1]
        away = math.hypot(x, y)
        normal[0], normal[1], normal[2] = -x / max(away, 1e-12), -y / max(away, 1e-12), 0.0
        cost += _blocked(disc[2] - away, normal, shape, dt, grad, hess)
    if polygon.shape[0] > 0:
        depth = _outline(p, polygon, normal)
        cost += _blocked(depth, normal, shape, dt, grad, hess)
    return cost


@cached_njit(error_model="numpy")
def _acceleration(tau: float, s: Array, precision: float, g: Array, ab: Array) -> float:
    """1/2 int |x''|^2 precision dt of the Hermite curve: the stiffness of a beam."""
    a, b, c, d = 12.0 / tau**3, 6.0 / tau**2, 4.0 / tau, 2.0 / tau
    k = precision * np.array([[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]])
    cost, at = 0.0, (0, 3, 10, 13)
    for i in range(s.shape[0] - 1):
        for axis in range(3):
            q = (s[i, axis], s[i, 3 + axis], s[i + 1, axis], s[i + 1, 3 + axis])
            for m in range(4):
                force = k[m, 0] * q[0] + k[m, 1] * q[1] + k[m, 2] * q[2] + k[m, 3] * q[3]
                cost += 0.5 * q[m] * force
                g[10 * i + at[m] + axis] += force
                for n in range(m + 1):
                    ab[at[m] - at[n], 10 * i + at[n] + axis] += k[m, n]
    return cost


@cached_njit(error_model="numpy")
def _process(
    par: Array, tau: float, s: Array, weight: Array, resting: BoolArray, g: Array, ab: Array, build: bool
) -> float:
    cost = 0.0
    jac, nxt, phi = np.empty((6, 7)), np.empty(10), np.eye(10)
    for i in range(s.shape[0] - 1):
        transition(par, s[i], tau, resting[i], nxt, jac)
        e = s[i + 1] - nxt
        we = np.dot(weight[i], e)
        cost += 0.5 * np.dot(e, we)
        if not build:
            continue
        phi[:6, 3:] = jac
        w_phi = np.dot(weight[i], phi)
        own = np.dot(phi.T, w_phi)
        back = np.dot(phi.T, we)
        a, b = 10 * i, 10 * (i + 1)
        for k in range(10):
            g[a + k] -= back[k]
            g[b + k] += we[k]
            for m in range(10):
                if k >= m:
                    ab[k - m, a + m] += own[k, m]
                    ab[k - m, b + m] += weight[i, k, m]
                ab[10 + k - m, a + m] -= w_phi[k, m]
    return cost


@cached_njit(error_model="numpy")
def evaluate(
    par: Array,
    tau: float,
    s: Array,
    weight: Array,
    resting: BoolArray,
    points: Array,
    start: Array,
    rows: Array,
    shape: Array,
    planes: Array,
    disc: Array,
    polygon: Array,
    edge: Array,
    samples: int,
    g: Array,
    ab: Array,
    build: bool,
) -> float:
    """Objective at ``s`` (n,10); with ``build`` also gradient ``g`` (10 n) and lower band ``ab`` (20, 10 n).

    Parameters
    ----------
    par, tau : model parameters, see `camnet.estimation.pls.noise.PARAMETERS`; step, s
    weight, resting : inverse process covariances and where the model is at rest, as `weights` gives them
    points : (m,14) step, share of the step, position (3,), information (3,3); see the module's table
    start : (10,) expected power and turn rate (4) of the first state, their inverse variances (4), the inverse
        variance of the last velocity about zero (0: free), and the inverse density 1/S_a
    rows : (K,19) obstacles
    shape, edge : (3,) margin m, softness m, rate 1/s of obstacles and of the region's border
    planes, disc, polygon : bounds of the region, as in `camnet.control.references.RegionBounds`
    samples : how many times a step obstacles are looked at
    """
    g[:] = 0.0
    ab[:] = 0.0
    cost = _process(par, tau, s, weight, resting, g, ab, build)
    cost += _acceleration(tau, s, start[9], g, ab)
    for k in range(4):
        away = s[0, 6 + k] - start[k]
        cost += 0.5 * start[4 + k] * away * away
        g[6 + k] += start[4 + k] * away
        ab[0, 6 + k] += start[4 + k]
    last = 10 * (s.shape[0] - 1)
    for k in range(3, 6):
        cost += 0.5 * start[8] * s[-1, k] * s[-1, k]
        g[last + k] += start[8] * s[-1, k]
        ab[0, last + k] += start[8]
    h, p, normal, grad, hess = np.empty(4), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for j in range(points.shape[0]):
        i = int(points[j, 0])
        hermite(points[j, 1], tau, h)
        _position(s, i, h, p)
        for k in range(3):
            grad[k] = 0.0
            for m in range(3):
                hess[k, m] = points[j, 5 + 3 * k + m]
                grad[k] += hess[k, m] * (p[m] - points[j, 2 + m])
            cost += 0.5 * grad[k] * (p[k] - points[j, 2 + k])
        _add_point(i, h, grad, hess, g, ab)
    bounded = planes.shape[0] + polygon.shape[0] > 0 or disc[2] > 0.0
    if rows.shape[0] > 0 or bounded:
        dt = tau / samples
        for i in range(s.shape[0] - 1):
            for j in range(samples):
                u = (j + 0.5) / samples
                hermite(u, tau, h)
                _position(s, i, h, p)
                grad[:] = 0.0
                hess[:] = 0.0
                value = 0.0
                for o in range(rows.shape[0]):
                    d = signed_distance(rows[o], p, tau * (i + u), normal)
                    value += _blocked(d, normal, shape, dt, grad, hess)
                if bounded:
                    value += _region(p, planes, disc, polygon, edge, dt, grad, hess)
                if value > 0.0:
                    cost += value
                    _add_point(i, h, grad, hess, g, ab)
    return cost


@cached_njit(error_model="numpy")
def system(g: Array, ab: Array) -> None:
    """Hold position and velocity of the first state: their rows and columns become those of the identity."""
    for k in range(6):
        g[k] = 0.0
        for m in range(BAND):
            ab[m, k] = 0.0
            if k - m >= 0:
                ab[m, k - m] = 0.0
        ab[0, k] = 1.0

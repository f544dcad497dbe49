"""What cameras see and measure, on the truth: regions, views, sight lines, noise.

The rules are those of `camnet.sensing.visibility` and `camnet.sensing.pose_sensor`; numbers are drawn in their order,
so the noise of one seed is the same. Sight lines are blocked by agents (cylinders), targets (boxes) and occluders'
convex parts, analytically; the agent around the camera and the target that a point belongs to do not block
(`camnet.world.pybullet.sight`).
"""

from __future__ import annotations

import math

import numpy as np

from camnet.batch.compiled import inner, inner_owner
from camnet.batch.network import CYLINDER, POLYTOPE, Model
from camnet.batch.own_pose import as_believed, radius_of
from camnet.batch.random import normals, uniform
from camnet.batch.reference import clearance
from camnet.batch.state import State
from camnet.batch.triples import turn
from camnet.geometry.polytope import signed_distance
from camnet.geometry.solid_lines import passes_through
from camnet.geometry.triples import Quaternion, Triple, multiply, rotate, rotate_inverse
from camnet.types import Array

__all__ = ["contains", "distance_to", "sense"]

#: features lie on surfaces: a sight line ends this much before its point, m
_SHORT_OF_POINT_M = 2e-3


@inner
def contains(model: Model, j: int, p: Triple) -> bool:
    """Whether region ``j`` holds a point."""
    for i in range(3):
        if p[i] < model.boxes[j, 0, i] or p[i] > model.boxes[j, 1, i]:
            return False
    if model.kind[j] == 0:
        return True
    return clearance(p, j, model.planes, model.plane_ends, model.discs) >= 0.0


@inner_owner
def _to_polytope(p: Triple, planes: Array, surface: Array) -> float:
    point = np.array([[p[0], p[1], p[2]]])
    a, b = np.ascontiguousarray(planes[:, :3]), planes[:, 3].copy()
    return float(signed_distance(point, a, b, surface)[0])


@inner
def distance_to(model: Model, j: int, p: Triple) -> float:
    """Signed distance of a point to region ``j``, negative inside."""
    kind = model.kind[j]
    if kind == POLYTOPE:
        surface = model.triangles[model.triangle_ends[j] : model.triangle_ends[j + 1]]
        return _to_polytope(p, model.planes[model.plane_ends[j] : model.plane_ends[j + 1]], surface)
    dz = max(model.boxes[j, 0, 2] - p[2], p[2] - model.boxes[j, 1, 2])
    if kind == CYLINDER:
        dx, dy = p[0] - model.discs[j, 0], p[1] - model.discs[j, 1]
        dx, dy = math.sqrt(dx * dx + dy * dy) - model.discs[j, 2], -math.inf
    else:
        dx = max(model.boxes[j, 0, 0] - p[0], p[0] - model.boxes[j, 1, 0])
        dy = max(model.boxes[j, 0, 1] - p[1], p[1] - model.boxes[j, 1, 1])
    deepest = max(dx, dy, dz)
    if deepest <= 0.0:
        return deepest
    dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@inner
def _point_of(model: Model, state: State, e: int, m: int, f: int) -> Triple:
    """Feature ``f`` of target ``m`` in the world."""
    t = state.target
    q: Quaternion = (t[e, m, 3], t[e, m, 4], t[e, m, 5], t[e, m, 6])
    x, y, z = rotate(q, (model.features[f, 0], model.features[f, 1], model.features[f, 2]))
    return t[e, m, 0] + x, t[e, m, 1] + y, t[e, m, 2] + z


@inner
def _in_view(model: Model, state: State, e: int, c: int, m: int) -> bool:
    """Whether all features of a target are in a camera's frustum."""
    cam = state.cameras
    q: Quaternion = (cam[e, c, 3], cam[e, c, 4], cam[e, c, 5], cam[e, c, 6])
    for f in range(model.feature_ends[m], model.feature_ends[m + 1]):
        p = _point_of(model, state, e, m, f)
        x, y, z = rotate_inverse(q, (p[0] - cam[e, c, 0], p[1] - cam[e, c, 1], p[2] - cam[e, c, 2]))
        for k in range(6):
            a = model.frusta
            if a[c, k, 0] * x + a[c, k, 1] * y + a[c, k, 2] * z > model.reach[c, k]:
                return False
    return True


@inner
def _slab(start: float, step: float, low: float, high: float, near: float, far: float) -> tuple[float, float]:
    """Part [near, far] of a line that lies between two parallel planes; empty when near > far."""
    if abs(step) < 1e-15:
        return (near, far) if low <= start <= high else (1.0, 0.0)
    a, b = (low - start) / step, (high - start) / step
    return max(near, min(a, b)), min(far, max(a, b))


@inner
def _meets_box(model: Model, state: State, e: int, m: int, a: Triple, d: Triple) -> bool:
    """Whether the line a + s d, s in [0, 1], meets the box of target ``m``."""
    t, size = state.target, model.sizes
    q: Quaternion = (t[e, m, 3], t[e, m, 4], t[e, m, 5], t[e, m, 6])
    start = rotate_inverse(q, (a[0] - t[e, m, 0], a[1] - t[e, m, 1], a[2] - t[e, m, 2]))
    step = rotate_inverse(q, d)
    near, far = _slab(start[0], step[0], -0.5 * size[m, 0], 0.5 * size[m, 0], 0.0, 1.0)
    near, far = _slab(start[1], step[1], -0.5 * size[m, 1], 0.5 * size[m, 1], near, far)
    near, far = _slab(start[2], step[2], 0.0, size[m, 2], near, far)
    return near <= far


@inner
def _meets_agent(model: Model, state: State, e: int, n: int, a: Triple, d: Triple) -> bool:
    """Whether the line a + s d, s in [0, 1], meets the cylinder of agent ``n``."""
    b, radius = state.bodies, model.body[0]
    q: Quaternion = (b[e, n, 6], b[e, n, 3], b[e, n, 4], b[e, n, 5])
    s = rotate_inverse(q, (a[0] - b[e, n, 0], a[1] - b[e, n, 1], a[2] - b[e, n, 2]))
    g = rotate_inverse(q, d)
    near, far = _slab(s[2], g[2], -0.5 * model.body[1], 0.5 * model.body[1], 0.0, 1.0)
    square = g[0] * g[0] + g[1] * g[1]
    if square < 1e-18:
        return near <= far and s[0] * s[0] + s[1] * s[1] <= radius * radius
    half = s[0] * g[0] + s[1] * g[1]
    root = half * half - square * (s[0] * s[0] + s[1] * s[1] - radius * radius)
    if root < 0.0:
        return False
    root = math.sqrt(root)
    return max(near, (-half - root) / square) <= min(far, (-half + root) / square)


@inner
def _clear(model: Model, state: State, e: int, c: int, m: int, point: Triple) -> bool:
    """Whether nothing blocks the line from camera ``c`` to a point of target ``m``."""
    cam, n_agents = state.cameras, state.bodies.shape[1]
    o = (cam[e, c, 0], cam[e, c, 1], cam[e, c, 2])
    d = (point[0] - o[0], point[1] - o[1], point[2] - o[2])
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    scale = max(length - _SHORT_OF_POINT_M, 0.0) / max(length, 1e-12)
    d = (scale * d[0], scale * d[1], scale * d[2])
    for n in range(n_agents):
        if n != c and _meets_agent(model, state, e, n, o, d):
            return False
    clear = not passes_through(o, d, model.solid_normals, model.solid_limits, model.solid_ptr)
    for k in range(state.target.shape[1]):
        clear = clear and (k == m or not _meets_box(model, state, e, k, o, d))
    return clear


@inner
def _sees(model: Model, state: State, e: int, c: int, m: int) -> bool:
    if not _in_view(model, state, e, c, m):
        return False
    if model.occlusion:
        for f in range(model.feature_ends[m], model.feature_ends[m + 1]):
            if not _clear(model, state, e, c, m, _point_of(model, state, e, m, f)):
                return False
    return True


@inner
def _measure(model: Model, state: State, e: int, c: int, m: int, noise: Array, nearest: float) -> float:
    """Put the pose that camera ``c`` measures in place if it is nearer than ``nearest``; squared distance then."""
    cam, t = state.cameras, state.target
    q: Quaternion = (cam[e, c, 3], cam[e, c, 4], cam[e, c, 5], cam[e, c, 6])
    inverse = (q[0], -q[1], -q[2], -q[3])
    away = rotate(inverse, (t[e, m, 0] - cam[e, c, 0], t[e, m, 1] - cam[e, c, 1], t[e, m, 2] - cam[e, c, 2]))
    s_p, s_r = model.noise[0], model.noise[1]
    x, y, z = away[0] + s_p * noise[0], away[1] + s_p * noise[1], away[2] + s_p * noise[2]
    square = x * x + y * y + z * z
    if square >= nearest:
        return nearest
    wobble = turn(s_r * noise[3], s_r * noise[4], s_r * noise[5])
    seen = multiply(wobble, multiply(inverse, (t[e, m, 3], t[e, m, 4], t[e, m, 5], t[e, m, 6])))
    p, full = rotate(q, (x, y, z)), multiply(q, seen)
    norm = 1.0 / math.sqrt(full[0] ** 2 + full[1] ** 2 + full[2] ** 2 + full[3] ** 2)
    base, p, full = as_believed(model, state, e, c, p, full)
    state.own_m[e, m] = radius_of(model, state, e, c, p)
    for i in range(3):
        state.measured[e, m, i] = base[i] + p[i]
    for i in range(4):
        state.measured[e, m, 3 + i] = norm * full[i]
    state.measured[e, m, 7] = c
    return square


@inner
def _look(model: Model, state: State, e: int) -> None:
    """Decide where targets are and who sees them."""
    n_agents = state.bodies.shape[1]
    for m in range(state.target.shape[1]):
        p = (state.target[e, m, 0], state.target[e, m, 1], state.target[e, m, 2])
        state.region[e, m] = -1
        for c in range(state.cameras.shape[1]):
            inside = contains(model, c, p)
            if inside and state.region[e, m] < 0:
                state.region[e, m] = c
            works = state.working[e, c] == 1 and (inside or c >= n_agents)
            seen = works and _sees(model, state, e, c, m)
            state.visible[e, c, m] = 1 if seen else 0


@inner
def sense(model: Model, state: State, e: int, noise: Array) -> None:
    """Look around and measure; ``noise`` (C, M, 6) is scratch. ``measured`` holds the nearest camera's pose."""
    _look(model, state, e)
    row = e * (2 + state.target.shape[1])
    cameras, targets = state.cameras.shape[1], state.target.shape[1]
    normals(state.streams, row, noise)
    for m in range(targets):
        state.measured[e, m, 7] = -1.0
    for c in range(cameras):
        for m in range(targets):
            kept = uniform(state.streams, row) >= model.noise[2]
            if state.visible[e, c, m] == 1 and kept:
                # the squared distance of the best so far waits in the noise of camera 0, which has been used
                nearest = (
                    math.inf if state.measured[e, m, 7] < 0 else noise[int(state.measured[e, m, 7]), m, 0]
                )
                noise[c, m, 0] = _measure(model, state, e, c, m, noise[c, m], nearest)

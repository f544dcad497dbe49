"""Which bodies touch: agents are upright or tilted cylinders, targets boxes, the ground is level.

Two bodies are apart if something separates them: one of the axes tried here, or the line between the points named. A
pair that is too far apart to touch whatever way it is turned is sorted out first, by numbers (``*_reach``) that
`camnet.batch.lane_touches` goes by as well, four agents at a time.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inlined, inner
from camnet.batch.network import Model
from camnet.batch.state import COLLISIONS, State
from camnet.geometry.triples import Quaternion, rotate, rotate_inverse

__all__ = ["agents_reach", "collided", "ground_reach", "note_touches", "target_reach"]


@inlined
def agents_reach(model: Model) -> float:
    """Square of the distance of two agents' middles beyond which they do not touch, m^2."""
    return 4.0 * (model.body[0] ** 2 + 0.25 * model.body[1] ** 2)


@inlined
def ground_reach(model: Model) -> float:
    """Height of an agent's middle above which it does not touch the ground, m."""
    return model.body[0] + model.body[1]


@inlined
def target_reach(model: Model, m: int) -> float:
    """Square of the distance of an agent's middle from the foot of target ``m`` beyond which they do not touch, m^2."""
    hx, hy, hz = 0.5 * model.sizes[m, 0], 0.5 * model.sizes[m, 1], 0.5 * model.sizes[m, 2]
    far = hx + hy + 2.0 * hz + model.body[0] + model.body[1]
    return far * far


@inner
def _axis_of(state: State, e: int, n: int) -> tuple[float, float, float]:
    """Return the body's z axis."""
    b = state.bodies
    return rotate((b[e, n, 6], b[e, n, 3], b[e, n, 4], b[e, n, 5]), (0.0, 0.0, 1.0))


@inner
def _half_width(model: Model, along: float) -> float:
    """Half the extent of an agent's cylinder along a unit vector that makes the cosine ``along`` with its axis."""
    return 0.5 * model.body[1] * abs(along) + model.body[0] * math.sqrt(max(1.0 - along * along, 0.0))


@inner
def _touches_target(model: Model, state: State, e: int, n: int, m: int) -> bool:
    """Whether an agent's cylinder meets a target's box: no axis of theirs, nor the line between, separates them."""
    t, b = state.target, state.bodies
    hx, hy, hz = 0.5 * model.sizes[m, 0], 0.5 * model.sizes[m, 1], 0.5 * model.sizes[m, 2]
    away = (b[e, n, 0] - t[e, m, 0], b[e, n, 1] - t[e, m, 1], b[e, n, 2] - t[e, m, 2])
    if away[0] * away[0] + away[1] * away[1] + away[2] * away[2] > target_reach(model, m):
        return False
    q: Quaternion = (t[e, m, 3], t[e, m, 4], t[e, m, 5], t[e, m, 6])
    x, y, z = rotate_inverse(q, away)
    z -= hz
    a = rotate_inverse(q, _axis_of(state, e, n))
    if (
        abs(x) > hx + _half_width(model, a[0])
        or abs(y) > hy + _half_width(model, a[1])
        or abs(z) > hz + _half_width(model, a[2])
    ):
        return False
    reach = hx * abs(a[0]) + hy * abs(a[1]) + hz * abs(a[2])
    if abs(x * a[0] + y * a[1] + z * a[2]) > reach + 0.5 * model.body[1]:
        return False
    # from the nearest point of the box to the agent's middle
    ux, uy, uz = x - min(max(x, -hx), hx), y - min(max(y, -hy), hy), z - min(max(z, -hz), hz)
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    if length < 1e-9:
        return True
    return length <= _half_width(model, (ux * a[0] + uy * a[1] + uz * a[2]) / length)


@inner
def _touches_agent(model: Model, state: State, e: int, n: int, k: int) -> bool:
    """Whether two agents' cylinders meet: neither axis nor the line between their middles separates them."""
    b = state.bodies
    x, y, z = b[e, n, 0] - b[e, k, 0], b[e, n, 1] - b[e, k, 1], b[e, n, 2] - b[e, k, 2]
    square = x * x + y * y + z * z
    if square > agents_reach(model):
        return False
    length = math.sqrt(square)
    if length < 1e-9:
        return True
    a, c = _axis_of(state, e, n), _axis_of(state, e, k)
    along_a, along_c = (x * a[0] + y * a[1] + z * a[2]), (x * c[0] + y * c[1] + z * c[2])
    both = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    half = 0.5 * model.body[1]
    return (
        length <= _half_width(model, along_a / length) + _half_width(model, along_c / length)
        and abs(along_a) <= half + _half_width(model, both)
        and abs(along_c) <= half + _half_width(model, both)
    )


@inner
def _touches_ground(model: Model, state: State, e: int, n: int) -> bool:
    height = state.bodies[e, n, 2]
    if height > ground_reach(model):
        return False
    return height <= _half_width(model, _axis_of(state, e, n)[2])


@inner
def _note(state: State, e: int, n: int, k: int, touching: bool) -> None:
    """Note a pair; a collision counts once, when it starts."""
    if touching and state.touching[e, n, k] == 0:
        state.count[e, COLLISIONS] += 1.0
    state.touching[e, n, k] = 1 if touching else 0


@inner
def note_touches(model: Model, state: State, e: int) -> None:
    """Note who touches whom now."""
    agents, targets = state.bodies.shape[1], state.target.shape[1]
    for n in range(agents):
        for k in range(n):
            _note(state, e, n, k, _touches_agent(model, state, e, n, k))
        _note(state, e, n, agents, _touches_ground(model, state, e, n))
        for m in range(targets):
            _note(state, e, n, agents + 1 + m, _touches_target(model, state, e, n, m))


@inner
def collided(state: State, e: int) -> bool:
    """Whether anything touches now."""
    for n in range(state.touching.shape[1]):
        for k in range(state.touching.shape[2]):
            if state.touching[e, n, k] == 1:
                return True
    return False

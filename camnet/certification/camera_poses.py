r"""Changes of one camera's pose: moved, raised, tilted, and the smallest of them that meets a condition.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| psi | ``half`` | rad | half the angle of view, atan(footprint / (2 height)) of the camera looking straight down |
| (dx, dy), dz | ``east_m, north_m``, ``up_m`` | m | move and raise |
| beta, phi | ``tilt_rad``, ``towards_rad`` | rad | optical axis turned from straight down by beta towards phi |

A camera is taken to see the ground as far as its image reaches, up to ``RANGE_HEIGHTS`` times its height.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Views
from camnet.types import Array

__all__ = ["RANGE_HEIGHTS", "FoundChange", "PoseChange", "changed_view", "smallest_changes"]

#: range of a camera in heights above the ground
RANGE_HEIGHTS = 2.0
#: directions in which cameras are moved and tilted
_DIRECTIONS = 8
#: first steps of the search, as shares of the largest change, and halvings that refine it
_STEPS = (0.1, 0.25, 0.45, 0.7, 1.0)
_HALVINGS = 5


@dataclass(frozen=True, slots=True)
class PoseChange:
    """One change of a camera that looks straight down; see the table above."""

    east_m: float = 0.0
    north_m: float = 0.0
    up_m: float = 0.0
    tilt_rad: float = 0.0
    towards_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class FoundChange:
    """The smallest change of one kind that meets the condition.

    Attributes
    ----------
    kind : ``move``, ``raise`` or ``tilt``
    amount, unit : by how much, m or degrees
    change : the change itself
    cost : for ranking: move over footprint, raise over height, tilt over half the angle of view
    """

    kind: str
    amount: float
    unit: str
    change: PoseChange
    cost: float


def changed_view(centre_xy: Array, height_m: float, footprint_m: float, change: PoseChange) -> Views:
    """Return the view of one camera after a change.

    Parameters
    ----------
    centre_xy : (2,) place of the camera before
    height_m, footprint_m : its height, and the side of its square view at z = 0, before
    """
    half = math.atan2(0.5 * footprint_m, height_m)
    c, s = math.cos(half), math.sin(half)
    sides = np.array([[c, 0, s], [-c, 0, s], [0, c, s], [0, -c, s]])  # outward, straight down
    ahead = np.array([math.cos(change.towards_rad), math.sin(change.towards_rad), 0.0])
    axis = np.array([-ahead[1], ahead[0], 0.0])
    cos, sin = math.cos(change.tilt_rad), math.sin(change.tilt_rad)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    # from straight down towards ``ahead`` is a turn by -tilt about ``axis``
    turn = np.eye(3) - sin * cross + (1.0 - cos) * cross @ cross
    normals = sides @ turn.T
    height = height_m + change.up_m
    eye = np.array([centre_xy[0] + change.east_m, centre_xy[1] + change.north_m, height])
    look = turn @ np.array([0.0, 0.0, -1.0])
    normals = np.r_[normals, [-look], [look]]
    offsets = normals @ eye + np.array([0, 0, 0, 0, -0.01 * height, RANGE_HEIGHTS * height])
    reach = 2.0 * RANGE_HEIGHTS * height
    corners = np.array([[eye - reach, eye + reach]])
    return Views.create(normals[None], offsets[None], corners, eye[None])


def smallest_changes(
    good: Callable[[PoseChange], bool], height_m: float, footprint_m: float
) -> list[FoundChange]:
    """Return the smallest move, raise and tilt for which ``good`` holds, the cheapest first.

    Every direction is searched in steps of growing size, and the first that is good is refined by halving; a smaller
    good one between two steps that are not may be missed. Moves go to two footprints, raises to twice the height, and
    tilts as far as the upper side of the image meets the ground within the camera's range.
    """
    half = math.atan2(0.5 * footprint_m, height_m)
    angles = 2.0 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    largest_tilt = max(0.0, math.acos(1.0 / RANGE_HEIGHTS) - half)
    kinds: dict[str, tuple[list[Callable[[float], PoseChange]], float, float, str, float]] = {
        "move": ([_mover(a) for a in angles.tolist()], 2.0 * footprint_m, 1.0, "m", footprint_m),
        "raise": ([lambda x: PoseChange(up_m=x)], height_m, 1.0, "m", height_m),
        "tilt": ([_tilter(a) for a in angles.tolist()], largest_tilt, math.degrees(1.0), "degrees", half),
    }
    found = []
    for kind, (makers, largest, scale, unit, unit_cost) in kinds.items():
        best = math.inf
        for make in makers:
            amount = _smallest(good, make, min(largest, best))
            if amount < best:
                best, change = amount, make(amount)
        if math.isfinite(best):
            found.append(FoundChange(kind, best * scale, unit, change, best / unit_cost))
    return sorted(found, key=lambda f: f.cost)


def _mover(angle: float) -> Callable[[float], PoseChange]:
    return lambda x: PoseChange(east_m=x * math.cos(angle), north_m=x * math.sin(angle))


def _tilter(angle: float) -> Callable[[float], PoseChange]:
    return lambda x: PoseChange(tilt_rad=x, towards_rad=angle)


def _smallest(
    good: Callable[[PoseChange], bool], make: Callable[[float], PoseChange], largest: float
) -> float:
    """Return the smallest good amount that the search finds up to ``largest``, else inf."""
    below = 0.0
    for share in _STEPS:
        above = share * largest
        if above > 0.0 and good(make(above)):
            for _ in range(_HALVINGS):
                middle = 0.5 * (below + above)
                below, above = (below, middle) if good(make(middle)) else (middle, above)
            return above
        below = above
    return math.inf

r"""Candidate cameras of a site: mounts along its walls or outline, and every camera and direction at each of them.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| p | ``position_m`` | m | optical centre |
| | ``look_at_m`` | m | point on the optical axis, ``_AXIS_M`` away |
| alpha, beta | ``pan_deg``, ``tilt_deg`` | degrees | optical axis: counter-clockwise from x; below the horizon |

Places and directions are rounded to what a world file holds, so that the file describes exactly the camera that was
looked at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import shapely

from camnet.certification.coverage import Views
from camnet.errors import ConfigError
from camnet.geometry.frustum import Frustum
from camnet.geometry.mount_tolerance import MountTolerance, held_frustum
from camnet.geometry.regions import Region
from camnet.geometry.rotations import look_at
from camnet.geometry.settings import CameraModel
from camnet.importers.mounts import Mount
from camnet.types import Array, IntArray

__all__ = ["ADD", "BRACKET_M", "MOVE", "TURN", "Candidates", "candidates_at", "outline_mounts", "wall_mounts"]

#: a camera of the catalogue; one that stands, turned where it is, or taken to a mount
ADD, TURN, MOVE = 0, 1, 2
#: a camera on a wall stands this far off it, m
BRACKET_M = 0.1
#: the outline of a site runs this far outside its ways and walls, m
_OUTSIDE_M = 1.0
#: distance of the point that a camera looks at, m
_AXIS_M = 10.0
#: most candidates: cameras, places and directions
_MOST_CANDIDATES = 100_000
#: most places along walls or outline
_MOST_MOUNTS = 10_000


@dataclass(frozen=True, eq=False)
class Candidates:
    """Cameras at mounts, each in one direction.

    Attributes
    ----------
    position_m, look_at_m : (n, 3) optical centres, and points on the optical axes, m
    model, mount : (n,) numbers of the camera's model and of the mount
    pan_deg, tilt_deg : (n,) direction of the optical axis, degrees
    kind : (n,) ``ADD``, ``TURN`` or ``MOVE``
    of : (n,) turned: number of the camera that stands; moved: number of its model among those; else -1
    """

    position_m: Array
    look_at_m: Array
    model: IntArray
    mount: IntArray
    pan_deg: Array
    tilt_deg: Array
    kind: IntArray
    of: IntArray

    def __len__(self) -> int:
        """Return the number of candidates."""
        return len(self.model)

    def only(self, rows: IntArray) -> Candidates:
        """Return some of the candidates."""
        return Candidates(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @classmethod
    def joined(cls, parts: Sequence[Candidates]) -> Candidates:
        """Return the candidates of all parts, one after the other."""
        return cls(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)})

    def views(
        self, models: Sequence[CameraModel], rows: IntArray, tolerance: MountTolerance | None = None
    ) -> Views:
        """Return the fields of view of some of the candidates; with a tolerance, what they see at every pose in it."""
        order = np.argsort(self.model[rows], kind="stable")
        parts = []
        for k, model in enumerate(models):
            of = rows[order][self.model[rows][order] == k]
            p, q = self.position_m[of], look_at(self.position_m[of], self.look_at_m[of])
            parts.append(_frustum(model, tolerance).in_world(p, q))
        back = np.argsort(order, kind="stable")
        a, b, corners = (
            np.concatenate([getattr(f, name) for f in parts])[back] for name in ("A", "b", "corners")
        )
        return Views.create(a, b, corners, self.position_m[rows])


def _frustum(model: CameraModel, tolerance: MountTolerance | None) -> Frustum:
    whole = Frustum.from_camera(model)
    if tolerance is None:
        return whole
    held = held_frustum(whole, tolerance.position_m, tolerance.angle_deg)
    if held is None:
        raise ConfigError(
            f"--mount-tolerance {tolerance.position_m:g},{tolerance.angle_deg:g}: camera {model.name!r} sees nothing "
            "at every pose within it: install more exactly, or leave the camera out of the catalogue"
        )
    return held


def candidates_at(
    mounts: Sequence[Mount],
    models: Sequence[CameraModel],
    step_deg: float,
    kind: int = ADD,
    of: int = -1,
    first: tuple[int, int] = (0, 0),
) -> Candidates:
    """Return every model at every mount, in directions ``step_deg`` apart within what the mount allows.

    ``first`` are the numbers of the first model and of the first mount; ``kind``, ``of``: see `Candidates`.

    Raises
    ------
    ConfigError
        There are too many.
    """
    directions = [[(pan, tilt) for pan in _pans(m, step_deg) for tilt in _tilts(m, step_deg)] for m in mounts]
    count = len(models) * sum(map(len, directions))
    if count > _MOST_CANDIDATES:
        raise ConfigError(
            f"--aim-step {step_deg:g}: {count:,} candidates ({len(mounts)} mounts, {len(models)} cameras), more than "
            f"{_MOST_CANDIDATES:,}: take larger steps, fewer mounts, or a shorter catalogue"
        )
    rows = [
        (m.x_m, m.y_m, m.z_m, pan, tilt, model, k)
        for k, (m, of) in enumerate(zip(mounts, directions, strict=True))
        for pan, tilt in of
        for model in range(len(models))
    ]
    table = np.array(rows, dtype=float).reshape(-1, 7)
    pan, tilt = np.radians(table[:, 3]), np.radians(table[:, 4])
    axis = np.stack([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), -np.sin(tilt)], axis=1)
    place = np.round(table[:, :3], 3)
    look = np.round(place + _AXIS_M * axis, 3)
    return Candidates(
        place,
        look,
        table[:, 5].astype(np.int64) + first[0],
        table[:, 6].astype(np.int64) + first[1],
        table[:, 3],
        table[:, 4],
        np.full(count, kind, dtype=np.int64),
        np.full(count, of, dtype=np.int64),
    )


def _pans(mount: Mount, step: float) -> list[float]:
    low, high = mount.pan_deg
    if high - low >= 360.0:
        count = math.ceil(360.0 / step)
        return [low + 360.0 * k / count for k in range(count)]
    count = max(1, math.ceil((high - low) / step - 1e-9))
    return sorted({low + (high - low) * k / count for k in range(count + 1)})


def _tilts(mount: Mount, step: float) -> list[float]:
    """Return tilts on the grid of the step, less the ends where a camera looks straight down or up.

    The horizon is one of them only where the mount allows to look above it.
    """
    low, high = mount.tilt_deg
    count = math.ceil(89.9 / step) - 1
    grid = [k * step for k in range(-count if low < 0.0 else 1, count + 1)]
    inner = [t for t in grid if low - 1e-9 <= t <= high + 1e-9]
    return inner or sorted({low, 0.5 * (low + high), high})


def wall_mounts(
    solids: Sequence[Region], spacing_m: float, height_m: float, bracket_m: float = BRACKET_M
) -> list[Mount]:
    """Return mounts every ``spacing_m`` along walls that reach ``height_m``, and at their outer corners.

    Along a wall a camera may look anywhere away from it, at an outer corner along both walls too. Places inside another
    solid are left out. Cameras stand ``bracket_m`` off the wall.

    Raises
    ------
    ConfigError
        No wall is as high as that, or there are too many places.
    """
    walls = [s for s in solids if s.height[0] < height_m <= s.height[1]]
    if not walls:
        highest = max((float(s.height[1]) for s in solids), default=0.0)
        what = f"the highest wall ends at {highest:g} m" if solids else "the world has no occluders"
        raise ConfigError(
            f"--mounts walls:{spacing_m:g},{height_m:g}: {what}; give a height that a wall reaches, "
            f"outline:{spacing_m:g},{height_m:g} for masts around the site, or a file"
        )
    length = sum(shapely.Polygon(w.footprint()).length for w in walls)
    _bounded("walls", length, spacing_m, height_m)
    found = [m for wall in walls for m in _along_wall(wall, spacing_m, height_m, bracket_m)]
    return [m for m in found if all(s.signed_distance([m.x_m, m.y_m, m.z_m]) > 0.0 for s in solids)]


def _along_wall(wall: Region, spacing_m: float, height_m: float, bracket_m: float) -> list[Mount]:
    corners = np.asarray(wall.footprint())
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(along, axis=1)
    out: list[Mount] = []
    for k, (start, length) in enumerate(zip(corners, lengths.tolist(), strict=True)):
        d = along[k] / length
        normal = np.array([d[1], -d[0]])
        facing = math.degrees(math.atan2(normal[1], normal[0]))
        n = max(1, math.floor(length / spacing_m + 1e-9))
        for s in ((np.arange(n) + 0.5) * spacing_m + 0.5 * (length - n * spacing_m)).tolist():
            p = start + s * d + bracket_m * normal
            name = f"{wall.name} wall {len(out) + 1}"
            out.append(Mount(name, float(p[0]), float(p[1]), height_m, (facing - 90.0, facing + 90.0)))
        after = along[(k + 1) % len(along)] / lengths[(k + 1) % len(along)]
        turn = math.degrees(math.atan2(d[0] * after[1] - d[1] * after[0], float(d @ after)))
        if turn > 30.0:  # an outer corner; the pieces of a round wall are none
            half = math.radians(facing + 0.5 * turn)
            p = start + along[k] + bracket_m * np.array([math.cos(half), math.sin(half)])
            name = f"{wall.name} corner {len(out) + 1}"
            pan = (facing - 90.0, facing + turn + 90.0)
            out.append(Mount(name, float(p[0]), float(p[1]), height_m, pan))
    return out


def outline_mounts(places: Array, solids: Sequence[Region], spacing_m: float, height_m: float) -> list[Mount]:
    """Return masts every ``spacing_m`` along the outline of a site: its ways ``places`` (n, 2) and its walls."""
    points = np.concatenate([places, *(s.footprint() for s in solids)])
    outline = shapely.MultiPoint(points).convex_hull.buffer(_OUTSIDE_M, join_style="mitre").exterior
    _bounded("outline", outline.length, spacing_m, height_m)
    n = max(1, math.ceil(outline.length / spacing_m - 1e-9))
    found = []
    for k in range(n):
        p = outline.interpolate(k / n, normalized=True)
        found.append(Mount(f"mast {k + 1}", float(p.x), float(p.y), height_m))
    return [m for m in found if all(s.signed_distance([m.x_m, m.y_m, m.z_m]) > 0.0 for s in solids)]


def _bounded(what: str, length_m: float, spacing_m: float, height_m: float) -> None:
    if length_m / spacing_m > _MOST_MOUNTS:
        raise ConfigError(
            f"--mounts {what}:{spacing_m:g},{height_m:g}: {length_m / spacing_m:.4g} places, more than "
            f"{_MOST_MOUNTS:,}: take a larger spacing"
        )

"""C1 references of N cameras (harris2020, Assumption 4.1): from setpoints at decision rate to motion at control rate.

The position moves with bounded speed and acceleration and never leaves the agent's region shrunk by a margin; the
proof is in `camnet.control.reference_kernel`. The margin is there for what the body strays from its reference:
by `camnet.control.monitor` at most the measured error. The orientation is that of filtered gaze angles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from camnet.control.paths import Paths
from camnet.control.reference_kernel import same, step_all, turn_all
from camnet.control.settings import ControllerSettings
from camnet.control.sliding_mode import Reference
from camnet.errors import ConfigError
from camnet.geometry.polytope import PolytopeRegion
from camnet.geometry.regions import BoxRegion, CylinderRegion, PrismRegion, Region
from camnet.types import Array, IntArray

__all__ = ["Detour", "ReferenceGenerator", "ReferenceState", "RegionBounds"]


class Detour(Protocol):
    """Motion of one agent among obstacles; see `camnet.control.planner.pilot`."""

    def reset(self) -> None:
        """Forget everything."""
        ...

    def goal(self, goal: Array) -> Array:
        """Where to go instead of ``goal`` (3,), which an obstacle may cover."""
        ...

    def step(self, before: Array, straight: Array, goal: Array) -> Array:
        """Next p, v, a (9,) from the present ones and those that a free way allows."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class ReferenceState:
    """State of N references: ``rows`` (N,20) of `camnet.control.reference_kernel.step_all`, and its parts by name."""

    rows: Array

    @property
    def p_world(self) -> Array:
        """Positions (N,3), m."""
        return self.rows[:, 0:3]

    @property
    def v_world(self) -> Array:
        """Velocities (N,3), m/s."""
        return self.rows[:, 3:6]

    @property
    def a_world(self) -> Array:
        """Accelerations (N,3), m/s^2."""
        return self.rows[:, 6:9]

    @property
    def gaze(self) -> Array:
        """Pan and tilt (N,2), rad."""
        return self.rows[:, 9:11]

    @property
    def gaze_rate(self) -> Array:
        """Rates of pan and tilt (N,2), rad/s."""
        return self.rows[:, 11:13]


@dataclass(frozen=True, eq=False, slots=True)
class RegionBounds:
    """A region for the kernels: half-spaces (F,4), disc (3,) (radius 0: none), polygon (K,2) (empty: none)."""

    planes: Array
    disc: Array
    polygon: Array

    @staticmethod
    def of(region: Region | None) -> RegionBounds:
        """Bounds whose intersection is exactly ``region`` (None: all space)."""
        none = np.zeros((0, 2))
        if region is None:
            return RegionBounds(np.zeros((0, 4)), np.zeros(3), none)
        if isinstance(region, PolytopeRegion):
            return RegionBounds(np.column_stack([region.A, region.b]), np.zeros(3), none)
        low, high = region.bounds
        axes = np.vstack([np.column_stack([-np.eye(3), -low]), np.column_stack([np.eye(3), high])])
        if isinstance(region, CylinderRegion):
            return RegionBounds(axes[[2, 5]], np.array([*region.center[:2], region.radius_m]), none)
        if isinstance(region, PrismRegion):
            return RegionBounds(axes[[2, 5]], np.zeros(3), region.vertices)
        return RegionBounds(axes, np.zeros(3), none)


def _join(blocks: list[Array], width: int) -> tuple[Array, IntArray]:
    """Blocks of rows one below the other, and where each begins and ends."""
    ends = np.concatenate([[0], np.cumsum([len(b) for b in blocks])]).astype(np.int64)
    return np.concatenate([np.zeros((0, width)), *blocks]), ends


class ReferenceGenerator:
    """References of N agents.

    Parameters
    ----------
    settings : speed, acceleration, rate and margin
    regions : one per agent (None: unbounded)
    yaw_rad : (N,) turn of the image at zero gaze, kept constant; pan and tilt are towards world x and y
    dt_s : control period
    detours : for agents (by number) with obstacles in their region, what leads them around

    Raises
    ------
    ConfigError
        A region is too thin for the margin.
    """

    def __init__(
        self,
        settings: ControllerSettings,
        regions: Sequence[Region | None],
        yaw_rad: Array,
        dt_s: float,
        detours: Mapping[int, Detour] | None = None,
    ) -> None:
        self._margin = settings.region_margin_m
        for region in regions:
            if region is not None and region.inradius_m < self._margin:
                raise ConfigError(
                    f"controller.region_margin_m = {self._margin:g} leaves nothing of region {region.name!r}, "
                    f"whose largest inscribed ball has radius {region.inradius_m:g} m"
                )
        self._regions = tuple(regions)
        #: how far beyond their regions agents may go now (N,), m
        self._beyond = np.zeros(len(regions))
        self._detours = dict(detours or {})
        bounds = [RegionBounds.of(r) for r in regions]
        self._paths = {i: Paths(b, self._margin) for i, b in enumerate(bounds) if len(b.polygon)}
        self._planes = _join([b.planes for b in bounds], 4)
        self._discs = np.array([b.disc for b in bounds]).reshape(-1, 3)
        self._polygons = _join([b.polygon for b in bounds], 2)
        self._yaw = np.asarray(yaw_rad, dtype=float)
        s = settings
        gains = (s.reference_position_gain_per_s, s.reference_velocity_gain_per_s)
        self._limits = np.array(
            [s.reference_v_max_mps, s.reference_a_max_mps2, *gains, s.reference_jerk_max_mps3]
        )
        self._gaze_limits = np.array(
            [s.reference_w_max_radps, s.reference_w_acceleration_radps2, s.gaze_gain_per_s, s.gaze_max_rad]
        )
        self._inner = self._inner_boxes()
        self._bounds = (*self._planes, self._discs, *self._polygons, self._margin)
        self._dt = dt_s
        self._asked = np.full((len(self._regions), 3), np.nan)
        self._goals = np.zeros((len(self._regions), 3))

    def _inner_boxes(self) -> tuple[Array, Array] | None:
        """Corners (N,3), (N,3) of what the margin leaves of the regions, if all are boxes."""
        boxes = [region.bounds for region in self._regions if isinstance(region, BoxRegion)]
        if len(boxes) < len(self._regions) or not boxes:
            return None
        corners = np.array(boxes)
        return corners[:, 0] + self._margin, corners[:, 1] - self._margin

    def allow(self, i: int, beyond_m: float) -> None:
        """From now on let agent ``i`` go ``beyond_m`` over the ground beyond its region; 0: it comes back.

        Heights stay as they are. A reference that is beyond when it may no longer be flies back without leave to turn.
        """
        change = beyond_m - float(self._beyond[i])
        if change == 0.0:
            return
        self._beyond[i] = beyond_m
        ends = self._planes[1]
        planes = self._planes[0][ends[i] : ends[i + 1]]
        planes[:, 3] += change * np.linalg.norm(planes[:, :2], axis=1)
        if self._discs[i, 2] > 0.0:
            self._discs[i, 2] += change
        if self._inner is not None:
            self._inner[0][i, :2] -= change
            self._inner[1][i, :2] += change
        self._asked[:] = np.nan

    def _near(self, i: int, point: Array) -> Array:
        """Nearest place to a point that agent ``i`` may fly to."""
        region, beyond = self._regions[i], float(self._beyond[i])
        if region is None:
            return point
        near = region.project(point, self._margin)
        if beyond <= 0.0:
            return near
        away = point - near
        far = float(np.linalg.norm(away[:2]))
        near[:2] += away[:2] * (min(far, beyond) / far if far > 0.0 else 0.0)
        return near

    def start(self, p_world: Array, gaze: Array | None = None) -> ReferenceState:
        """Start at rest at ``p_world`` (N,3), looking along ``gaze`` (N,2; default straight down)."""
        n = len(self._regions)
        self._asked = np.full((n, 3), np.nan)
        for detour in self._detours.values():
            detour.reset()
        rows = np.zeros((n, 20))
        rows[:, :3] = p_world
        rows[:, 9:11] = 0.0 if gaze is None else gaze
        turn_all(rows, self._yaw)
        return ReferenceState(rows)

    def _aim(self, setpoints: Array, p: Array) -> Array:
        """Nearest admissible points to the setpoints; around reflex corners the next corner on the way."""
        if not same(self._asked, setpoints):
            self._asked = setpoints.copy()
            if self._inner is not None:
                low, high = self._inner
                self._goals = np.minimum(np.maximum(setpoints, low), high)
            else:
                for i in range(len(self._regions)):
                    self._goals[i] = self._near(i, setpoints[i])
            for i, detour in self._detours.items():
                self._goals[i] = detour.goal(self._goals[i])
        if not self._paths:
            return self._goals
        goals = self._goals.copy()
        for i, paths in self._paths.items():
            goals[i] = paths.next_point(p[i, :3], goals[i])
        return goals

    def step(self, state: ReferenceState, setpoint_p: Array, setpoint_gaze: Array) -> ReferenceState:
        """Advance by one control period towards setpoints ``setpoint_p`` (N,3), ``setpoint_gaze`` (N,2)."""
        goals, rows = self._aim(setpoint_p, state.rows), state.rows
        new = step_all(
            rows,
            goals,
            setpoint_gaze,
            *self._bounds,
            self._limits,
            self._gaze_limits,
            self._dt,
            self._yaw,
        )
        for i, detour in self._detours.items():
            new[i, :9] = detour.step(rows[i, :9], new[i, :9], goals[i])
        return ReferenceState(new)

    @property
    def plain(self) -> bool:
        """Whether goals depend on setpoints alone: nothing stands in a region, and no region is a polygon."""
        return not self._paths and not self._detours

    @property
    def packed(self) -> tuple[Array | IntArray | float, ...]:
        """What `camnet.control.reference_kernel.step_all` takes after the setpoints."""
        return (*self._bounds, self._limits, self._gaze_limits, self._dt, self._yaw)

    def aim(self, setpoint_p: Array) -> Array:
        """Nearest admissible points (N,3) to setpoints (N,3); the same array each time, if `plain`."""
        return self._aim(setpoint_p, setpoint_p)

    def reference(self, state: ReferenceState) -> Reference:
        """Pose and exact velocity of the references in ``state``."""
        r = state.rows
        return Reference(r[:, 0:3], r[:, 13:17], r[:, 3:6], r[:, 17:20], r[:, 6:9])

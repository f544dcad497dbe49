"""What a world is made of, as plain data: the one input of every physics back end."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from camnet.errors import WorldError
from camnet.geometry.settings import CameraModel, Road, Shape
from camnet.types import Array
from camnet.world.settings import PhysicsSettings

if TYPE_CHECKING:
    from camnet.geometry.regions import Region
    from camnet.motion.protocol import TargetMotion
    from camnet.sensing.marker import Marker

#: the inner loop's attitude control needs at least this rate
FLIGHT_HZ_LEAST = 60.0

__all__ = ["AgentSpec", "CameraSpec", "OccluderSpec", "TargetSpec", "WorldDescription"]


@dataclass(frozen=True, eq=False, slots=True)
class AgentSpec:
    """A quadrotor with a gimballed camera.

    Attributes
    ----------
    name : unique name
    start_p_world : (3,) where the camera starts, m
    start_yaw_rad : heading of the body, kept during flight, and of the camera at the start
    camera : the camera it carries
    region : its operating region (None: unbounded)
    """

    name: str
    start_p_world: Array
    start_yaw_rad: float
    camera: CameraModel
    region: Region | None = None


@dataclass(frozen=True, eq=False, slots=True)
class CameraSpec:
    """A fixed camera at ``p_world`` (3,), ``q_world`` (4,) (camera to world)."""

    name: str
    camera: CameraModel
    p_world: Array
    q_world: Array


@dataclass(frozen=True, eq=False, slots=True)
class OccluderSpec:
    """A solid that blocks views and flight."""

    name: str
    shape: Shape


@dataclass(frozen=True, eq=False, slots=True)
class TargetSpec:
    """A target: its collision box stands on its body frame's origin (z up), its features are in that frame.

    Attributes
    ----------
    name : unique name
    size_m : (length, width, height) of the box
    features_m : (F,3) feature points in the body frame
    motion : the law by which it moves
    marker : the fiducial marker it carries, if any: only for pictures
    """

    name: str
    size_m: tuple[float, float, float]
    features_m: Array
    motion: TargetMotion
    marker: Marker | None = None


@dataclass(frozen=True, eq=False, slots=True)
class WorldDescription:
    """Everything a physics back end needs; ``roads`` are only drawn.

    Raises
    ------
    WorldError
        Two bodies share a name, ``physics.step_hz`` is no multiple of ``control_hz``, or ``physics.flight_hz`` does
        not lie between them as a multiple and a divisor.
    """

    physics: PhysicsSettings
    control_hz: float
    agents: tuple[AgentSpec, ...] = ()
    cameras: tuple[CameraSpec, ...] = ()
    occluders: tuple[OccluderSpec, ...] = ()
    targets: tuple[TargetSpec, ...] = ()
    roads: tuple[Road, ...] = field(default=())

    def __post_init__(self) -> None:
        names = [a.name for a in self.agents] + [c.name for c in self.cameras]
        names += [o.name for o in self.occluders] + [t.name for t in self.targets]
        doubled = sorted({n for n in names if names.count(n) > 1})
        if doubled:
            raise WorldError(f"names of agents, cameras, occluders and targets must differ; twice: {doubled}")
        ratio = self.physics.step_hz / self.control_hz
        if abs(ratio - round(ratio)) > 1e-9 or ratio < 1:
            raise WorldError(
                f"physics.step_hz = {self.physics.step_hz} must be a whole multiple of "
                f"controller.rate_hz = {self.control_hz:g}"
            )
        flight = self.physics.flight_hz
        if flight is not None and flight not in self._flight_rates():
            raise WorldError(
                f"physics.flight_hz = {flight} must be a whole multiple of controller.rate_hz = "
                f"{self.control_hz:g} and divide physics.step_hz = {self.physics.step_hz}: one of "
                f"{', '.join(f'{rate:g}' for rate in self._flight_rates())}"
            )

    @property
    def substeps(self) -> int:
        """Physics steps in one control period."""
        return round(self.physics.step_hz / self.control_hz)

    @property
    def flight_substeps(self) -> int:
        """Physics steps in one period of the quadrotors' inner loop."""
        rates = self._flight_rates()
        chosen = self.physics.flight_hz or next((r for r in rates if r >= FLIGHT_HZ_LEAST), rates[-1])
        return round(self.physics.step_hz / chosen)

    def _flight_rates(self) -> list[float]:
        """Rates at which the inner loop can run, rising."""
        periods = (k for k in range(1, self.substeps + 1) if self.substeps % k == 0)
        return [k * self.control_hz for k in periods]

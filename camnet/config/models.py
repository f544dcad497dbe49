"""The scenario: everything that one simulation is made of, as frozen settings.

A world file holds a scenario; a recipe names a world and overrides parts of it. Names tie the parts together:
an agent names its region and its camera model, a fixed camera its model, a target its road.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PlainSerializer, WrapValidator

from camnet.certification.settings import CertificateSettings
from camnet.control.settings import ControllerSettings
from camnet.estimation.settings import EstimatorSettings
from camnet.geometry.settings import CameraModel, FixedPose, Road, Shape
from camnet.motion.settings import TargetSettings
from camnet.plugins import is_plugin
from camnet.sensing.own_pose_settings import PoseSource
from camnet.sensing.settings import SensingSettings
from camnet.settings import Finite, NonNegative, Positive, Seed, Settings, Vector3
from camnet.world.settings import PhysicsSettings

__all__ = [
    "Agent",
    "FixedCamera",
    "HandoffSettings",
    "Occluder",
    "Region",
    "RunSettings",
    "Scenario",
    "TrafficRegions",
    "TrafficSettings",
]


class Region(Settings):
    """Operating region O_j: an agent stays inside it and sees a target only inside it."""

    name: str
    shape: Shape


class Agent(Settings):
    """A quadrotor that carries camera ``camera`` (a camera model's name) inside region ``region``.

    ``pose`` says where it knows its own pose from. With ``exit_budget_s`` it may follow a target out of its region, at
    most ``exit_reach_m`` far, and is back within that time.
    """

    name: str
    region: str
    camera: str
    start_m: Vector3 | None = None
    start_yaw_rad: Finite = 0.0
    pose: PoseSource = PoseSource()
    exit_budget_s: NonNegative = 0.0
    exit_reach_m: Positive = 1.0


class FixedCamera(Settings):
    """A stationary camera; its field-of-view volume V_c is its region."""

    name: str
    camera: str
    pose: FixedPose


class Occluder(Settings):
    """A solid that blocks views and flight."""

    name: str
    shape: Shape


class HandoffSettings(Settings):
    """How handoffs are predicted and counted.

    A handoff counts as completed when the target is seen within ``grace_s`` of entering another region. Every
    ``replan_s`` the prediction is rolled out ``lookahead_s`` ahead in steps of ``rollout_dt_s``.
    """

    grace_s: Positive = 2.0
    lookahead_s: Positive = 40.0
    replan_s: Positive = 0.5
    rollout_dt_s: Positive = 0.2


def _or_plugin(name: object, validate: Callable[[object], Any]) -> Any:  # noqa: ANN401 - a name
    return name if isinstance(name, str) and is_plugin(name) else validate(name)


_Estimator = Annotated[
    Literal["learned", "learned_shared", "printed", "adate", "ekf", "ukf", "ideal", "oracle"],
    WrapValidator(_or_plugin),
    PlainSerializer(str, return_type=str),
]


class RunSettings(Settings):
    """Length and rates of a run, and the estimators that run side by side on the same measurements.

    The first estimator drives the agents. ``learned_shared`` lets all targets learn from each other; ``printed`` is the
    learned one without the remedies of the gap problem; ``ideal`` knows the true velocity now, ``oracle`` the future.
    ``model`` is a file of learned models to start from (``camnet simulate --save-model``). ``instruments`` also logs
    the quantities of the Lyapunov analysis: V, the norm of the weights, lambda_min(Psi) and the switching signals.
    """

    duration_s: Positive = 300.0
    decision_hz: Positive = 10.0
    log_hz: Positive = 10.0
    model: Path | None = None
    instruments: bool = False
    estimators: Annotated[tuple[_Estimator, ...], Field(min_length=1)] = (
        "learned",
        "printed",
        "ekf",
        "ideal",
    )


class TrafficRegions(Settings):
    """Operating regions on real streets: squares at the ``count`` busiest places, one agent in each.

    ``size_m`` is a square's side and ``height_m`` the region's height; ``margin_m`` is the least distance between
    two regions, and ``within_m`` how far they may be from the busiest one.
    """

    count: Annotated[int, Field(gt=0, le=64)] = 4
    size_m: Positive = 60.0
    height_m: Positive = 35.0
    margin_m: NonNegative = 60.0
    within_m: Positive = 800.0


class TrafficSettings(Settings):
    """Targets from road traffic: SUMO is run on ``sumo_config``, and some of its vehicles are replayed.

    The first ``warm_up_s`` seconds fill the streets; the next ``duration_s`` are kept. The ``targets`` vehicles that
    change region most often are followed: a vehicle stands where its trip begins before it, and where it ends after
    it. ``camera`` names the camera model of the agents, who start ``agent_height_m`` above the street. Streets within
    ``road_margin_m`` of the regions become the world's roads.
    """

    sumo_config: Path
    warm_up_s: NonNegative = 120.0
    duration_s: Positive = 300.0
    step_s: Positive = 1.0
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 42
    targets: Annotated[int, Field(gt=0, le=64)] = 4
    camera: str
    agent_height_m: Positive = 20.0
    road_margin_m: NonNegative = 50.0
    regions: TrafficRegions = TrafficRegions()


class Scenario(Settings):
    """One simulation: the world and the settings of everything in it.

    ``data`` is the folder of recorded inputs: when given, relative paths in the file start there.
    ``traffic`` stands for regions, agents and targets made from a traffic simulation.
    """

    name: str
    description: str = ""
    kind: Literal["network"] = "network"
    seed: Seed = 0
    data: Path | None = Field(None, description="the folder of recorded inputs: --set data=FOLDER")
    cameras: Annotated[tuple[CameraModel, ...], Field(max_length=1000)]
    regions: Annotated[tuple[Region, ...], Field(max_length=256)] = ()
    agents: Annotated[tuple[Agent, ...], Field(max_length=256)] = ()
    fixed_cameras: Annotated[tuple[FixedCamera, ...], Field(max_length=1000)] = ()
    occluders: Annotated[tuple[Occluder, ...], Field(max_length=1000)] = ()
    roads: Annotated[tuple[Road, ...], Field(max_length=20_000)] = ()
    targets: Annotated[tuple[TargetSettings, ...], Field(max_length=256)] = ()
    traffic: TrafficSettings | None = None
    physics: PhysicsSettings = PhysicsSettings()
    sensing: SensingSettings = SensingSettings()
    controller: ControllerSettings = ControllerSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    certificate: CertificateSettings = CertificateSettings()
    handoff: HandoffSettings = HandoffSettings()
    run: RunSettings = RunSettings()

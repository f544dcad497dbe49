"""Scene of parikh2018, VII-B: one quadrotor above two robots on a road network, each turning at random at junctions.

| quantity | here | source |
| --- | --- | --- |
| camera | 640 x 368 at 30 Hz on a quadrotor; one robot in view at a time | published |
| lens, height | 65 degrees wide, 2.6 m above the ground: 2.9 m x 1.7 m in view | ours |
| roads | 25 m: a loop of 7 m x 4 m and a road across it: two junctions | the length of 172 kernels every 0.3 m |
| robots | 0.3 m/s, wandering by 3 % | ours: a robot commanded one speed |
| marker noise | 15 mm, 15 mrad a frame | ours: twice that of experiment 1 and more, "decreased accuracy" |
| latency | none | the paper has "significant delay", without a figure |
| kernels | every 0.3 m along the roads, both headings; covariance 0.1 I3 | published |
| N, stack | 2000, shared by both estimators | published |
| schedule | 300 s one robot, then whichever is nearest an intersection | published; then 300 s here |
"""

from __future__ import annotations

import numpy as np

from camnet.config.models import Agent, Region, RunSettings, Scenario
from camnet.control.settings import ControllerSettings
from camnet.estimation.basis import RbfBasis
from camnet.estimation.settings import EstimatorSettings, GapSettings, StackSettings
from camnet.geometry.road_graph import RoadGraph
from camnet.geometry.settings import Box, CameraModel, Intrinsics, Road
from camnet.motion.settings import RoadTarget, TargetSettings
from camnet.sensing.settings import SensingSettings
from camnet.settings import NonNegative, Positive, Settings
from camnet.types import Array

__all__ = ["ROADS", "RoadSceneSettings", "lane_basis", "road_scenario"]

HALF_WIDTH_M, HALF_HEIGHT_M = 3.3, 2.0
ROADS = (
    Road(
        name="left",
        points_m=(
            (0.0, HALF_HEIGHT_M),
            (-HALF_WIDTH_M, HALF_HEIGHT_M),
            (-HALF_WIDTH_M, -HALF_HEIGHT_M),
            (0.0, -HALF_HEIGHT_M),
        ),
    ),
    Road(name="middle", points_m=((0.0, HALF_HEIGHT_M), (0.0, -HALF_HEIGHT_M))),
    Road(
        name="right",
        points_m=(
            (0.0, HALF_HEIGHT_M),
            (HALF_WIDTH_M, HALF_HEIGHT_M),
            (HALF_WIDTH_M, -HALF_HEIGHT_M),
            (0.0, -HALF_HEIGHT_M),
        ),
    ),
)
LEARNED = EstimatorSettings(stack=StackSettings(size=2000), gap=GapSettings(prior="road"))


class RoadSceneSettings(Settings):
    """The table above, as far as it can be changed."""

    follow_one_s: Positive = 300.0
    policy_s: Positive = 300.0
    speed_mps: tuple[float, float] = (0.29, 0.31)
    camera_height_m: Positive = 2.6
    position_noise_m: NonNegative = 0.015
    orientation_noise_rad: NonNegative = 0.015
    decision_hz: Positive = 5.0
    estimator: EstimatorSettings = LEARNED

    @property
    def duration_s(self) -> float:
        """Length of the whole run, s."""
        return self.follow_one_s + self.policy_s


def road_scenario(scene: RoadSceneSettings) -> Scenario:
    """Build the scenario; robot 1 starts on the left road, robot 2 on the right one."""
    lens = Intrinsics(width_px=640, height_px=368, fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=184.0)
    reach = 1.5
    low = (-HALF_WIDTH_M - reach, -HALF_HEIGHT_M - reach, 0.0)
    high = (HALF_WIDTH_M + reach, HALF_HEIGHT_M + reach, scene.camera_height_m + 0.75)
    motion = {"kind": "road", "speed_mps": scene.speed_mps}
    targets = tuple(
        TargetSettings(
            name=name, motion=RoadTarget.model_validate({**motion, "road": road, "start_arc_m": arc})
        )
        for name, road, arc in (("robot_1", "left", 2.0), ("robot_2", "right", 6.0))
    )
    return Scenario(
        name="road_network",
        description="one quadrotor above two robots that turn at random",
        cameras=(CameraModel(name="camera", intrinsics=lens, near_m=0.3, far_m=8.0),),
        regions=(Region(name="everywhere", shape=Box(min_m=low, max_m=high)),),
        agents=(
            Agent(
                name="quadrotor",
                region="everywhere",
                camera="camera",
                start_m=(-2.0, HALF_HEIGHT_M, scene.camera_height_m),
            ),
        ),
        roads=ROADS,
        targets=targets,
        sensing=SensingSettings(
            rate_hz=30.0,
            position_noise_m=scene.position_noise_m,
            orientation_noise_rad=scene.orientation_noise_rad,
        ),
        controller=ControllerSettings(),
        estimator=scene.estimator,
        run=RunSettings(duration_s=scene.duration_s, decision_hz=scene.decision_hz),
    )


def lane_basis(spacing_m: float = 0.3, variance_m2: float = 0.1, heading_scale_m: float = 1.0) -> RbfBasis:
    """Return the published kernels: on the centre lines, one for each direction of the road, covariance 0.1 I.

    The paper's third input is the heading in rad; here it is the direction on a circle of radius 1, which differs in
    the fourth order and has no jump.
    """
    centres: list[Array] = []
    for line in RoadGraph.from_settings(ROADS).edges:
        s = (np.arange(round(line.length / spacing_m)) + 0.5) * spacing_m
        xy, along = line.point(s), heading_scale_m * line.tangent(s)
        centres += [np.hstack([xy, along]), np.hstack([xy, -along])]
    return RbfBasis.create(np.concatenate(centres), variance_m2, heading_scale_m)

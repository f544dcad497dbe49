"""Scene of parikh2018, VII-A: one fixed camera above a differential-drive robot on a smooth vector field.

The published experiment disregarded measurements on purpose: the camera sees the robot all the time, and a schedule
decides what the estimators are given. Every estimator gets the same measurements.

| quantity | here | source |
| --- | --- | --- |
| camera | 1936 x 1216 at 60 Hz | published |
| lens | 8 mm on 5.86 um pixels, 3.8 m above the ground | ours: the whole field is in view |
| field | ``field: wave``, cycle of about 7 m inside a square of 2.4 m, 0.3 m/s | the form published, our numbers |
| visible | 60 s, then on U(15, 30) s, off U(10, 20) s | published |
| marker noise | 5 mm, 10 mrad a frame | ours: half a pixel on a 0.24 m marker gives 1-5 mm across the axis |
| calibration | 5 mrad (camera), 10 mrad (marker on the robot) an axis, constant in a run | ours |
| marker in the image | 0.24 m, about 86 pixels; 4 ms of exposure, noise and blur of `ImageSettings` | ours |
| wheel slip | 2 % of the speed and 0.02 rad/s, correlated over 1 s | ours; the paper reports slip without a figure |

The same frames are also given as images: the marker is drawn into the camera's image, found, and its pose solved. The
marker's pose carries the same calibration errors, so the two ways of sensing differ in the noise of a frame alone.

The constant calibration errors stand for the difference between the camera's pose as calibrated and as motion capture
has it, and of the marker's and the robot's axes: no estimator can see them, and white noise alone would put
the ideal predictor ten times below what was published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.geometry import rotations
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.motion.factory import build_motion
from camnet.motion.protocol import TargetMotion, TargetState, planar_state
from camnet.motion.settings import TargetSettings, VectorFieldTarget
from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.settings import ImageSettings, SensingSettings
from camnet.sensing.visibility import VisibilityTest
from camnet.sensing.vision_sensor import build_sensor
from camnet.settings import NonNegative, Positive, Settings
from camnet.types import Array, BoolArray, CameraMotion, PoseMeasurement, Snapshot, Twist
from camnet.world.description import CameraSpec, TargetSpec, WorldDescription
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet import PyBulletWorld
from camnet.world.settings import PhysicsSettings

__all__ = ["Recording", "SceneSettings", "SlippingMotion", "draw_schedule", "record"]


class SceneSettings(Settings):
    """The table above, and the length of a run."""

    duration_s: Positive = 600.0
    rate_hz: Positive = 60.0
    first_on_s: Positive = 60.0
    on_s: tuple[float, float] = (15.0, 30.0)
    off_s: tuple[float, float] = (10.0, 20.0)
    scale_m: Positive = 1.8
    speed_mps: Positive = 0.3
    camera_height_m: Positive = 3.8
    position_noise_m: NonNegative = 0.005
    orientation_noise_rad: NonNegative = 0.01
    camera_calibration_rad: NonNegative = 0.005
    marker_calibration_rad: NonNegative = 0.01
    image: ImageSettings = ImageSettings(exposure_s=0.004)
    slip_share: NonNegative = 0.02
    slip_turn_radps: NonNegative = 0.02
    slip_time_s: Positive = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class Recording:
    """One run: the truth at every frame, and what was measured in the frames that the schedule leaves in.

    Attributes
    ----------
    t_s : (K,) times of the frames, s
    p_world, q_world, v_world, w_body : (K, 3), (K, 4), (K, 3), (K, 3) true pose and velocity of the robot
    on : (K,) whether the schedule gives the frame to the estimators
    measurements : K measurements, None where off or not visible
    images : the same read from images, None also where the marker was not found
    """

    t_s: Array
    p_world: Array
    q_world: Array
    v_world: Array
    w_body: Array
    on: BoolArray
    measurements: tuple[PoseMeasurement | None, ...]
    images: tuple[PoseMeasurement | None, ...]


@dataclass(frozen=True, eq=False, slots=True)
class SlippingMotion:
    """A motion whose wheels slip: speed and turning rate are off by first-order Gauss-Markov processes.

    ``internal`` of its states is that of ``motion`` followed by the slips of speed (share) and turning rate (rad/s).
    """

    motion: TargetMotion
    share: float
    turn_radps: float
    time_s: float

    @property
    def v_max_mps(self) -> float:
        """Bound on the linear speed, m/s: slips are cut at three standard deviations."""
        return self.motion.v_max_mps * (1.0 + 3.0 * self.share)

    @property
    def w_max_radps(self) -> float:
        """Bound on the angular speed, rad/s."""
        return self.motion.w_max_radps + 3.0 * self.turn_radps

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Start as ``motion`` does, without slip."""
        s = self.motion.reset(rng)
        return TargetState(s.p_world, s.q_world, s.v_world, s.w_body, np.append(s.internal, [0.0, 0.0]))

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Advance the intended motion, then let the slip act on what it has moved and turned."""
        plain = TargetState(state.p_world, state.q_world, state.v_world, state.w_body, state.internal[:-2])
        after = self.motion.step(plain, t_s, dt_s, rng)
        keep = math.exp(-dt_s / self.time_s)
        fresh = math.sqrt(1.0 - keep * keep)
        theta, v, w = after.internal.tolist()[:3]
        share, turn = state.internal.tolist()[-2:]
        n_share, n_turn = rng.standard_normal(2).tolist()
        share = _cut(keep * share + fresh * self.share * n_share, 3.0 * self.share)
        turn = _cut(keep * turn + fresh * self.turn_radps * n_turn, 3.0 * self.turn_radps)
        (x, y, _), (x1, y1, _) = state.p_world.tolist(), after.p_world.tolist()
        x, y, theta = x + (1.0 + share) * (x1 - x), y + (1.0 + share) * (y1 - y), theta + dt_s * turn
        return planar_state(x, y, 0.0, theta, v * (1.0 + share), w + turn, (theta, v, w, share, turn))

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return None: with slip the velocity is no function of the pose."""
        return None


def _cut(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def draw_schedule(scene: SceneSettings, t_s: Array, rng: np.random.Generator) -> BoolArray:
    """Whether each time (K,) lies in an on period: the first one fixed, then on and off by turns."""
    on = np.ones(len(t_s), dtype=bool)
    t = scene.first_on_s
    while t < scene.duration_s:
        end = t + rng.uniform(*scene.off_s)
        on[(t_s >= t) & (t_s < end)] = False
        t = end + rng.uniform(*scene.on_s)
    return on


def record(scene: SceneSettings, seed: int) -> Recording:
    """Run the world once; the same seed gives the same recording, bit for bit."""
    motion_rng, noise_rng, schedule_rng, calibration_rng, image_rng = np.random.default_rng(seed).spawn(5)
    description = _describe(scene)
    spec = description.cameras[0]
    world = PyBulletWorld(description)
    # one robot and nothing else: no sight line is ever blocked
    sight = VisibilityTest([spec.camera], [description.targets[0].features_m], [None])
    sensor, imager = _sensors(scene, spec.camera, description.targets[0].features_m)
    frames = round(scene.duration_s * scene.rate_hz)
    t_s = np.arange(frames + 1) / scene.rate_hz
    on = draw_schedule(scene, t_s, schedule_rng)
    errors = calibration_rng.standard_normal((2, 3))
    camera_turn = rotations.exp(scene.camera_calibration_rad * errors[0])
    marker_turn = rotations.exp(scene.marker_calibration_rad * errors[1])
    truth = np.empty((frames + 1, 13))
    measured: list[PoseMeasurement | None] = []
    images: list[PoseMeasurement | None] = []
    try:
        snapshot = world.reset(motion_rng)
        for k in range(frames + 1):
            if k > 0:
                snapshot = world.step(CameraCommand.zeros(0))
            truth[k] = _truth(snapshot)
            visible = sight(snapshot)
            found = sensor.measure(snapshot, visible, noise_rng)
            measured.append(_miscalibrated(found[0], camera_turn, marker_turn) if found and on[k] else None)
            # nobody looks at the images that are disregarded
            read = imager.measure(snapshot, visible & on[k], image_rng)
            images.append(_miscalibrated(read[0], camera_turn, marker_turn) if read else None)
    finally:
        world.close()
    p, q, v, w = np.split(truth, [3, 7, 10], axis=1)
    return Recording(t_s, p, q, v, w, on, tuple(measured), tuple(images))


def _sensors(scene: SceneSettings, camera: CameraModel, features: Array) -> tuple[PoseSensor, PoseSensor]:
    """Sensors of poses and of images."""
    sensing = SensingSettings(
        rate_hz=scene.rate_hz,
        position_noise_m=scene.position_noise_m,
        orientation_noise_rad=scene.orientation_noise_rad,
        image=scene.image,
    )
    images = sensing.model_copy(update={"level": "image"})
    return PoseSensor(sensing, 1, 1), build_sensor(images, [camera], [features])


def _truth(snapshot: Snapshot) -> Array:
    return np.concatenate(
        (
            snapshot.target_p_world[0],
            snapshot.target_q_world[0],
            snapshot.target_v_world[0],
            snapshot.target_w_body[0],
        )
    )


def _miscalibrated(m: PoseMeasurement, camera_turn: Array, marker_turn: Array) -> PoseMeasurement:
    """Believe the camera turned by ``camera_turn`` (4,), and the marker on the robot by ``marker_turn`` (4,)."""
    q_camera = rotations.multiply(m.motion.q_world, camera_turn)
    motion = CameraMotion(m.motion.p_world, q_camera, m.motion.v_world, m.motion.w_cam)
    return PoseMeasurement(
        m.t_s, m.camera, m.target, m.p_cam, rotations.multiply(m.q_cam, marker_turn), motion
    )


def _describe(scene: SceneSettings) -> WorldDescription:
    field = VectorFieldTarget(
        kind="vector_field", field="wave", scale_m=scene.scale_m, speed_mps=scene.speed_mps
    )
    robot = TargetSettings(name="robot", motion=field)
    motion = SlippingMotion(
        build_motion(robot, ()), scene.slip_share, scene.slip_turn_radps, scene.slip_time_s
    )
    lens = Intrinsics(width_px=1936, height_px=1216, fx_px=1365.0, fy_px=1365.0, cx_px=968.0, cy_px=608.0)
    p_camera = np.array([0.0, 0.0, scene.camera_height_m])
    camera = CameraModel(name="camera", intrinsics=lens, far_m=scene.camera_height_m + 1.0)
    return WorldDescription(
        physics=PhysicsSettings(step_hz=round(scene.rate_hz)),  # nothing here flies: one step a frame
        control_hz=scene.rate_hz,
        cameras=(CameraSpec("camera", camera, p_camera, rotations.look_at(p_camera, np.zeros(3))),),
        targets=(TargetSpec("robot", robot.size_m, np.array(robot.features_m), motion),),
    )

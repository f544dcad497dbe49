"""The drawn marker against other ways to the same image: OpenCV's warp, PyBullet's renderer, moved cameras."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.errors import ConfigError
from camnet.geometry import rotations as rot
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.motion.factory import build_motion
from camnet.motion.settings import TargetSettings, VectorFieldTarget
from camnet.sensing.edges import refine_corners
from camnet.sensing.marker import MODULES, marker_on, pattern
from camnet.sensing.marker_view import BLACK, WHITE, Lens, draw_marker, marker_motion
from camnet.sensing.readers import ImageReader
from camnet.sensing.settings import ImageSettings
from camnet.types import Snapshot
from camnet.world.description import CameraSpec, TargetSpec, WorldDescription
from camnet.world.pybullet import PyBulletWorld
from camnet.world.settings import PhysicsSettings

ROOF = np.array(
    TargetSettings(name="t", motion=VectorFieldTarget(kind="vector_field", field="wave")).features_m
)
PLAIN = Intrinsics(width_px=640, height_px=368, fx_px=420.0, fy_px=415.0, cx_px=318.0, cy_px=186.0)
BENT = PLAIN.model_copy(update={"distortion": (-0.2, 0.08, 1e-3, -5e-4)})
MARKER = marker_on(ROOF, 5)
NONE = np.zeros((0, 3))


def at(p_cam, look, p, yaw, t=0.0, v=(0, 0, 0), w=(0, 0, 0), v_cam=(0, 0, 0), w_cam=(0, 0, 0)):
    p_cam = np.array(p_cam, float)
    rows = [np.array([x], float) for x in (p_cam, rot.look_at(p_cam, np.array(look, float)), v_cam, w_cam)]
    rows += [np.array([x], float) for x in (p, rot.from_yaw(yaw), v, w)]
    return Snapshot(t, 0, NONE, np.zeros((0, 4)), NONE, NONE, *rows)


def true_pixels(snapshot, lens, points=MARKER.corners):
    in_world = rot.rotate(snapshot.target_q_world[0], points) + snapshot.target_p_world[0]
    return lens.pinhole.project_world(in_world, snapshot.camera_p_world[0], snapshot.camera_q_world[0])


def drawn(snapshot, intrinsics, ground=110.0, **options):
    lens = Lens(intrinsics)
    around = np.full((intrinsics.height_px, intrinsics.width_px), ground, dtype=np.float32)
    patch = draw_marker(lens, *marker_motion(snapshot, 0, 0, MARKER), MARKER, around, **options)
    whole = around.copy()
    if patch is not None:
        h, w = patch.pixels.shape
        whole[patch.top : patch.top + h, patch.left : patch.left + w] = patch.pixels
    return whole, lens


def found(image, number=5):
    """Corners by the package's own way in a whole 8-bit image."""
    reader = ImageReader(
        ImageSettings(renderer="pybullet"), [CameraModel(name="c", intrinsics=PLAIN)], [ROOF], print
    )
    marker = marker_on(ROOF, number)
    return reader.corners(np.clip(np.rint(image), 0, 255).astype(np.uint8), marker, lambda pixels: pixels)


def test_marker_lies_between_the_features_and_faces_up():
    np.testing.assert_allclose(MARKER.corners, ROOF, atol=1e-12)
    np.testing.assert_allclose(rot.rotate(MARKER.q_body, MARKER.square()) + MARKER.p_body, ROOF, atol=1e-12)
    np.testing.assert_allclose(rot.rotate(MARKER.q_body, np.array([0, 0, 1.0])), [0, 0, 1], atol=1e-12)
    car = marker_on([(1, 0.6, 1.5), (1, -0.6, 1.5), (-1, -0.6, 1.5), (-1, 0.6, 1.5)], 0)
    assert car.side_m == pytest.approx(1.2)
    np.testing.assert_allclose(car.corners.mean(axis=0), [0, 0, 1.5], atol=1e-12)


@pytest.mark.parametrize("features", [ROOF[:3], ROOF * [[1], [1], [1], [2]]])
def test_a_marker_needs_a_rectangle(features):
    with pytest.raises(ConfigError, match="rectangle"):
        marker_on(features, 0)
    with pytest.raises(ConfigError, match="target number 250"):
        marker_on(ROOF, 250)


def test_drawn_image_is_opencvs_warp_of_the_pattern():
    """Many times finer warped by OpenCV and averaged, against one look at each pixel's points."""
    scene, fine = at([0.7, -0.4, 2.2], [0.1, 0.2, 0.3], [0.0, 0.1, 0.0], 0.7), 16
    image, lens = drawn(scene, PLAIN, samples=256)
    side = 64 * (MODULES + 2)
    texture = BLACK + (WHITE - BLACK) / 255.0 * np.kron(pattern(5), np.ones((64, 64)))
    plate = true_pixels(scene, lens, MARKER.plate())
    there = (plate - [250, 120] + 0.5) * fine - 0.5  # a window of the image, in fine pixels
    corners = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float32) - 0.5
    h = cv2.getPerspectiveTransform(corners, there.astype(np.float32))
    ground = np.full((140 * fine, 140 * fine), 110.0, dtype=np.float32)
    cv2.warpPerspective(
        texture.astype(np.float32), h, ground.shape[::-1], ground, cv2.INTER_NEAREST, cv2.BORDER_TRANSPARENT
    )
    expected = ground.reshape(140, fine, 140, fine).mean(axis=(1, 3))
    window = image[120:260, 250:390]
    assert np.abs(expected - 110.0).max() > 75  # it is in there
    assert np.abs(window - expected).max() < 0.06 * (WHITE - BLACK)
    assert np.abs(window - expected).mean() < 0.2


@pytest.mark.parametrize("intrinsics", [PLAIN, BENT])
def test_corners_are_found_where_the_lens_puts_them(intrinsics):
    rng, errors = np.random.default_rng(0), []
    for _ in range(10):
        scene = at([0.5, 0.3, 2.5], [0, 0, 0.3], [*rng.uniform(-0.5, 0.5, 2), 0.0], rng.uniform(-3, 3))
        image, lens = drawn(scene, intrinsics)
        picture = np.clip(np.rint(cv2.GaussianBlur(image, (0, 0), 0.5)), 0, 255).astype(np.uint8)
        corners = true_pixels(scene, lens)
        rough = corners + rng.uniform(-0.7, 0.7, corners.shape)
        exact = refine_corners(picture, rough, MODULES, lens.pinhole.normalise)
        errors.append(exact - lens.pinhole.normalise(corners))
    assert np.sqrt(np.mean(np.square(errors))) * 420.0 < 0.05
    assert np.abs(np.mean(errors, axis=0)).max() * 420.0 < 0.05


@pytest.mark.parametrize("intrinsics", [PLAIN, BENT])
def test_lens_inverts_the_projection(intrinsics):
    """Against the camera's forward distortion, and its Newton inverse."""
    lens = Lens(intrinsics)
    pixels = np.random.default_rng(0).uniform([0, 0], [639, 367], (200, 2))
    pixels[7, 0] = np.nan
    rays = lens.normalise(pixels)
    again = lens.pinhole.project(np.concatenate([rays, np.ones((200, 1))], axis=1))
    np.testing.assert_allclose(
        again, np.where(np.isnan(pixels).any(axis=1)[:, None], np.nan, pixels), atol=2e-4
    )
    corners = lens.rays(100, 50, 102, 53)
    u, v = np.meshgrid([99.5, 100.5, 101.5], [49.5, 50.5, 51.5, 52.5])
    np.testing.assert_allclose(corners, lens.pinhole.normalise(np.stack([u, v], axis=-1)), atol=1e-8)


def test_blur_of_an_exposure_is_the_mean_of_the_instants():
    moving = {"v": (0.3, 0.4, 0.0), "w": (0, 0, 1.5), "v_cam": (0.5, -0.2, 0.1), "w_cam": (0.3, -0.4, 0.5)}
    start, exposure = {"p": np.array([0.1, 0.0, 0.0]), "yaw": 0.4}, 0.04
    image, _ = drawn(
        at([0.4, 0.2, 2.5], [0, 0, 0.3], **start, **moving), PLAIN, samples=256, exposure_s=exposure
    )
    still = at([0.4, 0.2, 2.5], [0, 0, 0.3], **start)
    instants = []
    for tau in exposure * ((np.arange(40) + 0.5) / 40 - 0.5):
        q_cam = rot.multiply(still.camera_q_world[0], rot.exp(tau * np.array(moving["w_cam"])))
        scene = Snapshot(
            0.0, 0, NONE, np.zeros((0, 4)), NONE, NONE,
            still.camera_p_world + tau * np.array(moving["v_cam"]), q_cam[None], np.zeros((1, 3)), np.zeros((1, 3)),
            still.target_p_world + tau * np.array(moving["v"]), rot.from_yaw(0.4 + 1.5 * tau)[None],
            np.zeros((1, 3)), np.zeros((1, 3)),
        )  # fmt: skip
        instants.append(drawn(scene, PLAIN)[0])
    sharp = drawn(still, PLAIN)[0]
    assert np.abs(sharp - image).max() > 60  # it does blur
    assert np.abs(np.mean(instants, axis=0) - image).mean() < 0.1 * np.abs(sharp - image).mean()
    assert np.abs(np.mean(instants, axis=0) - image).max() < 16


def test_rolling_shutter_shows_every_row_at_its_own_time():
    moving = {"v": (0.8, 0.0, 0.0), "w": (0, 0, 2.0)}
    scene, readout = at([0.2, 0.0, 2.0], [0, 0, 0.3], [0.0, 0.0, 0.0], 0.3, **moving), 0.03
    rolling, _ = drawn(scene, PLAIN, readout_s=readout)
    for row in range(120, 250, 10):
        tau = (row / PLAIN.height_px - 0.5) * readout
        then = at([0.2, 0.0, 2.0], [0, 0, 0.3], [0.8 * tau, 0.0, 0.0], 0.3 + 2.0 * tau)
        np.testing.assert_allclose(rolling[row], drawn(then, PLAIN)[0][row], atol=25)  # linear motion
        assert np.abs(rolling[row] - drawn(then, PLAIN)[0][row]).mean() < 0.3
    assert np.abs(rolling - drawn(scene, PLAIN)[0]).max() > 60  # it does bend


@given(st.floats(-3, 3), st.floats(0.02, 0.02))
@settings(max_examples=5, deadline=None)
def test_motion_is_the_derivative_of_the_plane(yaw, rate):
    moving = {
        "v": (0.3, 0.4, 0.1),
        "w": (0.1, -0.3, 1.0),
        "v_cam": (0.5, -0.2, 0.1),
        "w_cam": (0.3, -0.4, 0.5),
    }
    scene = at([0.4, 0.2, 2.5], [0, 0, 0.3], [0.1, 0.0, 0.0], yaw, **moving)
    plane, slope = marker_motion(scene, 0, 0, MARKER)
    ends = []
    for tau in (-1e-5, 1e-5):
        then = Snapshot(
            0.0, 0, NONE, np.zeros((0, 4)), NONE, NONE,
            scene.camera_p_world + tau * np.array(moving["v_cam"]),
            rot.multiply(scene.camera_q_world, rot.exp(tau * np.array(moving["w_cam"]))),
            np.zeros((1, 3)), np.zeros((1, 3)),
            scene.target_p_world + tau * np.array(moving["v"]),
            rot.multiply(scene.target_q_world, rot.exp(tau * np.array(moving["w"]))),
            np.zeros((1, 3)), np.zeros((1, 3)),
        )  # fmt: skip
        ends.append(marker_motion(then, 0, 0, MARKER)[0])
    np.testing.assert_allclose((ends[1] - ends[0]) / 2e-5, slope, atol=1e-6)
    np.testing.assert_allclose(0.5 * (ends[0] + ends[1]), plane, atol=1e-8)


def test_a_marker_out_of_sight_is_not_drawn():
    scene = at([0.0, 0.0, 2.0], [5.0, 0, 2.0], [-3.0, 0.0, 0.0], 0.0)
    around = np.zeros((368, 640), dtype=np.float32)
    assert draw_marker(Lens(PLAIN), *marker_motion(scene, 0, 0, MARKER), MARKER, around) is None
    aside = at([0.0, 0.0, 2.0], [5.0, 0, 0.0], [0.0, 8.0, 0.0], 0.0)
    assert draw_marker(Lens(PLAIN), *marker_motion(aside, 0, 0, MARKER), MARKER, around) is None


@pytest.fixture(scope="module")
def bullet():
    """PyBullet's picture of one marked target from one camera, four times finer than the camera's pixels."""
    target = TargetSettings(name="t", motion=VectorFieldTarget(kind="vector_field", field="wave"))
    fine = PLAIN.model_copy(
        update={
            "width_px": 2560, "height_px": 1472, "fx_px": 1680.0, "fy_px": 1660.0, "cx_px": 4 * 318.5 - 0.5,
            "cy_px": 4 * 186.5 - 0.5,
        }
    )  # fmt: skip
    cameras = [
        CameraModel(name=n, intrinsics=k, near_m=0.2, far_m=10.0) for n, k in (("c", PLAIN), ("f", fine))
    ]
    down = rot.look_at(np.array([0.0, 0.0, 3.0]), np.zeros(3))
    description = WorldDescription(
        physics=PhysicsSettings(step_hz=60),
        control_hz=60.0,
        cameras=tuple(CameraSpec(c.name, c, np.array([0.0, 0.0, 3.0]), down) for c in cameras),
        targets=(TargetSpec("t", target.size_m, ROOF, build_motion(target, ()), MARKER),),
    )
    world = PyBulletWorld(description)
    world.reset(np.random.default_rng(0))
    yield world
    world.close()


def _shown(world, scene, camera, width, height):
    two = {
        name: np.concatenate([getattr(scene, name)] * 2)
        for name in ("camera_p_world", "camera_q_world", "camera_v_world", "camera_w_cam")
    }
    world.set_state(
        Snapshot(0.0, 0, NONE, np.zeros((0, 4)), NONE, NONE, *two.values(), scene.target_p_world, scene.target_q_world,
                 scene.target_v_world, scene.target_w_body)
    )  # fmt: skip
    return cv2.cvtColor(world.render(camera, width, height), cv2.COLOR_RGB2GRAY)


def test_the_drawn_marker_and_pybullets_agree(bullet):
    """Corners in both, in pixels: PyBullet's renderer has no smooth edges, so it is asked finer and averaged."""
    rng, apart, coarse = np.random.default_rng(2), [], []
    for _ in range(4):
        eye = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(1.8, 2.8)])
        scene = at(eye, [0, 0, 0.3], [*rng.uniform(-0.2, 0.2, 2), 0.0], rng.uniform(-3, 3))
        ours, lens = drawn(scene, PLAIN)
        fine = _shown(bullet, scene, 1, 2560, 1472).reshape(368, 4, 640, 4).mean(axis=(1, 3))
        mine = found(cv2.GaussianBlur(ours, (0, 0), 0.5))
        apart.append(found(cv2.GaussianBlur(fine, (0, 0), 0.5)) - mine)
        plain = _shown(bullet, scene, 0, 640, 368).astype(np.float32)
        coarse.append(found(cv2.GaussianBlur(plain, (0, 0), 0.5)) - mine)
        np.testing.assert_allclose(mine, true_pixels(scene, lens), atol=0.15)
    assert np.sqrt(np.mean(np.square(apart))) < 0.06
    assert np.abs(np.mean(apart, axis=(0, 1))).max() < 0.04
    assert np.sqrt(np.mean(np.square(coarse))) < 0.2

"""What the types of a scenario cannot say: names that refer to each other, orders of numbers, files that exist."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from camnet.config.check_field import field_problems
from camnet.config.check_geometry import check_geometry, track_problems
from camnet.config.check_pose import pose_problems
from camnet.config.check_sizes import size_problems
from camnet.config.diagnose import Problem, find, raise_problems, show
from camnet.config.models import Scenario
from camnet.config.yaml_nodes import FieldPath, Node, field_text
from camnet.errors import DataError, WorldError
from camnet.geometry.settings import CameraModel, FixedPose
from camnet.importers.tracks import load_tracks, only_track
from camnet.motion.settings import FieldTarget, RoadTarget, TargetSettings, TrackTarget, VectorFieldTarget

__all__ = ["check_scenario"]

_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
#: image size over focal length at a view of 170 degrees, beyond which no pinhole camera is meant
_WIDEST = 2.0 * math.tan(math.radians(85.0))
_SECTIONS = ("cameras", "regions", "agents", "fixed_cameras", "occluders", "roads", "targets")


def check_scenario(scenario: Scenario, root: Node) -> Scenario:
    """Check a valid scenario for sense and return it with its defaults filled in.

    Raises
    ------
    ConfigError
        Names that refer to nothing, numbers out of order, files that are not there; one line for every problem.
    WorldError
        Regions that overlap, agents outside of theirs.
    DataError
        A recorded track that cannot be read.
    """
    raise_problems(
        [
            *_names(scenario),
            *_references(scenario),
            *_numbers(scenario),
            *pose_problems(scenario),
            *size_problems(scenario),
        ],
        root,
    )
    _check_tracks(scenario, root)
    return check_geometry(scenario, root)


def _check_tracks(scenario: Scenario, root: Node) -> None:
    """Read the recorded tracks once, so that a fault in them is found before anything runs."""
    for i, target in enumerate(scenario.targets):
        if isinstance(target.motion, TrackTarget):
            field = ("targets", i, "motion", "file")
            try:
                track = only_track(load_tracks(target.motion), str(target.motion.file))
            except DataError as error:
                raise DataError(f"{find(root, field).origin}: {field_text(field)}: {error}") from None
            raise_problems(track_problems(scenario, field, track), root, WorldError)


def _names(scenario: Scenario) -> Iterator[Problem]:
    if not _NAME.match(scenario.name):
        yield Problem(("name",), show(scenario.name), _NAME_ADVICE)
    for section in _SECTIONS:
        seen: dict[str, int] = {}
        for index, item in enumerate(getattr(scenario, section)):
            path = (section, index, "name")
            if not _NAME.match(item.name):
                yield Problem(path, show(item.name), _NAME_ADVICE)
            if item.name in seen:
                yield Problem(
                    path, show(item.name), f"the name of {section}[{seen[item.name]}] too: names are unique"
                )
            seen.setdefault(item.name, index)
    yield from _body_names(scenario)


def _body_names(scenario: Scenario) -> Iterator[Problem]:
    """Names of bodies differ across sections too: collisions and views are reported by name alone."""
    owner: dict[str, str] = {}
    for section in ("agents", "fixed_cameras", "occluders", "targets"):
        for index, item in enumerate(getattr(scenario, section)):
            if owner.setdefault(item.name, section) != section:
                advice = f"also a name in {owner[item.name]}: bodies need different names"
                yield Problem((section, index, "name"), show(item.name), advice)


_NAME_ADVICE = "a name is letters, digits, _ and -, and begins with a letter or digit"


def _references(scenario: Scenario) -> Iterator[Problem]:
    cameras = [camera.name for camera in scenario.cameras]
    regions = [region.name for region in scenario.regions]
    for i, agent in enumerate(scenario.agents):
        yield from _refers(("agents", i, "region"), agent.region, regions, "region")
        yield from _refers(("agents", i, "camera"), agent.camera, cameras, "camera model")
    for i, fixed in enumerate(scenario.fixed_cameras):
        yield from _refers(("fixed_cameras", i, "camera"), fixed.camera, cameras, "camera model")
    yield from _one_agent_a_region(scenario)
    for i, target in enumerate(scenario.targets):
        yield from _target_references(i, target, scenario)
    if scenario.traffic is not None:
        yield from _refers(("traffic", "camera"), scenario.traffic.camera, cameras, "camera model")
        yield from _exists(
            ("traffic", "sumo_config"), scenario.traffic.sumo_config, "give the folder: --set data=FOLDER"
        )
        for section in ("regions", "agents", "targets"):
            if getattr(scenario, section):
                yield Problem((section,), "", "made by traffic: give either this or traffic")
        return
    if not scenario.targets:
        yield Problem(("targets",), "", "missing: give at least one target")
    if not scenario.agents and not scenario.fixed_cameras:
        yield Problem(("agents",), "", "missing: give at least one agent or fixed camera")


def _refers(path: FieldPath, name: str, known: Sequence[str], what: str) -> Iterator[Problem]:
    if name not in known:
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(known) or 'none'}"
        yield Problem(path, show(name), f"no such {what}: {hint}")


def _one_agent_a_region(scenario: Scenario) -> Iterator[Problem]:
    owner: dict[str, str] = {}
    for i, agent in enumerate(scenario.agents):
        if agent.region in owner:
            advice = f"the region of agent {owner[agent.region]!r} too: one agent a region"
            yield Problem(("agents", i, "region"), show(agent.region), advice)
        owner.setdefault(agent.region, agent.name)
    for i, region in enumerate(scenario.regions):
        if region.name not in owner:
            yield Problem(
                ("regions", i, "name"), show(region.name), "no agent is in this region: add one or remove it"
            )


def _target_references(i: int, target: TargetSettings, scenario: Scenario) -> Iterator[Problem]:
    motion = target.motion
    path: FieldPath = ("targets", i, "motion")
    roads = {road.name: road for road in scenario.roads}
    if isinstance(motion, RoadTarget):
        yield from _refers((*path, "road"), motion.road, list(roads), "road")
    elif isinstance(motion, VectorFieldTarget) and motion.field == "loop":
        if motion.road is None:
            yield Problem((*path, "road"), "", "missing: field 'loop' follows a closed road: give its name")
            return
        yield from _refers((*path, "road"), motion.road, list(roads), "road")
        if motion.road in roads and not roads[motion.road].closed:
            yield Problem((*path, "road"), show(motion.road), "field 'loop' needs a road with 'closed: true'")
    elif isinstance(motion, FieldTarget):
        yield from field_problems(path, target, motion)
    elif isinstance(motion, TrackTarget):
        yield from _exists(
            (*path, "file"), motion.file, "paths start at the file's folder, or at data=FOLDER"
        )


def _exists(path: FieldPath, file: Path, advice: str) -> Iterator[Problem]:
    if not file.is_file():
        yield Problem(path, show(str(file)), f"no such file: {advice}")


def _numbers(scenario: Scenario) -> Iterator[Problem]:
    for i, camera in enumerate(scenario.cameras):
        yield from _camera_numbers(("cameras", i), camera)
    for i, fixed in enumerate(scenario.fixed_cameras):
        yield from _pose_numbers(("fixed_cameras", i, "pose"), fixed.pose)
    for i, road in enumerate(scenario.roads):
        least = 3 if road.closed else 2
        if len(set(road.points_m)) < least:
            yield Problem(
                ("roads", i, "points_m"), show(road.points_m), f"give at least {least} different points"
            )
    for i, target in enumerate(scenario.targets):
        yield from _target_numbers(("targets", i), target)
    if scenario.traffic is not None and scenario.run.duration_s > scenario.traffic.duration_s:
        advice = f"longer than traffic.duration_s = {scenario.traffic.duration_s}"
        yield Problem(("run", "duration_s"), show(scenario.run.duration_s), advice)
    yield from _rates(scenario)
    yield from _flight(scenario)


def _camera_numbers(path: FieldPath, camera: CameraModel) -> Iterator[Problem]:
    if camera.near_m >= camera.far_m:
        yield Problem((*path, "near_m"), show(camera.near_m), f"must be below far_m = {camera.far_m}")
    inside = camera.intrinsics
    for axis, size in (("x", inside.width_px), ("y", inside.height_px)):
        center = getattr(inside, f"c{axis}_px")
        if not 0 < center < size:
            advice = f"the principal point is in the image: between 0 and {size}"
            yield Problem((*path, "intrinsics", f"c{axis}_px"), show(center), advice)
    for axis, size in (("x", inside.width_px), ("y", inside.height_px)):
        focal = getattr(inside, f"f{axis}_px")
        if focal < size / _WIDEST:
            wide = 2.0 * math.degrees(math.atan(0.5 * size / focal))
            advice = f"a view of {wide:.4g} degrees across {size} px; less than 170 degrees was expected"
            yield Problem((*path, "intrinsics", f"f{axis}_px"), show(focal), advice)
    if len(inside.distortion) not in (0, 4, 5, 8, 12, 14):
        advice = "OpenCV's distortion has 0, 4, 5, 8, 12 or 14 numbers: k1, k2, p1, p2, k3, ..."
        yield Problem((*path, "intrinsics", "distortion"), show(inside.distortion), advice)


def _pose_numbers(path: FieldPath, pose: FixedPose) -> Iterator[Problem]:
    if (pose.quaternion_wxyz is None) == (pose.look_at_m is None):
        yield Problem(path, "", "give either quaternion_wxyz or look_at_m")
    if pose.quaternion_wxyz is not None:
        norm = sum(part * part for part in pose.quaternion_wxyz) ** 0.5
        if abs(norm - 1.0) > 1e-3:
            advice = f"a unit quaternion (w, x, y, z) is expected; its norm is {norm:.4g}"
            yield Problem((*path, "quaternion_wxyz"), show(pose.quaternion_wxyz), advice)
    if pose.look_at_m is not None and pose.look_at_m == pose.position_m:
        yield Problem((*path, "look_at_m"), show(pose.look_at_m), "must differ from position_m")


def _target_numbers(path: FieldPath, target: TargetSettings) -> Iterator[Problem]:
    if len(target.features_m) < 4:
        yield Problem((*path, "features_m"), show(target.features_m), "give at least 4 points")
    if min(target.size_m) <= 0:
        yield Problem((*path, "size_m"), show(target.size_m), "sizes must be greater than 0")
    motion = target.motion
    if isinstance(motion, TrackTarget | FieldTarget):
        return
    slow, fast = (
        (motion.speed_mps, motion.speed_mps) if isinstance(motion, VectorFieldTarget) else motion.speed_mps
    )
    if not 0 < slow <= fast:
        advice = "give the slowest and the fastest speed, both greater than 0"
        yield Problem((*path, "motion", "speed_mps"), show([slow, fast]), advice)
    if fast > target.v_max_mps:
        advice = f"must not exceed v_max_mps = {target.v_max_mps} of the target"
        yield Problem((*path, "motion", "speed_mps"), show(motion.speed_mps), advice)


def _rates(scenario: Scenario) -> Iterator[Problem]:
    """Each clock ticks a whole number of times for every tick of the slower one that it drives."""
    control, decision = ("controller", "rate_hz"), ("run", "decision_hz")
    pairs: Iterable[tuple[FieldPath, float, FieldPath, float]] = (
        (control, scenario.controller.rate_hz, ("physics", "step_hz"), scenario.physics.step_hz),
        (("sensing", "rate_hz"), scenario.sensing.rate_hz, control, scenario.controller.rate_hz),
        (decision, scenario.run.decision_hz, control, scenario.controller.rate_hz),
        (("run", "log_hz"), scenario.run.log_hz, decision, scenario.run.decision_hz),
    )
    for path, slow, driver, fast in pairs:
        ratio = fast / slow
        if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
            advice = f"{field_text(driver)} = {fast:g} must be a whole multiple of it"
            yield Problem(path, show(slow), advice)


def _flight(scenario: Scenario) -> Iterator[Problem]:
    body, control = scenario.physics.quadrotor, scenario.controller
    lift = 4 * body.thrust_n_per_rad2ps2 * body.rotor_max_radps**2
    weight = body.mass_kg * scenario.physics.gravity_mps2
    if scenario.physics.actuation == "quadrotor" and scenario.agents and lift <= 1.2 * weight:
        advice = (
            f"too heavy: four rotors lift {lift:.4g} N, and {1.2 * weight:.4g} N are needed to fly and steer"
        )
        yield Problem(("physics", "quadrotor", "mass_kg"), show(body.mass_kg), advice)
    if min(body.inertia_kgm2) <= 0:
        yield Problem(
            ("physics", "quadrotor", "inertia_kgm2"), show(body.inertia_kgm2), "must be greater than 0"
        )
    if control.reference_v_max_mps > body.v_max_mps:
        advice = f"must not exceed physics.quadrotor.v_max_mps = {body.v_max_mps}"
        yield Problem(("controller", "reference_v_max_mps"), show(control.reference_v_max_mps), advice)

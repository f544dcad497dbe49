"""A recording: surveyed cameras and tracks of targets, replayed through the learned predictor."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from camnet.config.diagnose import Problem, raise_problems, show
from camnet.config.yaml_nodes import Node
from camnet.estimation.crossing.settings import CrossingSettings
from camnet.importers.cameras import CameraOptions, read_cameras
from camnet.importers.surveyed_camera import SurveyedCamera
from camnet.importers.tracks import Origin, TrackOptions, read_tracks
from camnet.motion.track import Track
from camnet.settings import Finite, Positive, Seed, Settings

__all__ = ["CameraFiles", "GeodeticOrigin", "RecordedScenario", "TrackFiles", "check_recorded"]


class GeodeticOrigin(Settings):
    """Where the local east-north-up frame touches the WGS84 ellipsoid; angles in degrees, as maps print them."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_m: Annotated[float, Field(ge=-1000, le=10000)] = 0.0


class CameraFiles(Settings):
    """Surveyed cameras: files matching ``glob`` in the data folder, in any format of ``camnet.importers.cameras``.

    Some formats (KRTD, KITTI) hold no image size, so it is given here, and none holds a range: ``range_cap_m`` is how
    far away a target can still be recognised. ``unit`` is that of the files' lengths; ``poses`` is a file in the data
    folder with poses for formats without.
    """

    glob: str = "cameras/*.krtd"
    width_px: Annotated[int, Field(gt=0, le=20_000)] = 1920
    height_px: Annotated[int, Field(gt=0, le=20_000)] = 1080
    unit: Literal["m", "cm", "mm"] | None = None
    poses: Path | None = None
    near_m: Positive = 0.5
    range_cap_m: Positive = 80.0


class TrackFiles(Settings):
    """Recorded tracks: one file in the data folder, with the tracks of all targets.

    A visit ends where fixes lie more than ``max_fix_interval_s`` apart: what the logger missed is no gap between
    cameras.
    """

    file: Path
    format: Literal["csv", "gpx", "fcd", "eth"] = "csv"
    max_fix_interval_s: Positive = 120.0


class RecordedScenario(Settings):
    """Recorded targets seen by surveyed cameras, learned from and predicted through the gaps between them.

    ``target_height_m`` is the z, in the cameras' local frame, of the point that must be in view.
    """

    name: str
    description: str = ""
    kind: Literal["recorded"]
    seed: Seed = 0
    data: Path = Field(description="the folder of the recording: --set data=FOLDER")
    cameras: CameraFiles = CameraFiles()
    tracks: TrackFiles
    origin: GeodeticOrigin | None = None
    target_height_m: Finite = 0.0
    crossing: CrossingSettings = CrossingSettings()

    def camera_files(self) -> tuple[Path, ...]:
        """Return the camera files of the recording, sorted."""
        return tuple(sorted(self.data.glob(self.cameras.glob)))

    def read_cameras(self) -> tuple[SurveyedCamera, ...]:
        """Read all cameras; DataError names the file and line of what is wrong."""
        given = self.cameras
        poses = None if given.poses is None else self.data / given.poses
        size = given.width_px, given.height_px
        return read_cameras(self.camera_files(), CameraOptions(None, size, given.unit, poses))

    def read_tracks(self) -> tuple[Track, ...]:
        """Read all tracks, one for each visit; DataError names the file and line of what is wrong."""
        where = self.origin
        local = None if where is None else Origin(where.latitude_deg, where.longitude_deg, where.altitude_m)
        return read_tracks(
            self.tracks.file,
            self.tracks.format,
            TrackOptions(local, max_gap_s=self.tracks.max_fix_interval_s),
        )


def check_recorded(scenario: RecordedScenario, root: Node) -> None:
    """Check what the types cannot say: folders and files are there and readable, ranges are in order.

    Raises
    ------
    ConfigError
        With one line for every problem found.
    DataError
        A camera file or the tracks cannot be read as what they claim to be.
    """
    raise_problems(_problems(scenario), root)
    scenario.read_cameras()
    scenario.read_tracks()


def _problems(scenario: RecordedScenario) -> Iterator[Problem]:
    cameras = scenario.cameras
    if cameras.near_m >= cameras.range_cap_m:
        yield Problem(
            ("cameras", "range_cap_m"), show(cameras.range_cap_m), f"must exceed near_m = {cameras.near_m}"
        )
    if scenario.tracks.format in ("csv", "gpx") and scenario.origin is None:
        yield Problem(
            ("origin",), "", "missing: give latitude_deg and longitude_deg of the cameras' local frame"
        )
    if not scenario.data.is_dir():
        yield Problem(
            ("data",), show(str(scenario.data)), "no such folder: give the recording's with --set data=FOLDER"
        )
        return
    if not scenario.tracks.file.is_file():
        yield Problem(("tracks", "file"), show(str(scenario.tracks.file)), "no such file")
    try:
        found = bool(scenario.camera_files())
    except (ValueError, NotImplementedError, OSError):
        found = False
    if not found:
        advice = f"no file in {scenario.data} matches: give a pattern such as 'cameras/*.krtd'"
        yield Problem(("cameras", "glob"), show(cameras.glob), advice)

"""The remedies of the gap problem on recorded people (MEVA): 14 surveyed cameras, GPS tracks, only the past.

| row | remedies | what it is |
| --- | --- | --- |
| ``none`` | - | flow field as published |
| ``prior`` | 1 | exit velocity that fades |
| ``across`` | 2 | flow field with integral windows across the gaps |
| ``experience`` | 4 | the lessons of everybody, without a prior |
| ``prior_across`` | 1, 2 | the flow field with both |
| ``prior_experience`` | 1, 4 | the default: the prior is one vote among the lessons |
| ``all`` | 1, 2, 4 | the flow field is the prior of the lessons |

Remedy 3 needs a road graph, which the site does not come with. Recorded predictors say where a target is at a given
time; when it comes back is asked of the lessons alone: the median time that the five nearest took (`clock`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from camnet.config.recorded import GeodeticOrigin, RecordedScenario, TrackFiles
from camnet.errors import ConfigError
from camnet.estimation.crossing import (
    CrossingSettings,
    ExitState,
    GapPredictor,
    Lesson,
    Sighting,
)
from camnet.estimation.crossing.sightings import CrossingPrediction, only_camera
from camnet.experiments.recorded import RecordedResult, run_recorded
from camnet.experiments.recorded_rows import remedy_rows
from camnet.importers.geodesy import Origin
from camnet.types import Array

__all__ = ["ReentryClock", "meva_scenario", "run_recorded_remedies"]

#: row here: row of the replay
_ROWS = {
    "none": "flow_printed",
    "prior": "prior",
    "across": "flow_gaps",
    "experience": "lessons_only",
    "prior_across": "flow_prior_gaps",
    "prior_experience": "learned",
    "all": "lessons_flow",
    "ekf": "ekf",
    "last_seen": "last_seen",
}
NEIGHBOURS = 5


class ReentryClock:
    """How long targets stay unseen: the median over the nearest exits, by position and velocity.

    It answers the place with the exit itself; what it expects of the time is kept in ``expected_s``.
    """

    def __init__(self, settings: CrossingSettings, cameras: int) -> None:
        self._scale = np.array([settings.position_scale_m] * 2 + [settings.velocity_scale_mps] * 2)
        self._cameras = cameras
        self._features: list[Array] = []
        self._duration_s: list[float] = []
        self._known_s: list[float] = []
        self.expected_s: list[float] = []
        self.typical_s: list[float] = []

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Note when the target is expected, and when it would be by all lessons alike."""
        known = int(np.searchsorted(np.array(self._known_s), exit.t_s))
        near = typical = np.nan
        if known:
            query = np.concatenate([exit.p_world, exit.v_world]) / self._scale
            d2 = np.sum((np.array(self._features[:known]) - query) ** 2, axis=1)
            duration = np.array(self._duration_s[:known])
            near = float(np.median(duration[np.argsort(d2, kind="stable")[:NEIGHBOURS]]))
            typical = float(np.median(duration))
        self.expected_s.append(near)
        self.typical_s.append(typical)
        return CrossingPrediction(exit.p_world, np.inf, only_camera(self._cameras, exit.camera), 0.0)

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Seen motion teaches nothing about times."""

    def learn(self, lesson: Lesson) -> None:
        """Learn how long a crossing took."""
        if lesson.reversed or lesson.extended:
            return
        features = np.concatenate([lesson.exit.p_world, lesson.exit.v_world]) / self._scale
        self._features.append(features)
        self._duration_s.append(lesson.entry.t_s - lesson.exit.t_s)
        self._known_s.append(lesson.known_s)


def run_recorded_remedies(data: Path, seed: int) -> dict[str, Any]:
    """Replay the recording in ``data`` past its cameras with every row.

    Raises
    ------
    ConfigError
        The folder holds no such recording.
    """
    scenario = meva_scenario(data)
    clocks: list[ReentryClock] = []

    def rows(settings: CrossingSettings, cameras: int, bounds: Array) -> Mapping[str, GapPredictor]:
        clocks.append(ReentryClock(settings, cameras))
        wanted = set(_ROWS.values())
        made = {k: v for k, v in remedy_rows(settings, cameras, bounds).items() if k in wanted}
        if "flow_gaps" in wanted:  # another row teaches its field
            made.setdefault("flow_prior_gaps", remedy_rows(settings, cameras, bounds)["flow_prior_gaps"])
        return {**made, "clock": clocks[0]}

    where = scenario.origin
    result = run_recorded(
        scenario.read_cameras(),
        scenario.read_tracks(),
        scenario.crossing,
        scenario.cameras.range_cap_m,
        None if where is None else Origin(where.latitude_deg, where.longitude_deg, where.altitude_m),
        seed,
        near_m=scenario.cameras.near_m,
        target_height_m=scenario.target_height_m,
        max_fix_interval_s=scenario.tracks.max_fix_interval_s,
        more_rows=rows,
    )
    return _tabulate(result, clocks[0])


def meva_scenario(data: Path) -> RecordedScenario:
    """Return the settings of the recording in ``data``, those of the recipe ``configs/meva.yaml``.

    Raises
    ------
    ConfigError
        The folder holds no such recording.
    """
    scenario = RecordedScenario(
        name="meva",
        kind="recorded",
        data=data,
        tracks=TrackFiles(file=data / "tracks.csv.gz"),
        origin=GeodeticOrigin(latitude_deg=39.04977294, longitude_deg=-85.52924953, altitude_m=205.0),
    )
    if not scenario.camera_files() or not scenario.tracks.file.is_file():
        raise ConfigError(f"--data {data}: expected cameras/*.krtd and tracks.csv.gz in this folder")
    return scenario


def _tabulate(result: RecordedResult, clock: ReentryClock) -> dict[str, Any]:
    gaps = result.gaps
    pairs = list(zip(gaps["exit_camera"], gaps["entry_camera"], strict=True))
    known: set[tuple[Any, Any]] = set()
    first = np.zeros(len(pairs), dtype=bool)
    for i, pair in enumerate(pairs):
        first[i] = pair not in known
        known.add(pair)
    took = np.asarray(gaps["entry_t_s"], dtype=float) - np.asarray(gaps["exit_t_s"], dtype=float)
    table = {}
    for name, row in _ROWS.items():
        error = np.asarray(gaps[f"{row}_error_m"], dtype=float)
        right = np.array(gaps[f"{row}_next_camera"]) == np.array(gaps["entry_camera"])
        table[name] = {
            part: {
                "place_median_m": float(np.median(error[mask])),
                "place_rms_m": float(np.sqrt(np.mean(error[mask] ** 2))),
                "time_median_s": _median(clock.expected_s, took, mask)
                if "experience" in name or name == "all"
                else None,
                "next_camera": float(np.mean(right[mask])),
            }
            for part, mask in (("first", first), ("later", ~first))
        }
    return {
        "gaps": {"first": int(first.sum()), "later": int((~first).sum())},
        "rows": table,
        "time_median_s_of_all_lessons": _median(clock.typical_s, took, ~first),
        "gap_median_s": float(np.median(took)),
    }


def _median(expected_s: list[float], took_s: Array, mask: Array) -> float | None:
    error = np.abs(np.array(expected_s)[: len(took_s)] - took_s)[mask]
    error = error[np.isfinite(error)]
    return float(np.median(error)) if error.size else None

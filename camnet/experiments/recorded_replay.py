"""Take recorded fixes in the order of time: predict every gap that ends, then learn from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from camnet.estimation.crossing import (
    CameraViews,
    Crossing,
    CrossingPredictor,
    CrossingSettings,
    CrossingTracker,
    ExitState,
    FixFilter,
    GapPredictor,
)
from camnet.motion.track import Track
from camnet.types import Array, IntArray

__all__ = ["Fixes", "Progress", "Record", "collect", "replay"]

Progress = Callable[[float], None]

_PROGRESS_EVERY = 2000


@dataclass(frozen=True, eq=False, slots=True)
class Fixes:
    """All fixes in the order of time: ``camera`` is -1 where unseen, ``visit`` counts a target's visits."""

    t_s: Array
    p_world: Array
    target: IntArray
    visit: IntArray
    camera: IntArray
    names: tuple[str, ...]


@dataclass(eq=False, slots=True)
class Record:
    """Gaps so far, and what every row said of them: places (2,) and cameras (-1: from the place), by row."""

    crossings: list[Crossing] = field(default_factory=list)
    places: dict[str, list[Array]] = field(default_factory=dict)
    cameras: dict[str, list[int]] = field(default_factory=dict)
    radius_m: list[float] = field(default_factory=list)

    def add(self, name: str, place: Array, camera: int = -1) -> None:
        """Note a prediction of the row ``name``."""
        self.places.setdefault(name, []).append(place)
        self.cameras.setdefault(name, []).append(camera)


def collect(tracks: Sequence[Track], views: CameraViews, max_fix_interval_s: float) -> Fixes:
    """Order all fixes by time (then by target) and find out who sees them."""
    identities = [_identity(track.id) for track in tracks]
    names = tuple(dict.fromkeys(identities))
    target = np.repeat([names.index(identity) for identity in identities], [t.t_s.size for t in tracks])
    t_s = np.concatenate([track.t_s for track in tracks])
    p_world = np.concatenate([track.p_world[:, :2] for track in tracks])
    by_target = np.lexsort((t_s, target))
    new = np.ones(len(t_s), dtype=bool)
    new[1:] = (np.diff(t_s[by_target]) > max_fix_interval_s) | (np.diff(target[by_target]) != 0)
    visit = np.empty(len(t_s), dtype=np.int64)
    visit[by_target] = np.cumsum(new)
    order = np.lexsort((target, t_s))
    camera = views.camera_of(p_world[order])
    return Fixes(t_s[order], p_world[order], target[order], visit[order], camera, names)


def _identity(name: str) -> str:
    head, _, tail = name.rpartition("#")
    return head if head and tail.isdigit() else name


def replay(
    fixes: Fixes,
    rows: Mapping[str, GapPredictor],
    settings: CrossingSettings,
    min_gap_s: float,
    max_gap_s: float,
    progress: Progress | None,
) -> tuple[Record, bool]:
    """Take every fix in the order of time; Ctrl-C ends it early."""
    count = len(fixes.names)
    trackers = [CrossingTracker(k, settings.velocity_window_s) for k in range(count)]
    filters = [FixFilter(settings.filter) for _ in range(count)]
    visits = np.zeros(count, dtype=np.int64)
    record = Record()
    try:
        for i in range(len(fixes.t_s)):
            k, t_s = int(fixes.target[i]), float(fixes.t_s[i])
            tracker = trackers[k]
            last = tracker.last
            if visits[k] != fixes.visit[i] or (last is not None and t_s - last.t_s > max_gap_s):
                tracker.leave()
                visits[k] = fixes.visit[i]
            if fixes.camera[i] < 0:
                tracker.miss()
            else:
                _sight(fixes, i, tracker, filters[k], rows, record, min_gap_s)
            if progress is not None and i % _PROGRESS_EVERY == 0:
                progress(i / len(fixes.t_s))
    except KeyboardInterrupt:
        return _complete(record), True
    if progress is not None:
        progress(1.0)
    return record, False


def _sight(
    fixes: Fixes,
    i: int,
    tracker: CrossingTracker,
    kalman: FixFilter,
    rows: Mapping[str, GapPredictor],
    record: Record,
    min_gap_s: float,
) -> None:
    """One sighting: if it ends a gap, predict first, then learn."""
    t_s, p_world = float(fixes.t_s[i]), fixes.p_world[i]
    last = tracker.last
    crossing = tracker.sight(t_s, p_world, int(fixes.camera[i]))
    if crossing is not None and t_s - crossing.exit.t_s >= min_gap_s:
        _predict(crossing, kalman, rows, record)
    if last is None:
        kalman.restart(t_s, p_world)
    else:
        kalman.update(t_s, p_world)
        now = tracker.last
        if crossing is None and now is not None:
            for predictor in rows.values():
                predictor.observe(last, now)
    for lesson in tracker.lessons(crossing):
        for predictor in rows.values():
            predictor.learn(lesson)


def _predict(crossing: Crossing, kalman: FixFilter, rows: Mapping[str, GapPredictor], record: Record) -> None:
    exit_, t_s = crossing.exit, crossing.entry.t_s
    for name, predictor in rows.items():
        prediction = predictor.predict(exit_, t_s)
        learned = isinstance(predictor, CrossingPredictor)
        record.add(name, prediction.p_world, int(prediction.next_camera.argmax()) if learned else -1)
        if name == "learned":
            record.radius_m.append(prediction.radius_m)
            if isinstance(predictor, CrossingPredictor):
                record.add("learned_at_exit", prediction.p_world, _at_exit(predictor, exit_))
    record.add("ekf", kalman.predict(t_s))
    record.crossings.append(crossing)


def _at_exit(predictor: CrossingPredictor, exit: ExitState) -> int:
    return int(predictor.next_camera(exit).argmax())


def _complete(record: Record) -> Record:
    """Drop the half-written last gap of an interrupted run."""
    n = len(record.crossings)
    for name in record.places:
        del record.places[name][n:], record.cameras[name][n:]
    del record.radius_m[n:]
    return record

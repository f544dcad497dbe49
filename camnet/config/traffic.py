"""From a traffic simulation to a concrete scenario: regions, agents, targets and roads on real streets."""

from __future__ import annotations

import csv
import hashlib
import logging
import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from camnet.config.check import check_scenario
from camnet.config.models import Agent, Region, Scenario, TrafficRegions, TrafficSettings
from camnet.config.yaml_nodes import Node, Origin
from camnet.errors import DataError
from camnet.geometry.settings import Box, Road
from camnet.importers.sumo import network_file, read_sumo_network, roads_of, run_sumo
from camnet.importers.tracks import read_tracks
from camnet.importers.traffic import BusyRegion, busiest_regions, visits
from camnet.motion.replay import TrackPath
from camnet.motion.settings import TargetSettings, TrackTarget
from camnet.motion.track import Track
from camnet.settings import Settings
from camnet.storage.json_file import LIMIT_BYTES, read_json
from camnet.storage.reading import read_bounded
from camnet.storage.seal import seal_of
from camnet.storage.whole_file import whole_file, write_json
from camnet.types import Array

__all__ = ["busy_places", "expand_traffic"]

_LOG = logging.getLogger(__name__)
#: size of a car and four points on its roof (body frame: x forward, z up)
_CAR_M = (4.5, 1.8, 1.5)
_ROOF_M = ((1.0, 0.6, 1.5), (1.0, -0.6, 1.5), (-1.0, -0.6, 1.5), (-1.0, 0.6, 1.5))
_W_MAX_RADPS = 2.0
_MORE_PLACES = 12
#: cars in neighbouring lanes pass at about 3.2 m, centre to centre
_APART_M = 2.5
_CLOCK_S = 0.1


def expand_traffic(scenario: Scenario, cache_dir: str | Path) -> Scenario:
    """Replace the section ``traffic`` by the regions, agents, targets and roads that it stands for.

    SUMO runs once for each content of the settings and of the scenario's folder; the trace and what was made of it
    stay in ``cache_dir``. A scenario without the section comes back as it is.

    Parameters
    ----------
    scenario : checked, with ``traffic``
    cache_dir : where the trace, the targets' tracks and the result are kept

    Raises
    ------
    ConfigError
        SUMO is not installed.
    DataError
        The SUMO scenario cannot be read, or too little traffic comes out of it.
    """
    traffic = scenario.traffic
    if traffic is None:
        return scenario
    folder = Path(cache_dir).absolute() / f"traffic-{_key(traffic)}"
    made = folder / "made.json"
    parts = _kept(folder)
    if parts is None:
        parts = _make(traffic, folder)
        write_json(made, {"parts": parts, "seal": _seal(parts, folder)})
    concrete = Scenario.model_validate({**scenario.model_dump(mode="json"), **parts, "traffic": None})
    return check_scenario(concrete, Node({}, Origin(str(made))))


def _kept(folder: Path) -> dict[str, Any] | None:
    """Return what was made before; None, with a message if it is damaged, where it is to be made again."""
    made = folder / "made.json"
    if not os.path.lexists(made):
        return None
    try:
        content = read_json(made)
        if not isinstance(content, dict) or content.get("seal") != _seal(content.get("parts"), folder):
            raise DataError(f"{made}: its content, or that of tracks.csv, is not what was written")
    except DataError as error:
        _LOG.warning("%s; the traffic is made again", error)
        return None
    return dict(content["parts"])


def _seal(parts: object, folder: Path) -> str:
    """Seal of what was made, the tracks that it names included."""
    return seal_of([parts, hashlib.sha256(read_bounded(folder / "tracks.csv", LIMIT_BYTES)).hexdigest()])


def _key(traffic: TrafficSettings) -> str:
    """Digest of the settings and of the SUMO scenario's files."""
    digest = hashlib.sha256(traffic.model_dump_json(exclude={"sumo_config"}).encode())
    for path in [*sorted(traffic.sumo_config.parent.glob("*.xml")), traffic.sumo_config]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _make(traffic: TrafficSettings, folder: Path) -> dict[str, Any]:
    trace = run_sumo(
        traffic.sumo_config,
        folder / "fcd.xml.gz",
        traffic.warm_up_s + traffic.duration_s,
        traffic.seed,
        traffic.step_s,
    )
    tracks = _window(read_tracks(trace, "fcd"), traffic.warm_up_s, traffic.duration_s)
    places = busy_places(tracks, traffic.regions)
    chosen = _most_handed_over(tracks, places, traffic)
    if not places or not chosen:
        raise DataError(
            f"{traffic.sumo_config}: {len(tracks)} vehicles drive between {traffic.warm_up_s:g} s and "
            f"{traffic.warm_up_s + traffic.duration_s:g} s, and none of them passes two regions: lengthen "
            "traffic.duration_s, or enlarge traffic.regions.within_m"
        )
    origin = np.round(np.mean([(*p.min_m, *p.max_m) for p in places], axis=0).reshape(2, 2).mean(axis=0))
    driven = [_parked(track, origin, traffic.duration_s) for track in chosen]
    _write_tracks(folder / "tracks.csv", driven)
    parts: dict[str, Sequence[Settings]] = {
        "regions": [_region(i, place, origin, traffic.regions) for i, place in enumerate(places)],
        "agents": [_agent(i, place, origin, traffic) for i, place in enumerate(places)],
        "targets": [_target(i, track, folder / "tracks.csv") for i, track in enumerate(driven)],
        "roads": _roads(traffic, places, origin),
    }
    return {name: [item.model_dump(mode="json") for item in items] for name, items in parts.items()}


def _window(tracks: Sequence[Track], begin_s: float, duration_s: float) -> list[Track]:
    """Cut tracks to a window of time, which then begins at 0; tracks with less than two fixes in it are left out."""
    kept = []
    for track in tracks:
        first, last = np.searchsorted(track.t_s, [begin_s, begin_s + duration_s + 1e-9])
        if last - first >= 2:
            cut = track.select(int(first), int(last))
            kept.append(Track(cut.id, cut.t_s - begin_s, cut.p_world, cut.heading_rad, cut.speed_mps))
    return kept


def busy_places(tracks: Sequence[Track], settings: TrafficRegions) -> list[BusyRegion]:
    """Choose the busiest place, and the next busiest ones that are near enough to it."""
    if not tracks:
        return []
    found = busiest_regions(tracks, settings.size_m, settings.count + _MORE_PLACES, settings.margin_m)
    first = np.array(found[0].min_m)
    near = [place for place in found if np.linalg.norm(np.array(place.min_m) - first) <= settings.within_m]
    return near[: settings.count]


def _most_handed_over(
    tracks: Sequence[Track], places: Sequence[BusyRegion], traffic: TrafficSettings
) -> list[Track]:
    """Choose the tracks that change region most often; among equals, those that drive longest, then by identity.

    A parked car must not stand in another one's way, so tracks that ever come too close to a chosen one are passed
    over.
    """

    def rank(track: Track) -> tuple[int, float, str]:
        stays = visits(track, places)
        return -sum(a.region != b.region for a, b in pairwise(stays)), -track.duration_s, track.id

    clock = np.arange(0.0, traffic.duration_s, _CLOCK_S)
    chosen: list[Track] = []
    paths: list[Array] = []
    for (negative, _, _), track in sorted(((rank(t), t) for t in tracks), key=lambda pair: pair[0]):
        if len(chosen) == traffic.targets or negative == 0:
            break
        path = np.stack([np.interp(clock, track.t_s, track.p_world[:, k]) for k in (0, 1)], axis=1)
        if all(np.linalg.norm(path - other, axis=1).min() > _APART_M for other in paths):
            chosen.append(track)
            paths.append(path)
    return chosen


def _parked(track: Track, origin: Array, duration_s: float) -> Track:
    """Return a track about ``origin`` over the whole window: parked before and after its trip.

    Places are rounded as they are written, so that what is checked is what is read back.
    """
    t = np.round(track.t_s, 3)
    p_world = np.round(track.p_world - np.array([*origin, 0.0]), 3)
    before, after = t[0] > 0.0, t[-1] < duration_s
    t = np.concatenate([[0.0] if before else [], t, [duration_s] if after else []])
    p_world = np.concatenate(
        [p_world[:1] if before else p_world[:0], p_world, p_world[-1:] if after else p_world[:0]]
    )
    return Track(track.id, t, p_world)


def _write_tracks(path: Path, tracks: Sequence[Track]) -> None:
    """Write tracks as CSV."""
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["id", "t_s", "x_m", "y_m"])
        for track in tracks:
            for t, (x, y) in zip(track.t_s.tolist(), track.p_world[:, :2].tolist(), strict=True):
                writer.writerow([track.id, f"{t:.3f}", f"{x:.3f}", f"{y:.3f}"])


def _region(index: int, place: BusyRegion, origin: Array, settings: TrafficRegions) -> Region:
    low, high = np.array(place.min_m) - origin, np.array(place.max_m) - origin
    shape = Box(
        min_m=(round(float(low[0]), 3), round(float(low[1]), 3), 0.0),
        max_m=(round(float(high[0]), 3), round(float(high[1]), 3), settings.height_m),
    )
    return Region(name=f"place_{index}", shape=shape)


def _agent(index: int, place: BusyRegion, origin: Array, traffic: TrafficSettings) -> Agent:
    x, y = (np.array(place.min_m) + np.array(place.max_m)) / 2 - origin
    start = (round(float(x), 3), round(float(y), 3), traffic.agent_height_m)
    return Agent(name=f"camera_{index}", region=f"place_{index}", camera=traffic.camera, start_m=start)


def _target(index: int, track: Track, file: Path) -> TargetSettings:
    fastest = float(TrackPath.of(track).speeds().max())  # between the fixes too, as it will be driven
    return TargetSettings(
        name=f"car_{index}",
        motion=TrackTarget(kind="track", file=file, format="csv", id=track.id),
        size_m=_CAR_M,
        features_m=_ROOF_M,
        v_max_mps=round(1.01 * fastest + 0.01, 2),
        w_max_radps=_W_MAX_RADPS,
    )


def _roads(traffic: TrafficSettings, places: Sequence[BusyRegion], origin: Array) -> list[Road]:
    """Streets with a point within ``road_margin_m`` of the rectangle around all regions."""
    low = np.min([place.min_m for place in places], axis=0) - traffic.road_margin_m
    high = np.max([place.max_m for place in places], axis=0) + traffic.road_margin_m
    kept = []
    for index, road in enumerate(roads_of(read_sumo_network(network_file(traffic.sumo_config)))):
        points = np.array(road.points_m)
        if np.any(np.all((points >= low) & (points <= high), axis=1)):
            moved = tuple((round(float(x), 3), round(float(y), 3)) for x, y in points - origin)
            kept.append(Road(name=f"street_{index}", points_m=moved, width_m=road.width_m))
    return kept

"""How the certifier's cost grows: camera networks of any size on generated roads."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from camnet.certification.coverage import Views, cover_roads
from camnet.certification.road_arcs import RoadArcs, arcs_from_roads
from camnet.certification.road_gaps import road_gaps
from camnet.certification.transitions import GrowthModel, RoadTargetClass, certify_roads, network_report
from camnet.types import Array

__all__ = ["benchmark_certify", "generated_city", "nadir_views", "run"]

#: axes of a camera that looks down, image's up to the north: right, down, forward as columns
_NADIR = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def nadir_views(centres_xy: Array, height_m: float, footprint_m: float) -> Views:
    """Cameras that look straight down on square footprints of a given side at z = 0."""
    n = len(centres_xy)
    half = math.atan2(0.5 * footprint_m, height_m)
    c, s = math.cos(half), math.sin(half)
    normals_cam = np.array(
        [[c, 0, -s], [-c, 0, -s], [0, c, -s], [0, -c, -s], [0, 0, -1], [0, 0, 1]], dtype=float
    )
    normals = np.broadcast_to(normals_cam @ _NADIR.T, (n, 6, 3)).copy()
    eye = np.c_[centres_xy, np.full(n, height_m)]
    offsets = np.array([0, 0, 0, 0, -0.01 * height_m, 1.1 * height_m]) + np.einsum("cfk,ck->cf", normals, eye)
    side = 0.55 * footprint_m
    corners = eye[:, None, :] + side * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    return Views.create(normals, offsets, corners, eye)


def generated_city(cameras: int, seed: int = 0, block_m: float = 100.0) -> tuple[RoadArcs, Views]:
    """Return a jittered street grid with two streets a camera, and nadir cameras on every junction."""
    side = max(2, math.ceil(math.sqrt(cameras)))
    rng = np.random.default_rng(seed)
    axis = np.arange(side, dtype=float)
    nodes = block_m * np.stack(np.meshgrid(axis, axis, indexing="ij"), -1)
    nodes += rng.uniform(-0.2, 0.2, nodes.shape) * block_m
    streets = [
        _street(a, b, rng) for a, b in zip(nodes[:-1].reshape(-1, 2), nodes[1:].reshape(-1, 2), strict=True)
    ]
    streets += [
        _street(a, b, rng)
        for a, b in zip(nodes[:, :-1].reshape(-1, 2), nodes[:, 1:].reshape(-1, 2), strict=True)
    ]
    return arcs_from_roads(streets), nadir_views(nodes.reshape(-1, 2)[:cameras], 20.0, 30.0)


def _street(a: Array, b: Array, rng: np.random.Generator) -> Array:
    """Return a street with one bend."""
    across = np.array([a[1] - b[1], b[0] - a[0]])
    return np.stack([a, 0.5 * (a + b) + rng.uniform(-0.1, 0.1) * across, b])


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, object]:
    """Run the benchmark of the command line."""
    return benchmark_certify(seed=seed, progress=progress)


def benchmark_certify(
    sizes: Sequence[int] = (100, 1000, 10_000),
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, object]:
    """Certify generated networks and return their times and the exponent of growth, as data for JSON."""
    _certify_city(*generated_city(50, seed))  # compile and load first
    cases = []
    for size in sizes:
        city = generated_city(size, seed)
        start = time.perf_counter()
        transitions = _certify_city(*city)
        cases.append({"cameras": size, "transitions": transitions, "seconds": time.perf_counter() - start})
        if progress is not None:
            progress(len(cases) / len(sizes))
    exponent = math.nan
    if len(cases) > 1:
        logs = np.log([[case["cameras"], case["seconds"]] for case in cases])
        exponent = float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])
    return {"cases": cases, "exponent": exponent}


def _certify_city(roads: RoadArcs, views: Views) -> int:
    cameras = len(views)
    coverage = cover_roads(roads, views, height_m=0.5, extent_m=1.0)
    gaps = road_gaps(roads, coverage, search_m=500.0)
    target, growth = RoadTargetClass(5.0, 14.0, 1.0), GrowthModel(0.5, 0.3)
    tables = certify_roads(gaps, target, 20.0, 1.0, growth)
    network_report(gaps, tables, target, [f"cam{i}" for i in range(cameras)], growth=growth)
    pairs = (
        gaps.stretches.exit_camera[gaps.exit_stretch] * cameras
        + gaps.stretches.entry_camera[gaps.entry_stretch]
    )
    return len(np.unique(pairs))

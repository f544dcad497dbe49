"""``map.png``: regions, view footprints, roads, true and predicted path, handoffs, seen from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from camnet.geometry.frustum import Frustum
from camnet.report.run_data import RunData
from camnet.report.style import CAMERA_COLOURS, FILTER_COLOURS, figure_style, save
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray

__all__ = ["draw_network", "view_footprint", "write_map"]


def view_footprint(network: Network, camera: int, p_world: Array, q_world: Array) -> Array:
    """Footprint (K,2) of a camera's view volume at the height of the targets' features, m."""
    height = float(np.mean([t.features_m[:, 2].mean() for t in network.description.targets]))
    return Frustum.from_camera(network.cameras[camera]).in_world(p_world, q_world).footprint(height)


def draw_network(axes: Axes, network: Network) -> None:
    """Draw roads, occluders, operating regions and the footprints of fixed cameras."""
    for road in network.scenario.roads:
        line = np.array([*road.points_m, *(road.points_m[:1] if road.closed else ())])
        axes.plot(*line.T, color="#c9c2b2", linewidth=7, solid_capstyle="round", zorder=0)
    for j, region in enumerate(network.regions[: network.n_agents]):
        colour = CAMERA_COLOURS[j % len(CAMERA_COLOURS)]
        axes.add_patch(Polygon(region.footprint(), facecolor=colour, alpha=0.10, edgecolor="none", zorder=1))
        axes.add_patch(Polygon(region.footprint(), fill=False, edgecolor=colour, linewidth=1.4, zorder=2))
        corner = (region.bounds[0, 0], region.bounds[1, 1])
        axes.annotate(
            region.name, corner, textcoords="offset points", xytext=(4, -12), color=colour, fontsize=9
        )
    for k, spec in enumerate(network.description.cameras):
        colour = CAMERA_COLOURS[(network.n_agents + k) % len(CAMERA_COLOURS)]
        outline = view_footprint(network, network.n_agents + k, spec.p_world, spec.q_world)
        if len(outline):
            axes.add_patch(Polygon(outline, facecolor=colour, alpha=0.15, edgecolor=colour, zorder=1))
        axes.plot(*spec.p_world[:2], marker="s", color=colour, markersize=5)
        axes.annotate(
            spec.name,
            (spec.p_world[0], spec.p_world[1]),
            textcoords="offset points",
            xytext=(5, 5),
            color=colour,
            fontsize=8,
        )
    for occluder in network.occluders:
        axes.add_patch(Polygon(occluder.footprint(), facecolor="#555555", edgecolor="black", zorder=3))
    axes.set_aspect("equal")
    axes.set(xlabel="x (m)", ylabel="y (m)")


def write_map(run: RunData, path: Path) -> None:
    """Draw the map of a run."""
    with figure_style():
        figure = Figure(figsize=(8.6, 7.6))
        axes = figure.add_subplot()
        draw_network(axes, run.network)
        for m, target in enumerate(run.targets):
            _draw_paths(axes, run, target)
            _draw_handoffs(axes, run, m)
        _draw_agents(axes, run)
        axes.autoscale_view()
        axes.legend(handles=_legend(run), loc="upper left", bbox_to_anchor=(1.01, 1.0))
        view = run.summary["time_in_view"]
        done = run.summary["handoffs"]
        axes.set_title(
            f"{run.network.scenario.name}: in view {view:.0%} of the time, "
            f"{done['completed']} of {done['attempted']} handoffs completed"
        )
        save(figure, path)


def _draw_paths(axes: Axes, run: RunData, target: str) -> None:
    truth, estimate = run.vector(target)[:, :2], run.vector(f"{target}.{run.filters[0]}")[:, :2]
    seen: BoolArray = np.asarray(run.columns[f"{target}.seen_by"] >= 0)
    axes.plot(*truth.T, color="black", linewidth=0.8, zorder=4)
    known: BoolArray = np.asarray(np.isfinite(estimate).all(axis=1))
    segments = np.stack([estimate[:-1], estimate[1:]], axis=1)
    unseen: BoolArray = np.asarray(~seen[1:] & known[1:] & known[:-1])
    axes.add_collection(
        LineCollection(
            list(segments[unseen]), colors=FILTER_COLOURS["learned"], linewidths=1.3, alpha=0.8, zorder=5
        )
    )


def _draw_handoffs(axes: Axes, run: RunData, m: int) -> None:
    truth = run.vector(run.targets[m])
    for handoff in run.handoffs:
        if handoff["target"] != run.targets[m]:
            continue
        row = min(int(np.searchsorted(run.t_s, handoff["entered_s"])), len(truth) - 1)
        good = handoff["completed"]
        axes.plot(
            *truth[row, :2],
            marker="o" if good else "X",
            color="#2a9d5c" if good else "#c1121f",
            markersize=5 if good else 9,
            markeredgecolor="white",
            markeredgewidth=0.6,
            zorder=7,
        )


def _draw_agents(axes: Axes, run: RunData) -> None:
    for j, agent in enumerate(run.agents):
        colour = CAMERA_COLOURS[j % len(CAMERA_COLOURS)]
        camera_p, camera_q = run.vector(agent, "cam_p")[-1], run.quaternion(agent, "cam_q")[-1]
        outline = view_footprint(run.network, j, camera_p, camera_q)
        axes.plot(*run.vector(agent)[:, :2].T, color=colour, linewidth=0.5, alpha=0.5, zorder=3)
        if len(outline):
            axes.add_patch(
                Polygon(outline, fill=False, edgecolor=colour, linestyle="--", linewidth=1.0, zorder=6)
            )
        axes.plot(*camera_p[:2], marker="P", color=colour, markersize=8, markeredgecolor="white", zorder=8)


def _legend(run: RunData) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color="black", linewidth=0.8, label="true path"),
        Line2D([], [], color=FILTER_COLOURS["learned"], label="predicted while unseen"),
        Line2D([], [], color="#2a9d5c", marker="o", linestyle="", label="handoff completed"),
        Line2D([], [], color="#c1121f", marker="X", linestyle="", label="handoff missed"),
    ]
    if run.agents:
        handles.append(Line2D([], [], color="#555555", marker="P", linestyle="", label="agent at the end"))
        handles.append(Line2D([], [], color="#555555", linestyle="--", label="its view at the end"))
    if run.network.scenario.roads:
        handles.append(Line2D([], [], color="#c9c2b2", linewidth=6, label="road"))
    return handles

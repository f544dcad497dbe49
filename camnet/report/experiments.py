"""Figures of the published experiments: paths, states and errors over time, displacement errors of pedestrians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from camnet.geometry.rotations import angle_between, yaw_of
from camnet.report.run_data import spans
from camnet.report.style import UNSEEN, figure_style, save
from camnet.types import Array, BoolArray

__all__ = [
    "write_gap_remedies",
    "write_motion_learning",
    "write_pedestrians",
    "write_road_map",
    "write_states",
]

_COLOURS = {
    "learned": "#c1121f",
    "learned_image": "#f28482",
    "learned_published": "#9a7d0a",
    "learned_published_fixed_sign": "#d9b310",
    "ideal": "#2a9d5c",
    "ideal_image": "#95d5b2",
    "ekf": "#3a5ba0",
    "ekf_image": "#8d99ae",
    "ukf": "#7fa6d6",
    "constant_velocity": "#555555",
    "learned_own_velocity": "#e07a5f",
}
_LABELS = {
    "learned": "learned, our settings",
    "learned_image": "learned, from images",
    "learned_published": "learned, published settings",
    "learned_published_fixed_sign": "learned, published settings, fixed sign",
    "ideal": "ideal predictor",
    "ideal_image": "ideal predictor, from images",
    "ekf": "EKF, constant velocity",
    "ekf_image": "EKF, from images",
    "ukf": "UKF, constant velocity",
    "constant_velocity": "constant velocity",
    "learned_own_velocity": "learned + own velocity",
}


def _label(name: str) -> str:
    return _LABELS.get(name, name.replace("_", " "))


def _colour(name: str) -> str:
    return _COLOURS.get(name, "#999999")


def _shade(axes: Sequence[Axes], t_s: Array, seen: BoolArray) -> None:
    for axis in axes:
        for start, end in spans(t_s, ~seen):
            axis.axvspan(start, end, color=UNSEEN, zorder=0, linewidth=0)


def write_motion_learning(poses: Mapping[str, Array], folder: Path, scored_from_s: float) -> None:
    """Write ``trajectory.png``, ``states.png`` and ``errors.png`` of one run.

    Parameters
    ----------
    poses : ``t_s`` (K,), ``seen`` (K,), and for "truth" and each row ``<name>.p_world`` (K, 3) and ``<name>.q_world``
        (K, 4)
    folder : where to write
    scored_from_s : errors count from here on
    """
    names = [key.removesuffix(".p_world") for key in poses if key.endswith(".p_world")]
    rows = [name for name in names if name != "truth"]
    with figure_style():
        _trajectory(poses, rows, folder / "trajectory.png", scored_from_s)
        _states(poses, rows, folder / "states.png")
        _errors(poses, rows, folder / "errors.png", scored_from_s)


def _trajectory(poses: Mapping[str, Array], rows: Sequence[str], path: Path, from_s: float) -> None:
    late = poses["t_s"] >= from_s
    off = late & ~poses["seen"].astype(bool)
    columns = min(3, len(rows))
    lines = -(-len(rows) // columns)
    figure = Figure(figsize=(4.0 * columns, 4.2 * lines), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    truth = poses["truth.p_world"][late]
    low, high = truth[:, :2].min(axis=0) - 0.6, truth[:, :2].max(axis=0) + 0.6
    for axis, name in zip(axes, rows, strict=False):
        p = poses[f"{name}.p_world"].copy()
        p[~off] = np.nan
        axis.plot(truth[:, 0], truth[:, 1], color="black", linewidth=0.8, label="true path")
        axis.plot(p[:, 0], p[:, 1], color=_colour(name), linewidth=0.8, label="predicted, target unseen")
        axis.set(title=_label(name), xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axis.set(xlabel="x (m)", ylabel="y (m)")
    for axis in axes[len(rows) :]:
        axis.set_visible(False)
    axes[0].legend(loc="upper right", fontsize=7)
    save(figure, path)


def _states(poses: Mapping[str, Array], rows: Sequence[str], path: Path) -> None:
    t, seen = poses["t_s"], poses["seen"].astype(bool)
    figure = Figure(figsize=(13, 2.6 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), 3, sharex=True, squeeze=False)
    truth, yaw = poses["truth.p_world"], np.degrees(yaw_of(poses["truth.q_world"]))
    for line, name in zip(axes, rows, strict=True):
        _shade(list(line), t, seen)
        p = poses[f"{name}.p_world"]
        for i, letter in enumerate("xy"):
            line[i].plot(t, truth[:, i], color="black", linewidth=1.0, label="true")
            line[i].plot(t, p[:, i], color=_colour(name), linewidth=0.7, label=_label(name))
            line[i].set(ylabel=f"{letter} (m)", ylim=(truth[:, i].min() - 0.8, truth[:, i].max() + 0.8))
        line[2].plot(t, yaw, ".", color="black", markersize=0.8)
        line[2].plot(
            t, np.degrees(yaw_of(poses[f"{name}.q_world"])), ".", color=_colour(name), markersize=0.6
        )
        line[2].set(ylabel="heading (deg)", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
        line[0].legend(loc="upper right", fontsize=7)
    for axis in axes[-1]:
        axis.set_xlabel("time (s); shaded: no measurements")
    save(figure, path)


def _errors(poses: Mapping[str, Array], rows: Sequence[str], path: Path, from_s: float) -> None:
    t, seen = poses["t_s"], poses["seen"].astype(bool)
    figure = Figure(figsize=(12, 6.5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    _shade(list(axes), t, seen)
    for name in rows:
        away = np.linalg.norm(poses[f"{name}.p_world"] - poses["truth.p_world"], axis=1)
        turned = np.degrees(angle_between(poses[f"{name}.q_world"], poses["truth.q_world"]))
        axes[0].semilogy(t, np.maximum(away, 1e-4), color=_colour(name), linewidth=0.8, label=_label(name))
        axes[1].semilogy(t, np.maximum(turned, 1e-2), color=_colour(name), linewidth=0.8)
    for axis in axes:
        axis.axvline(from_s, color="black", linewidth=0.8, linestyle=":")
    axes[0].set_ylabel("position error (m)")
    axes[1].set(
        ylabel="orientation error (deg)", xlabel="time (s); shaded: no measurements; dotted: scored from"
    )
    axes[0].legend(ncols=3, fontsize=8, loc="lower right")
    save(figure, path)


def write_pedestrians(scenes: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Bars of ADE and FDE by scene and row, m.

    Parameters
    ----------
    scenes : by scene and row, ``ade_m`` and ``fde_m``
    path : image file to write
    """
    # the plain flow field is so far off that its bars would hide the others
    first = next(iter(scenes.values()))
    rows = [name for name, entry in first.items() if isinstance(entry, Mapping) and name != "flow_field"]
    with figure_style():
        figure = Figure(figsize=(11, 6), layout="constrained")
        axes = figure.subplots(2, 1, sharex=True)
        width = 0.8 / len(rows)
        for axis, measure, words in zip(axes, ("ade_m", "fde_m"), ("ADE (m)", "FDE (m)"), strict=True):
            for k, name in enumerate(rows):
                at = np.arange(len(scenes)) + (k - 0.5 * (len(rows) - 1)) * width
                values = [scene[name][measure] for scene in scenes.values()]
                axis.bar(
                    at, values, width, color=_colour(name), label=_label(name).removesuffix(", our settings")
                )
            axis.set_ylabel(words)
            axis.set_xticks(range(len(scenes)), list(scenes))
        axes[0].legend(ncols=len(rows), fontsize=8)
        save(figure, path)


def write_gap_remedies(worlds: Mapping[str, Mapping[str, Any]], rows: Sequence[str], path: Path) -> None:
    """Bars of the median error at re-sighting, by world and row, first and later crossings apart.

    Parameters
    ----------
    worlds : by world ``rows`` -> row -> ``first`` and ``later`` -> ``place_median_m``
    rows : in the order shown
    path : image file to write
    """
    with figure_style():
        figure = Figure(figsize=(4.2 * len(worlds), 3.6), layout="constrained")
        axes = figure.subplots(1, len(worlds), squeeze=False)[0]
        for axis, (world, table) in zip(axes, worlds.items(), strict=True):
            for shift, part, colour in ((-0.2, "first", "#c9b79c"), (0.2, "later", "#c1121f")):
                values = [table["rows"][name][part]["place_median_m"] or np.nan for name in rows]
                axis.barh(np.arange(len(rows)) + shift, values, 0.38, color=colour, label=f"{part} crossings")
            axis.set_yticks(range(len(rows)), [name.replace("_", " + ") for name in rows])
            axis.invert_yaxis()
            axis.set(xscale="log", title=world, xlabel="median error at re-sighting (m)")
            axis.set_xlim(left=0.5 * axis.dataLim.minpos[0])
            axis.xaxis.set_minor_formatter(NullFormatter())
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
        save(figure, path)


def write_states(poses: Mapping[str, Array], states: Path, errors: Path, scored_from_s: float) -> None:
    """Write states and errors over time of one target; ``poses`` as for `write_motion_learning`."""
    rows = [k.removesuffix(".p_world") for k in poses if k.endswith(".p_world") and not k.startswith("truth")]
    with figure_style():
        _states(poses, rows, states)
        _errors(poses, rows, errors, scored_from_s)


def write_road_map(
    roads: Sequence[Array],
    truth: Array,
    estimate: Array,
    seen: BoolArray,
    turned_unseen: BoolArray,
    camera_p: Array,
    path: Path,
) -> None:
    """Draw a road network with M robots' true paths, predictions while unseen, and the camera's path.

    Parameters
    ----------
    roads : centre lines (n, 2), m
    truth, estimate : (K, M, 3) true and estimated positions, m
    seen : (K, M) whether measured
    turned_unseen : (K, M) whether a turn that nobody saw lies behind
    camera_p : (K, 3) camera positions, m
    path : image file to write
    """
    count = truth.shape[1]
    with figure_style():
        figure = Figure(figsize=(6.2 * count, 4.6), layout="constrained")
        axes = figure.subplots(1, count, squeeze=False, sharex=True, sharey=True)[0]
        for m, axis in enumerate(axes):
            for road in roads:
                axis.plot(*road.T, color="#e2ddcf", linewidth=9, solid_capstyle="round", zorder=0)
            axis.plot(*camera_p[:, :2].T, color="#999999", linewidth=0.5, zorder=1, label="camera")
            axis.plot(*truth[:, m, :2].T, color="black", linewidth=0.7, zorder=2, label="true path")
            for mask, colour, words in (
                (~seen[:, m] & ~turned_unseen[:, m], _COLOURS["learned"], "predicted, same road"),
                (~seen[:, m] & turned_unseen[:, m], "#e0a526", "predicted after a turn that nobody saw"),
            ):
                p = np.where(mask[:, None], estimate[:, m, :2], np.nan)
                axis.plot(*p.T, color=colour, linewidth=1.1, zorder=3, label=words)
            axis.set(title=f"robot {m + 1}", aspect="equal", xlabel="x (m)", ylabel="y (m)")
            corner = np.vstack(roads)
            low, high = corner.min(axis=0) - 1.5, corner.max(axis=0) + 1.5
            axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes[0].legend(fontsize=7, loc="upper left")
        save(figure, path)

"""Files of ``camnet track``: tracks as CSV, a picture, and a page."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from camnet.estimation.followed_track import Followed
from camnet.importers.observations import Observations
from camnet.report.html import picture, table, write_page
from camnet.report.markup import shown
from camnet.storage.whole_file import whole_file, write_text

__all__ = ["FILES", "write_track_files"]

FILES = ("result.json", "track.csv", "observations.csv", "track.png", "report.html")
_AXES = ("x", "y", "z")
_CELLS = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))


def write_track_files(
    folder: Path, data: Observations, followed: dict[str, Followed], result: dict[str, Any]
) -> None:
    """Write ``track.csv``, ``observations.csv``, ``track.png`` and ``report.html``."""
    _write_tracks(folder / "track.csv", data, followed)
    if "adate" in followed:
        _write_flags(folder / "observations.csv", data, followed["adate"])
    _draw(folder / "track.png", data, followed)
    parts = [f"<h1>Track of {result['times']} times, {result['duration_s']:.6g} s</h1>", _said(result)]
    parts += [
        picture(
            folder / "track.png", "observations and tracks, seen from above, and the observers' residuals"
        )
    ]
    parts += ["<h2>Estimators</h2>", _figures(result["estimators"], "estimator")]
    parts += ["<h2>Observers</h2>", _figures(result["observers"], "observer")]
    write_page(folder / "report.html", "camnet: track", "\n".join(parts))


def _said(result: dict[str, Any]) -> str:
    named = {
        name: o["drifts_from_s"]
        for name, o in result["observers"].items()
        if o.get("drifts_from_s") is not None
    }
    if not named:
        return "<p>No observer drifts.</p>"
    words = ", ".join(f"<b>{shown(name)}</b> from t = {t:.6g} s" for name, t in named.items())
    return f'<p class="warn">Drifting: {words}. What it says there counts little.</p>'


def _figures(rows: dict[str, Any], head: str) -> str:
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    cells = [[key, *(_number(row.get(name)) for name in names)] for key, row in rows.items()]
    return table([head, *(name.replace("_", " ") for name in names)], cells)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _write_tracks(path: Path, data: Observations, followed: dict[str, Followed]) -> None:
    head = ["t_s"]
    columns = [data.times_s]
    for name, run in followed.items():
        for kind, place, spread in (
            ("", run.causal, run.causal_covariance),
            ("smoothed_", run.smoothed, run.smoothed_covariance),
        ):
            head += [f"{name}_{kind}{axis}_m" for axis in _AXES]
            columns += list(place.T)
            if spread is not None:
                head += [f"{name}_{kind}cov_{cell}_m2" for cell, _, _ in _CELLS]
                columns += [spread[:, i, j] for _, i, j in _CELLS]
    lines = [",".join(head)]
    lines += [
        ",".join("" if not np.isfinite(v) else f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)
    ]
    write_text(path, "\n".join(lines) + "\n")


def _write_flags(path: Path, data: Observations, run: Followed) -> None:
    assert run.outlying is not None
    assert run.drifting is not None
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["t_s", "observer", "x_m", "y_m", "z_m", "outlier", "drifting"])
        for k in range(len(data.step)):
            place = [f"{v:.9g}" for v in data.position[k]]
            flags = [int(run.outlying[k]), int(run.drifting[k])]
            writer.writerow(
                [f"{data.times_s[data.step[k]]:.9g}", data.names[data.observer[k]], *place, *flags]
            )


def _draw(path: Path, data: Observations, followed: dict[str, Followed]) -> None:
    figure = Figure(figsize=(13.0, 5.5), layout="constrained")
    FigureCanvasAgg(figure)
    above, residual = figure.subplots(1, 2)
    for j, name in enumerate(data.names):
        mine = data.observer == j
        above.plot(*data.position[mine, :2].T, ".", ms=2, alpha=0.4, label=f"{name} (observed)")
    for (name, run), style in zip(followed.items(), ("-", "--", ":"), strict=False):
        above.plot(*run.smoothed[:, :2].T, style, lw=1.6, label=f"{name}, smoothed")
    if data.truth is not None:
        above.plot(*data.truth[:, :2].T, "k", lw=0.8, label="truth")
    above.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="seen from above")
    above.legend(fontsize=7)
    best = next(iter(followed.values()))
    for j, name in enumerate(data.names):
        mine = data.observer == j
        off = np.linalg.norm(data.position[mine, :2] - best.smoothed[data.step[mine], :2], axis=1)
        residual.plot(data.times_s[data.step[mine]], off, lw=0.8, label=name)
        if best.drifting is not None and best.drifting[mine].any():
            flagged = best.drifting[mine]
            residual.plot(
                data.times_s[data.step[mine]][flagged], off[flagged], "rx", ms=3, label=f"{name}: drifting"
            )
    residual.set(xlabel="t (s)", ylabel="distance from the smoothed track (m)", title="observers")
    residual.legend(fontsize=7)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")

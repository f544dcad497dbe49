"""Page of several futures: ``futures.png``, ``report.html``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from camnet.report.html import picture, table, write_page
from camnet.report.markup import shown
from camnet.report.style import CAMERA_COLOURS, figure_style, save

__all__ = ["write_futures_page"]


def write_futures_page(folder: Path, content: dict[str, Any]) -> None:
    """Write picture and page of `camnet.experiments.traffic_futures.predict_traffic`'s summary."""
    _draw(folder / "futures.png", content)
    time, plain = content["time"], content["constant_speed"]
    keys = ("median_error_s", "held_by_80", "mean_width_s", "median_width_s")
    loss = content["log_loss"]
    branch = ("view", "next", "weight", "median_s", "low_s", "high_s")
    parts = [
        f"<h1>{shown(content['name'])}: what could be predicted</h1>",
        f"<p>{content['vehicles']} vehicles; {content['crossings']['taught']} crossings of the first half taught, "
        f"{content['crossings']['tested']} of the second half were predicted. The next view (or leaving for good) was "
        f"the likeliest one in {content['next_view_top1']:.1%} of them.</p>",
        picture(folder / "futures.png", "views and their futures"),
        table(
            ("log loss (nat)", "value"),
            [[name.replace("_", " "), value] for name, value in loss.items()],
        ),
        "<h2>When</h2>",
        table(
            ("time away", "median error (s)", "held by 80 % intervals", "mean width (s)", "median width (s)"),
            [["learned", *(time[k] for k in keys)], ["constant speed", *(plain[k] for k in keys)]],
        ),
        "<h2>Futures of each view, at its most usual exit</h2>",
        table(
            ("view", "next", "weight", "median (s)", "from (s)", "to (s), 80 %"),
            [[row[k] for k in branch] for row in content["branches"]],
        ),
    ]
    if content["hidden"]:
        parts += ["<h2>Labels hidden</h2>", _hidden(content["hidden"])]
    write_page(folder / "report.html", f"camnet: {content['name']}", "\n".join(parts))


def _hidden(rows: list[dict[str, Any]]) -> str:
    names = "vehicles a minute,entries,rank-1 at once,revised,nearest in time,IDF1 alone,IDF1 nearest in time"
    return table(
        names.split(","),
        [
            [
                row["vehicles_per_minute"],
                row["entries"],
                row["rank1_at_once"],
                row["rank1_revised"],
                row["rank1_nearest_in_time"],
                row["alone"]["learned"]["IDF1"],
                row["alone"]["nearest_in_time"]["IDF1"],
            ]
            for row in rows
        ],
    )


def _draw(path: Path, content: dict[str, Any]) -> None:
    """Draw the views, and from each usual exit an arrow to every next view, as thick as it is likely."""
    with figure_style():
        figure = Figure(figsize=(7.5, 6.5))
        axes = figure.add_subplot()
        centres = []
        for k, (x0, y0, x1, y1) in enumerate(content["places"]):
            colour = CAMERA_COLOURS[k % len(CAMERA_COLOURS)]
            axes.add_patch(
                Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=colour, alpha=0.3, edgecolor=colour)
            )
            centres.append(((x0 + x1) / 2, (y0 + y1) / 2))
            axes.annotate(f"view {k}", (x0, y1), xytext=(0, 3), textcoords="offset points", color=colour)
        for row in content["branches"]:
            start = row["exit_x_m"], row["exit_y_m"]
            colour = CAMERA_COLOURS[row["view"] % len(CAMERA_COLOURS)]
            if row["next"] == "leaves":
                words = f"{row['weight']:.0%} leave"
                axes.annotate(
                    words, start, xytext=(8, -12), textcoords="offset points", color=colour, fontsize=8
                )
                continue
            end = centres[int(row["next"].split()[1])]
            axes.annotate(
                "",
                end,
                start,
                arrowprops={"arrowstyle": "->", "color": colour, "lw": 0.5 + 4 * row["weight"]},
            )
            words = f"{row['weight']:.0%}, {row['median_s']:.0f} s" if row["median_s"] is not None else ""
            axes.text((start[0] + end[0]) / 2, (start[1] + end[1]) / 2, words, fontsize=8, color=colour)
        axes.margins(0.2)
        axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
        axes.autoscale_view()
        save(figure, path)

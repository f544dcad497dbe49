"""Page of targets with hidden names: ``reliability.png``, ``report.html``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from camnet.report.html import picture, table, write_page
from camnet.report.markup import shown
from camnet.report.style import CAMERA_COLOURS, figure_style, save

__all__ = ["write_identity_page"]

_WORDS = {
    "at_once": "at once",
    "one_to_one": "one-to-one, a window later",
    "revised": "revised, with companions",
}
_ALONE = {
    "learned": "learned crossings",
    "last_seen_place": "last seen place",
    "nearest_in_time": "nearest in time",
}


def write_identity_page(folder: Path, content: dict[str, Any]) -> None:
    """Write picture and page of `camnet.experiments.identify.identify`'s summary."""
    _write_reliability(folder / "reliability.png", content["calibration"])
    rank1, intervals = content["rank1"], content["ci95"]
    rows = [
        [
            words,
            rank1[name],
            f"{intervals[name][0]:.3f} to {intervals[name][1]:.3f}",
            content["log_loss"][name],
            content["calibration"][name]["ece_chosen"],
        ]
        for name, words in _WORDS.items()
    ]
    rows += [
        [f"{_ALONE.get(n, n)} (no learning)", rank1[n], None, None, None]
        for n in ("last_seen_place", "nearest_in_time", "chance")
    ]
    keys = ("rank1", "IDF1", "IDP", "IDR", "HOTA", "AssA", "switches")
    alone = [
        [_ALONE[name], *(int(row[k]) if k == "switches" else row[k] for k in keys)]
        for name, row in content["alone"].items()
    ]
    low, high = intervals["revised_above_at_once"]
    look = content["appearance"]
    seen = (
        ""
        if look is None
        else f" A simulated appearance alone would be right with {look['rank1_alone']:.2f}."
    )
    parts = [
        f"<h1>{shown(content['name'])}: who is seen again?</h1>",
        f"<p>{content['targets']} targets without names, seen again {content['entries']} times; on average "
        f"{content['candidates_mean']:.1f} gaps are open then.{seen}</p>",
        table(("decided", "right", "95 % (people)", "log loss", "calibration error"), rows),
        f"<p>Revised above at once: {low:+.3f} to {high:+.3f} with 95 % (bootstrap over people).</p>",
        "<h2>Do stated probabilities come true?</h2>",
        picture(folder / "reliability.png", "reliability curve"),
        "<h2>Running alone, on its own decisions</h2>",
        table(("gaps are closed by", *keys), alone),
        "<h2>How long until the right identity stands</h2>",
        table(("share of entries", "value"), list(content["time_to_identity"].items())),
    ]
    write_page(folder / "report.html", f"camnet: {content['name']}", "\n".join(parts))


def _write_reliability(path: Path, calibration: dict[str, Any]) -> None:
    with figure_style():
        figure = Figure(figsize=(6.0, 5.0))
        axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=0.8, linestyle="--")
        for k, (name, words) in enumerate(_WORDS.items()):
            bins = calibration[name]["reliability"]
            axes.plot(
                [b["stated"] for b in bins],
                [b["right"] for b in bins],
                marker="o",
                markersize=4,
                color=CAMERA_COLOURS[k],
                label=f"{words} (error {calibration[name]['ece_chosen']:.3f})",
            )
        axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="stated probability", ylabel="share that was right")
        axes.legend(loc="upper left")
        save(figure, path)

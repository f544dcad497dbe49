"""The score table in Markdown and HTML."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from camnet.evaluation.plot import draw_scores
from camnet.evaluation.scores import METRICS
from camnet.report.html import picture, table, write_page
from camnet.report.markup import cell, link, shown
from camnet.storage.whole_file import write_text

__all__ = ["markdown", "write_tables"]

_COLUMNS = (
    "return",
    "normalised",
    "time_in_view",
    "handoff_success",
    "reacquisition_delay_s",
    "position_rmse_unseen_m",
    "gospa_m",
    "id_switches",
    "certificate_violations",
)


def _cell(figure: dict[str, Any] | None) -> str:
    if figure is None:
        return "–"
    low, high = figure["ci95"]
    if low == high:
        return f"{figure['mean']:.4g}"
    return f"{figure['mean']:.4g} [{low:.4g}, {high:.4g}]"


#: the bound's own normalised return
_ONE = {"mean": 1.0, "ci95": [1.0, 1.0]}


def _measured(entry: dict[str, Any]) -> list[str]:
    """Columns in which any agent has a figure."""
    return [name for name in _COLUMNS if any(scores[name] for scores in entry["agents"].values())]


def _rows(entry: dict[str, Any]) -> list[list[str]]:
    order = sorted(entry["agents"], key=lambda a: -entry["agents"][a]["return"]["mean"])
    names = _measured(entry)
    rows = [[agent, *(_cell(entry["agents"][agent][name]) for name in names)] for agent in order]
    if "normalised" in names:  # the bound is an episode's, whoever plays it
        best = entry["agents"][order[0]]["bound"]
        rows.insert(
            0, ["(bound)", *(_cell({"return": best, "normalised": _ONE}.get(name)) for name in names)]
        )
    return rows


def _differences(entry: dict[str, Any]) -> list[list[str]]:
    rows = []
    for agent, found in entry["comparisons"].items():
        cells = [f"{_cell(f)}, p = {f['p']:.2g}" if f else "–" for f in found.values()]
        rows.append([agent, *cells])
    return rows


def _broken(rows: list[list[str]]) -> list[list[str]]:
    """Cells with the interval on a line of its own."""
    return [[row[0], *(cell.replace(" [", "\n[", 1) for cell in row[1:])] for row in rows]


def _words(names: list[str]) -> list[str]:
    """Headings that can be broken between words, with units."""
    return [name.removesuffix(f"_{unit}").replace("_", " ") + (f" ({unit})" if unit else "")
            for name, unit in ((n, METRICS[n].unit) for n in names)]  # fmt: skip


def _lines(head: list[str], rows: list[list[str]]) -> list[str]:
    escaped = [[cell(text) for text in row] for row in (head, *rows)]
    return [f"| {' | '.join(cells)} |" for cells in (escaped[0], ["---"] * len(head), *escaped[1:])]


def markdown(content: dict[str, Any]) -> str:
    """Return the tables of all worlds in Markdown: means over episodes with 95 % bootstrap intervals."""
    parts = []
    for entry in content["worlds"]:
        parts += [f"## {cell(entry['world'])}: {entry['episodes']} episodes", ""]
        parts += [*_lines(["agent", *_measured(entry)], _rows(entry)), ""]
        if entry["comparisons"]:
            parts += [f"{cell(content['reference'])} less each other agent, on the same seeds:", ""]
            names = list(next(iter(entry["comparisons"].values())))
            parts += [*_lines(["agent", *names], _differences(entry)), ""]
    return "\n".join(parts)


def _plot_name(world: str, taken: set[str]) -> str:
    """Return a file name for a world's picture that no other world of the page has."""
    base = re.sub(r"[^A-Za-z0-9_.-]+", "_", world).strip("._")[-100:]
    number = next(k for k in range(len(taken) + 1) if (base if k == 0 else f"{base}-{k + 1}") not in taken)
    name = base if number == 0 else f"{base}-{number + 1}"
    taken.add(name)
    return f"scores_{name}.png"


def write_tables(folder: Path, content: dict[str, Any], videos: dict[str, list[Path]]) -> None:
    """Write ``table.md``, ``report.html`` and a picture of each world's scores, ``scores_WORLD.png``."""
    write_text(folder / "table.md", markdown(content))
    parts = ["<h1>Evaluation</h1>"]
    taken: set[str] = set()
    for entry in content["worlds"]:
        parts.append(f"<h2>{shown(entry['world'])}: {entry['episodes']} episodes</h2>")
        plot = folder / _plot_name(entry["world"], taken)
        draw_scores(plot, entry, content["reference"])
        parts.append(picture(plot, f"scores of {entry['world']}"))
        parts.append(table(["agent", *_words(_measured(entry))], _broken(_rows(entry))))
        if entry["comparisons"]:
            parts.append(
                f"<p><b>{shown(content['reference'])}</b> less each other agent on the same seeds, sign-flip test:</p>"
            )
            names = list(next(iter(entry["comparisons"].values())))
            parts.append(table(["agent", *_words(names)], _broken(_differences(entry))))
        for path in videos.get(entry["world"], []):
            parts.append(f'<p>{shown(path.stem)}</p><video controls src="{link(path.name)}"></video>')
    meanings = [
        [name, m.unit, "more" if m.more_is_better else "less", m.meaning] for name, m in METRICS.items()
    ]
    parts += ["<h2>Figures</h2>", table(["figure", "unit", "better", "meaning"], meanings)]
    write_page(folder / "report.html", "camnet: evaluation", "\n".join(parts))

"""The score table in Markdown and HTML."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

from camnet.evaluation.scores import METRICS
from camnet.report.html import table, write_page

__all__ = ["markdown", "write_tables"]

_COLUMNS = (
    "return",
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


def _rows(entry: dict[str, Any]) -> list[list[str]]:
    order = sorted(entry["agents"], key=lambda a: -entry["agents"][a]["return"]["mean"])
    return [[agent, *(_cell(entry["agents"][agent][name]) for name in _COLUMNS)] for agent in order]


def _differences(entry: dict[str, Any]) -> list[list[str]]:
    rows = []
    for agent, found in entry["comparisons"].items():
        cells = [f"{_cell(f)}, p = {f['p']:.2g}" if f else "–" for f in found.values()]
        rows.append([agent, *cells])
    return rows


def _lines(head: list[str], rows: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)]


def markdown(content: dict[str, Any]) -> str:
    """Return the tables of all worlds in Markdown: means over episodes with 95 % bootstrap intervals."""
    parts = []
    for entry in content["worlds"]:
        parts += [f"## {entry['world']}: {entry['episodes']} episodes", ""]
        parts += [*_lines(["agent", *_COLUMNS], _rows(entry)), ""]
        if entry["comparisons"]:
            parts += [f"`{content['reference']}` less each other agent, on the same seeds:", ""]
            names = list(next(iter(entry["comparisons"].values())))
            parts += [*_lines(["agent", *names], _differences(entry)), ""]
    return "\n".join(parts)


def write_tables(folder: Path, content: dict[str, Any], videos: dict[str, list[Path]]) -> None:
    """Write ``table.md`` and ``report.html``."""
    (folder / "table.md").write_text(markdown(content), encoding="utf-8")
    parts = ["<h1>Evaluation</h1>"]
    for entry in content["worlds"]:
        parts.append(f"<h2>{html.escape(entry['world'])}: {entry['episodes']} episodes</h2>")
        parts.append(table(["agent", *_COLUMNS], _rows(entry)))
        if entry["comparisons"]:
            reference = html.escape(content["reference"])
            parts.append(
                f"<p><b>{reference}</b> less each other agent on the same seeds, sign-flip test:</p>"
            )
            names = list(next(iter(entry["comparisons"].values())))
            parts.append(table(["agent", *names], _differences(entry)))
        for path in videos.get(entry["world"], []):
            parts.append(
                f'<p>{html.escape(path.stem)}</p><video controls src="{html.escape(path.name)}"></video>'
            )
    meanings = [
        [name, m.unit, "more" if m.more_is_better else "less", m.meaning] for name, m in METRICS.items()
    ]
    parts += ["<h2>Figures</h2>", table(["figure", "unit", "better", "meaning"], meanings)]
    write_page(folder / "report.html", "camnet: evaluation", "\n".join(parts))

"""``report.html``: the figures of a run on one self-contained page."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from camnet.report.markup import link, shown
from camnet.report.run_data import RunData
from camnet.report.style import FILTER_LABELS
from camnet.storage.whole_file import write_text

__all__ = ["picture", "table", "write_page", "write_report"]

#: a video larger than this stays beside the page instead of inside it
_EMBED_LIMIT_BYTES = 12_000_000
#: a report lists so many events
_MOST_EVENTS = 200
_EVENTS = {"sighting": "sightings", "loss": "losses", "handoff": "handoffs", "collision": "collisions"}
_WORDS = ' class="words"'
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:1080px;margin:2rem auto;padding:0 1rem;color:#222}
h1{font-size:1.5rem;margin-bottom:.2rem}h2{font-size:1.1rem;margin-top:2rem;border-bottom:1px solid #ddd}
table{border-collapse:collapse;margin:.6rem 0}
td,th{padding:.25rem .8rem;border-bottom:1px solid #e5e5e5;text-align:right}
td:first-child,th:first-child,.words{text-align:left}th{font-weight:600;background:#f6f5f1}img,video{max-width:100%}
.figures{display:flex;gap:1.2rem;flex-wrap:wrap}.figures div{background:#f6f5f1;padding:.6rem 1rem;border-radius:.4rem}
.figures b{display:block;font-size:1.3rem}.warn{background:#fdecea;padding:.6rem 1rem;border-radius:.4rem}
.wide{overflow-x:auto}td small{display:block;color:#777;white-space:nowrap}
pre{background:#f6f5f1;padding:1rem;overflow-x:auto;font-size:12px}
"""


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return an HTML table; cells are escaped, and stand in small letters from their first line break on."""
    rows = list(rows)
    words = {k for row in rows for k, c in enumerate(row) if _is_words(c)}
    words |= {k for k in range(len(head)) if rows and all(_is_word(row[k]) for row in rows)}
    line = (
        "<tr>"
        + "".join(f"<th{_WORDS if k in words else ''}>{shown(h)}</th>" for k, h in enumerate(head))
        + "</tr>"
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{_WORDS if k in words else ''}>{_lines(_cell(c))}</td>" for k, c in enumerate(row))
        + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table>{line}{body}</table></div>'


def _lines(text: str) -> str:
    first, _, more = text.partition("\n")
    return shown(first) + (f"<small>{shown(more)}</small>" if more else "")


def _is_word(value: object) -> bool:
    """Whether a cell holds no figure: columns of nothing else stand at the left too."""
    return isinstance(value, str) and value[:1].isalpha()


def _is_words(value: object) -> bool:
    """Whether a cell holds a sentence: columns with one stand at the left, figures at the right."""
    return isinstance(value, str) and len(value.split()) > 2 and value[0].isalpha()


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def write_page(path: Path, title: str, body: str) -> None:
    """Write one self-contained page (a temporary name first)."""
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{shown(title)}</title>'
        f"<style>{_STYLE}</style></head><body>{body}</body></html>\n"
    )
    write_text(path, page)


def write_report(run: RunData, path: Path) -> None:
    """Write the report of a network run from what lies in its folder."""
    scenario, summary = run.network.scenario, run.summary
    parts = [f"<h1>{shown(scenario.name)}</h1><p>{shown(scenario.description)}</p>"]
    if summary["interrupted"]:
        parts.append(
            f'<p class="warn">This run was interrupted after {summary["simulated_s"]:.1f} of '
            f"{scenario.run.duration_s:.0f} s; its figures are valid up to there.</p>"
        )
    parts += [_headline(summary), picture(run.folder / "map.png", "map"), _video(run.folder / "video.mp4")]
    parts += ["<h2>How well each estimator did</h2>", _estimator_table(run)]
    parts += [picture(run.folder / "estimates.png", "estimates over time")]
    if (run.folder / "instruments.png").exists():
        parts += [
            "<h2>Lyapunov analysis</h2>",
            picture(run.folder / "instruments.png", "instruments over time"),
        ]
    parts += ["<h2>Handoffs</h2>", _handoff_table(run)]
    parts += ["<h2>Events</h2>", _event_table(run)]
    parts += ["<h2>Dwell times</h2>", _nested_table(summary["dwell"])]
    parts += ["<h2>Controller</h2>", _nested_table(summary["controller"])]
    parts += [f"<h2>Settings</h2><pre>{shown(json.dumps(scenario.model_dump(mode='json'), indent=2))}</pre>"]
    write_page(path, f"camnet: {scenario.name}", "\n".join(parts))


def _headline(summary: dict[str, Any]) -> str:
    done, delay = summary["handoffs"], summary["reacquisition_delay_s"]["mean"]
    unseen = summary["position_rmse_m"]["unseen"]
    figures = [
        (f"{summary['time_in_view']:.1%}", "of the time in view"),
        (f"{done['completed']} / {done['attempted']}", "handoffs completed"),
        ("–" if delay is None else f"{delay:.2f} s", "mean reacquisition delay"),
        ("–" if unseen is None else f"{unseen:.3f} m", "position RMSE while unseen, from the third lap on"),
        (f"{summary['collisions']}", "collisions"),
        (f"{summary['real_time_factor']:.1f} x", "real time"),
    ]
    return (
        '<div class="figures">'
        + "".join(f"<div><b>{shown(a)}</b>{shown(b)}</div>" for a, b in figures)
        + "</div>"
    )


def _estimator_table(run: RunData) -> str:
    summary = run.summary
    rows = {run.filters[0]: summary, **summary["baselines"]}
    head = ["estimator", "seen (m)", "unseen, lap 1 (m)", "unseen, lap 3 on (m)"]
    head += ["seen (deg)", "unseen, lap 1 (deg)", "unseen, lap 3 on (deg)"]
    keys = ("seen", "unseen_first_lap", "unseen")
    return table(
        head,
        [
            [FILTER_LABELS.get(name, name)]
            + [row["position_rmse_m"][k] for k in keys]
            + [row["orientation_rmse_deg"][k] for k in keys]
            for name, row in rows.items()
        ],
    )


def _handoff_table(run: RunData) -> str:
    if not run.handoffs:
        return "<p>No handoff was attempted.</p>"
    keys = ("target", "from", "to", "lost_s", "entered_s", "delay_s", "completed")
    head = ("target", "from", "to", "lost at (s)", "entered at (s)", "delay (s)", "completed")
    return table(head, [[h[k] for k in keys] for h in run.handoffs])


def _event_table(run: RunData) -> str:
    if run.events is None:
        return "<p>This run is from before there was a table of events; simulate it again for one.</p>"
    kinds = [row["event"] for row in run.events]
    counted = ", ".join(f"{kinds.count(kind)} {words}" for kind, words in _EVENTS.items())
    head = ("time (s)", "event", "who", "camera or other body", "from", "after (s)", "completed")
    keys = ("t_s", "event", "subject", "with", "from", "duration_s", "completed")
    shown_rows = [[row[key] for key in keys] for row in run.events[:_MOST_EVENTS]]
    more = len(run.events) - len(shown_rows)
    rest = f"<p>{more} more are in events.parquet; camnet log --events shows all.</p>" if more else ""
    return f"<p>{counted}.</p>{table(head, shown_rows) if shown_rows else ''}{rest}"


def _nested_table(content: dict[str, Any]) -> str:
    return table(("quantity", "value"), list(_flatten(content)))


def _flatten(content: object, prefix: str = "") -> Iterable[tuple[str, object]]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _flatten(value, f"{prefix}{key} · " if isinstance(value, dict) else f"{prefix}{key}")
    elif isinstance(content, list):
        yield (
            prefix.rstrip(" ·"),
            f"{len(content)} entries" if content and isinstance(content[0], dict) else content,
        )
    else:
        yield prefix, content


def _data_uri(path: Path, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def picture(path: Path, words: str) -> str:
    """Return the picture at ``path`` inside the page, or nothing if there is none."""
    return f'<p><img alt="{shown(words)}" src="{_data_uri(path, "image/png")}"></p>' if path.exists() else ""


def _video(path: Path) -> str:
    if not path.exists():
        return ""
    small = path.stat().st_size <= _EMBED_LIMIT_BYTES
    source = _data_uri(path, "video/mp4") if small else link(path.name)
    return f'<p><video controls muted loop src="{source}"></video></p>'

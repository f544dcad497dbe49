from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camnet.evaluation.scores import METRICS
from camnet.evaluation.table import markdown, write_tables
from camnet.report.certificate import MapLine, write_certificate
from camnet.report.html import table, write_page
from camnet.report.markup import cell, shown
from camnet.report.recorded import write_recorded_report

HOSTILE = (
    "<script>alert(1)</script>|`$x^$` \"'><img src=x onerror=y>\n| a | b |\n# [t](javascript:z) & \\| \x07"
)
ALLOWED = {"html", "head", "meta", "title", "style", "body", "h1", "h2", "p", "b", "div", "small", "pre"}
ALLOWED |= {
    "table",
    "tr",
    "th",
    "td",
    "ul",
    "li",
    "img",
    "video",
    "svg",
    "g",
    "rect",
    "polygon",
    "polyline",
    "path",
    "text",
}


class _Page(HTMLParser):
    """Collects elements, event handlers and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.text += data


def _harmless(path: Path) -> _Page:
    page = _Page(path.read_text(encoding="utf-8"))
    assert set(page.tags) <= ALLOWED
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert not [
        v for name, v in page.attributes if name in ("src", "href") and (v or "").startswith("javascript")
    ]
    return page


def _cells(line: str) -> int:
    """Columns of a Markdown table's line: bars that no backslash takes away."""
    assert line.startswith("| ")
    assert line.endswith(" |")
    return len(re.findall(r"(?<!\\)(?:\\\\)*\|", line)) - 1


def _scores(shift: float) -> dict[str, object]:
    return {name: {"mean": shift, "ci95": [shift - 1, shift + 1], "n": 2} for name in METRICS}


def _content() -> dict[str, object]:
    difference = {"mean": 1.0, "ci95": [0.0, 2.0], "p": 0.5}
    entry = {
        "world": HOSTILE,
        "episodes": 2,
        "agents": {HOSTILE: _scores(1.0), "nearest": _scores(2.0)},
        "comparisons": {"nearest|x": dict.fromkeys(("return", "time_in_view"), difference)},
    }
    return {"worlds": [entry, entry], "reference": HOSTILE}


def test_score_tables_show_markup_and_do_not_obey_it(tmp_path: Path) -> None:
    write_tables(tmp_path, _content(), {HOSTILE: [tmp_path / "a<b> 'c'.mp4"]})
    page = _harmless(tmp_path / "report.html")
    assert page.text.count("<script>alert(1)</script>") >= 4
    assert len(list(tmp_path.glob("scores_*.png"))) == 2  # two worlds of one name have a picture each


def test_markdown_tables_keep_their_columns() -> None:
    text = markdown(_content())
    tables = [block.splitlines() for block in text.split("\n\n") if block.startswith("|")]
    assert len(tables) == 4
    for lines in tables:
        assert len({_cells(line) for line in lines}) == 1
    assert "<" not in text


def test_certificates_and_recordings_show_markup(tmp_path: Path) -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    gap = {"from": HOSTILE, "to": HOSTILE, "gap_m": 1.0, "sound": {"verdict": HOSTILE, "binding": HOSTILE}}
    report = {
        "network": {"name": HOSTILE, "cameras": HOSTILE, "regions": 1},
        "target_class": HOSTILE,
        "certificates": {HOSTILE: {"verdict": HOSTILE, "reason": HOSTILE}},
        "transitions": [gap],
        "assumptions": [HOSTILE],
    }
    write_certificate(tmp_path, report, [(HOSTILE, square)], [MapLine(square, "certified", HOSTILE)])
    assert _harmless(tmp_path / "report.html").text.count("<script>") >= 8
    gaps = {"count": HOSTILE, "next_camera_accuracy": {}}
    write_recorded_report(tmp_path, HOSTILE, HOSTILE, {"gaps": gaps, "recording": {HOSTILE: HOSTILE}})
    assert _harmless(tmp_path / "report.html").text.count("<script>") >= 5


@given(st.text(), st.text())
def test_any_text_is_shown_as_it_is(a: str, b: str) -> None:
    kept = lambda text: "".join(c for c in text if c.isprintable())  # noqa: E731 - one line, used twice
    page = _Page(f'<p title="{shown(a)}">{shown(b)}</p>')
    assert page.tags == ["p"]
    assert kept(page.attributes[0][1] or "") == kept(a) or not a.isprintable()
    assert kept(page.text) == kept(b) or not b.isprintable()
    assert _cells(f"| {cell(a)} | {cell(b)} |") == 2


def test_a_table_escapes_heads_and_cells(tmp_path: Path) -> None:
    write_page(tmp_path / "p.html", HOSTILE, table([HOSTILE], [[HOSTILE], [None], [1.0]]))
    assert _harmless(tmp_path / "p.html").tags.count("td") == 3

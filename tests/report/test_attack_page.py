"""The page of an attack says what its figures say."""

from __future__ import annotations

import re

import pytest

from camnet.report.falsify import write_attack_page

_WORST = {
    "unseen_way_m": {
        "value": 9.99, "promised": 9.43, "margin": -0.56, "share": 1.06, "target": "van", "from_s": 12.0,
        "into_first_view": False, "cut_off": False, "from": "west", "to": "north",
    },
    "error_m": {
        "value": 0.2, "promised": None, "margin": None, "share": None, "target": "van", "from_s": 3.0, "gap_s": 1.0,
    },
}  # fmt: skip


@pytest.mark.parametrize("violations", [0, 17])
def test_the_verdict_comes_first(tmp_path, violations):
    content = {
        "world": "<b>two</b>", "violations": violations, "trials": 96, "out_of_time": False, "stretches": 2781,
        "closest_fraction": 1.0592, "worst": _WORST, "violate": {"footprint": 0.7}, "broken": ["unseen_way_m"],
        "assumptions": {"no collisions": 0.0, "bound of the disturbance": 0.75},
        "nearest_to_breaking": "bound of the disturbance",
    }  # fmt: skip
    write_attack_page(tmp_path / "p.html", content)
    page = (tmp_path / "p.html").read_text()
    text = re.sub(r"\s+", " ", re.sub(r"<style>.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL))
    assert "<b>two</b>" not in page
    assert ("the promise is broken" in text) == (violations > 0)
    assert text.index("the promise") < text.index("of 96 hostile flights") < text.index("west to north")
    for words in (
        f"{violations} of 96",
        "105.9%",
        "footprint times 0.7",
        "9.99 m",
        "-0.56 m",
        "nearest to breaking",
    ):
        assert words in text

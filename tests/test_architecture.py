"""Every file that docs/architecture.md and CONTRIBUTING.md name is there; every package has its place on the page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def named(page: str) -> set[str]:
    return set(
        re.findall(r"[\w./]*\w+/[\w/]+\.(?:py|md|toml|yaml)\b", (ROOT / page).read_text(encoding="utf-8"))
    )


@pytest.mark.parametrize(("page", "least"), [("docs/architecture.md", 40), ("CONTRIBUTING.md", 10)])
def test_the_files_named_are_there(page: str, least: int) -> None:
    names = named(page)
    assert len(names) >= least
    missing = [n for n in names if not ((ROOT / "camnet" / n).is_file() or (ROOT / n).is_file())]
    assert missing == []


def test_every_package_is_on_the_page() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    packages = {p.parent.name for p in (ROOT / "camnet").glob("*/__init__.py")}
    hidden = {"compiled", "geometry", "worlds"}  # tools of the others, and data
    assert [p for p in sorted(packages - hidden) if f"{p}/" not in text] == []

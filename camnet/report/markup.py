"""Text that is shown on a page or in a Markdown table, whatever it holds.

Names come from files, files from anywhere. Everything that a page shows goes through `shown`, and everything in a
Markdown table through `cell`, so that markup in a name is seen and not obeyed.
"""

from __future__ import annotations

import html
import re
from urllib.parse import quote

__all__ = ["cell", "link", "shown"]

#: what no page may hold: control characters but for the line break and the tab, and halves of surrogate pairs
_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
_MARKDOWN = re.compile(r"([\\|`*\[\]~])")


def shown(value: object) -> str:
    """Return a value as text of an HTML page, also between quotes of an attribute."""
    return html.escape(_UNPRINTABLE.sub("\ufffd", str(value)), quote=True)


def cell(value: object) -> str:
    """Return a value as text of one cell of a Markdown table, or of a line of Markdown."""
    one_line = " ".join(_UNPRINTABLE.sub("\ufffd", str(value)).split())
    return _MARKDOWN.sub(r"\\\1", html.escape(one_line, quote=False))


def link(name: str) -> str:
    """Return a file's name as the address of a file beside the page."""
    return "./" + quote(name)

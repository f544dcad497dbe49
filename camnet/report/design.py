"""What the page of a certificate says of a design: figures in words, and what there is to buy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from camnet.report.html import table
from camnet.report.markup import shown

__all__ = ["design_section"]


def design_section(words: Sequence[str], cameras: Sequence[dict[str, Any]]) -> list[str]:
    """Return the section as HTML.

    Parameters
    ----------
    words : sentences
    cameras : what is added: name, ``camera`` (of the catalogue), x, y, z (m), pan and tilt (degrees), price
    """
    items = "".join(f"<li>{shown(sentence[:1].upper() + sentence[1:])}.</li>" for sentence in words)
    section = [f"<h2>Design</h2><ul>{items}</ul>"]
    if cameras:
        keys = ("change", "name", "camera", "x", "y", "z", "pan_deg", "tilt_deg", "price")
        head = (
            "change",
            "name",
            "camera",
            "x (m)",
            "y (m)",
            "height (m)",
            "pan (deg)",
            "tilt (deg)",
            "price",
        )
        section.append(table(head, [tuple(c[k] for k in keys) for c in cameras]))
    return section

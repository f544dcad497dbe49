"""Least pixels per metre of the classes of EN 62676-4:2015; apart from their use, so that a help text costs nothing."""

from __future__ import annotations

__all__ = ["PIXEL_CLASSES"]

#: least pixels per metre of each class, coarsest first
PIXEL_CLASSES = {"monitor": 12.5, "detect": 25.0, "observe": 62.5, "recognise": 125.0, "identify": 250.0}

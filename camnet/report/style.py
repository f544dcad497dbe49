"""Colours and figure defaults shared by every picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from camnet.storage.whole_file import whole_file

__all__ = [
    "CAMERA_COLOURS",
    "FILTER_COLOURS",
    "FILTER_LABELS",
    "UNSEEN",
    "figure_style",
    "plain_ticks",
    "save",
]

#: colour-blind safe, in the order of the cameras (repeated when there are more)
CAMERA_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a7500", "#6a3d9a")
FILTER_COLOURS = {
    "learned": "#c1121f",
    "learned_shared": "#e76f51",
    "adate": "#8e44ad",
    "ekf": "#3a5ba0",
    "ukf": "#7fa6d6",
    "ideal": "#2a9d5c",
    "oracle": "#222222",
    "printed": "#9a7d0a",
}
FILTER_LABELS = {
    "learned": "learned",
    "learned_shared": "learned, shared by all targets",
    "adate": "AdaTE, power-limited steering",
    "ekf": "EKF, constant velocity",
    "ukf": "UKF, constant velocity",
    "ideal": "ideal predictor",
    "oracle": "oracle (true future)",
    "printed": "learned, as printed (no gap remedies)",
}
#: shading of the time during which no camera sees the target
UNSEEN = "#e8e4da"


def plain_ticks(axes: Axes) -> None:
    """Write the powers of ten of a logarithmic y axis as numbers: names with dollar signs keep formulas off."""
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


@contextmanager
def figure_style() -> Iterator[None]:
    """Figure defaults within the block; the caller's own are kept."""
    settings = {
        "figure.facecolor": "white",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#dddddd",
        "grid.linewidth": 0.6,
        "font.size": 9,
        "legend.frameon": False,
        "savefig.dpi": 130,
        "text.parse_math": False,  # a dollar sign in a name is one
    }
    with mpl.rc_context(rc=cast(Any, settings)):
        yield


def save(figure: Figure, path: Path) -> None:
    """Write a figure (a temporary name first); no date inside, so that equal figures give equal files."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", bbox_inches="tight", metadata={"Software": None})

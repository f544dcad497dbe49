"""A window that shows pictures while a program runs."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from camnet.errors import ConfigError

__all__ = ["Window"]

#: Matplotlib's window toolkits, the one of Python's standard library first
_TOOLKITS = (
    *(("macosx",) if sys.platform == "darwin" else ()),
    "tkagg",
    "qtagg",
    "gtk4agg",
    "gtk3agg",
    "wxagg",
)
_REMEDY = (
    "run where a display is (or under xvfb-run) with a window toolkit installed (Debian: python3-tk; or "
    "pip install PyQt6), or take render_mode='rgb_array'"
)


class Window:
    """A window for pictures (H, W, 3), RGB, of one size; it opens with the first one.

    Whoever closes it on the screen sees no more pictures; the program goes on.

    Parameters
    ----------
    title : of the window
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._manager: Any = None
        self._shown: Any = None
        self._open = True

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show a picture.

        Raises
        ------
        ConfigError
            No window can be opened: there is no display, or no toolkit is installed.
        """
        if not self._open:
            return
        if self._manager is None:
            self._start(image)
        self._shown.set_data(image)
        canvas = self._manager.canvas
        canvas.draw()
        canvas.flush_events()

    def _start(self, image: NDArray[np.uint8]) -> None:
        height, width = image.shape[:2]
        figure = Figure(figsize=(width / 100, height / 100), dpi=100)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        self._shown = axes.imshow(image, interpolation="nearest")
        self._manager = _manager(figure)
        self._manager.set_window_title(self._title)
        self._manager.canvas.mpl_connect("close_event", self._closed)
        self._manager.show()

    def _closed(self, event: Any) -> None:  # noqa: ANN401 - Matplotlib's
        self._open = False

    def close(self) -> None:
        """Close the window."""
        if self._manager is not None and self._open:
            self._open = False
            self._manager.destroy()
        self._manager = self._shown = None


def _manager(figure: Figure) -> Any:  # noqa: ANN401 - the toolkit's
    """Return what holds a figure in a window of the first toolkit that is installed."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ConfigError(f"no window can be opened: there is no display (DISPLAY is not set); {_REMEDY}")
    missing = []
    for name in _TOOLKITS:
        try:
            canvas = importlib.import_module(f"matplotlib.backends.backend_{name}").FigureCanvas
        except ImportError:
            missing.append(name)
            continue
        try:
            with rc_context({"toolbar": "None"}):
                return canvas.new_manager(figure, 1)
        except Exception as error:  # whatever the toolkit raises
            raise ConfigError(f"no window can be opened: {name}: {error}; {_REMEDY}") from error
    raise ConfigError(f"no window can be opened: none of {', '.join(missing)} is installed; {_REMEDY}")

"""The environment's picture: the map, as an array or in a window."""

from __future__ import annotations

from typing import Any

from camnet.report.frame import Image, MapPainter
from camnet.report.window import Window
from camnet.simulation.loop import NetworkSimulation

__all__ = ["MapView"]


class MapView:
    """Paints the map of a running simulation; a copy has the same picture, and no window before it draws.

    Parameters
    ----------
    title : of the window
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._painter: MapPainter | None = None
        self._window: Window | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}

    def image(self, simulation: NetworkSimulation) -> Image:
        """Return the map as it is now, (H, W, 3), RGB."""
        if self._painter is None:
            self._painter = MapPainter(simulation.network)
        return self._painter.paint_simulation(simulation)

    def show(self, simulation: NetworkSimulation) -> None:
        """Draw the map in the window.

        Raises
        ------
        ConfigError
            No window can be opened.
        """
        if self._window is None:
            self._window = Window(self._title)
        self._window.show(self.image(simulation))

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
            self._window = None

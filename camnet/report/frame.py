"""One frame of the moving map: the background is drawn once, what moves is drawn on it with OpenCV."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from camnet.report.map_plot import draw_network, view_footprint
from camnet.report.style import CAMERA_COLOURS, FILTER_COLOURS, figure_style
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["FrameState", "Image", "MapPainter", "rgb"]

Image = NDArray[np.uint8]
_TAIL = 150


@dataclass(frozen=True, eq=False, slots=True)
class FrameState:
    """What moves.

    Attributes
    ----------
    camera_p_world, camera_q_world : (N,3), (N,4) poses of the agents' cameras
    tails : one (K,2) recent path per target, the present last
    estimates : (M,2) estimated positions (NaN: unknown)
    radii_m : (M,) error radii (inf: unknown)
    """

    camera_p_world: Array
    camera_q_world: Array
    tails: Sequence[Array]
    estimates: Array
    radii_m: Array


class MapPainter:
    """Paints frames of one network.

    Parameters
    ----------
    network : the network
    size_px : width and height of the square picture
    """

    def __init__(self, network: Network, size_px: int = 640) -> None:
        self.network = network
        with figure_style():
            figure = Figure(figsize=(size_px / 100, size_px / 100), dpi=100)
            canvas = FigureCanvasAgg(figure)
            axes = figure.add_axes((0.09, 0.075, 0.89, 0.905))
            draw_network(axes, network)
            axes.autoscale_view()
            canvas.draw()
        self._background: Image = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        #: (2, 3) from map points to pixels; both axes are linear
        self._to_display: Array = np.array(axes.transData.get_matrix()[:2])
        self._image = self._background
        self._tails: list[deque[Array]] = [deque(maxlen=_TAIL) for _ in range(network.n_targets)]
        self._last_t_s = -math.inf

    def paint(self, state: FrameState) -> Image:
        """Return one frame, (size, size, 3), RGB."""
        self._image = self._background.copy()
        for j, (p_world, q_world) in enumerate(zip(state.camera_p_world, state.camera_q_world, strict=True)):
            colour = CAMERA_COLOURS[j % len(CAMERA_COLOURS)]
            self._line(view_footprint(self.network, j, p_world, q_world), colour, closed=True)
            self._disc(p_world[:2], colour, 5)
        for tail, estimate, radius in zip(state.tails, state.estimates, state.radii_m, strict=True):
            self._line(tail, "black")
            self._disc(tail[-1], "black", 5)
            if np.isfinite(estimate).all():
                self._disc(estimate, FILTER_COLOURS["learned"], 7, width=2)
                self._ring(estimate, float(radius), FILTER_COLOURS["learned"])
        return self._image

    def paint_simulation(self, simulation: NetworkSimulation) -> Image:
        """Return a frame of a running simulation; tails grow from call to call and start again after a reset."""
        truth, n = simulation.snapshot, self.network.n_agents
        if truth.t_s < self._last_t_s:
            for tail in self._tails:
                tail.clear()
        self._last_t_s = truth.t_s
        for m, tail in enumerate(self._tails):
            tail.append(truth.target_p_world[m, :2].copy())
        estimates = [f.estimate for f in simulation.driving]
        state = FrameState(
            truth.camera_p_world[:n],
            truth.camera_q_world[:n],
            [np.array(tail) for tail in self._tails],
            np.array([e.p_world[:2] for e in estimates]),
            np.array([e.radius_m for e in estimates]),
        )
        return self.paint(state)

    def _pixels(self, points: Array) -> NDArray[np.int32]:
        """Pixel coordinates (K,2) of map points (K,2), in sixteenths of a pixel (OpenCV's sub-pixel drawing)."""
        display = np.atleast_2d(points) @ self._to_display[:, :2].T + self._to_display[:, 2]
        display[:, 1] = self._background.shape[0] - display[:, 1]
        return np.round(display * 16).astype(np.int32)

    def _line(self, points: Array, colour: str, closed: bool = False) -> None:
        if len(points) >= 2:
            vertices = self._pixels(points).reshape(-1, 1, 2)
            cv2.polylines(self._image, [vertices], closed, rgb(colour), 1, cv2.LINE_AA, shift=4)

    def _disc(self, point: Array, colour: str, radius_px: float, width: int = -1) -> None:
        x, y = self._pixels(point)[0]
        cv2.circle(
            self._image, (int(x), int(y)), round(16 * radius_px), rgb(colour), width, cv2.LINE_AA, shift=4
        )

    def _ring(self, point: Array, radius_m: float, colour: str) -> None:
        if math.isfinite(radius_m):
            edge = self._pixels(np.stack([point, point + np.array([radius_m, 0.0])]))
            self._disc(point, colour, float(edge[1, 0] - edge[0, 0]) / 16, width=1)


def rgb(colour: str) -> tuple[int, int, int]:
    """Colour name to 8-bit red, green, blue."""
    r, g, b = to_rgb(colour)
    return round(255 * r), round(255 * g), round(255 * b)

"""``video.mp4``: the moving map beside what the camera in charge sees, re-rendered from the log.

The map's background is drawn once; what moves is drawn on it with OpenCV. H.264 in ``yuv420p``, which browsers
play.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from camnet.report.map_plot import draw_network, view_footprint
from camnet.report.run_data import RunData
from camnet.report.style import CAMERA_COLOURS, FILTER_COLOURS, figure_style
from camnet.types import Array, Snapshot
from camnet.world.protocol import World
from camnet.world.pybullet import PyBulletWorld

__all__ = ["MapCanvas", "log_snapshot", "write_video"]

Image = NDArray[np.uint8]
_HEIGHT, _VIEW = 640, (640, 480)


class MapCanvas:
    """The map's background as pixels, and the way from metres to them."""

    def __init__(self, run: RunData) -> None:
        with figure_style():
            figure = Figure(figsize=(_HEIGHT / 100, _HEIGHT / 100), dpi=100)
            canvas = FigureCanvasAgg(figure)
            axes = figure.add_axes((0.07, 0.06, 0.91, 0.92))
            draw_network(axes, run.network)
            axes.autoscale_view()
            canvas.draw()
        self.background: Image = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        self._to_display = axes.transData.transform
        self.image = self.background.copy()

    def pixels(self, points: Array) -> NDArray[np.int32]:
        """Pixel coordinates (K,2) of map points (K,2), in sixteenths of a pixel for OpenCV's sub-pixel drawing."""
        display = self._to_display(np.atleast_2d(points))
        display[:, 1] = self.background.shape[0] - display[:, 1]
        return np.round(display * 16).astype(np.int32)

    def clear(self) -> None:
        """Start a frame."""
        self.image = self.background.copy()

    def line(self, points: Array, colour: str, width: int = 1, closed: bool = False) -> None:
        """Draw a polyline of map points (K,2)."""
        if len(points) >= 2:
            pts = self.pixels(points).reshape(-1, 1, 2)
            cv2.polylines(self.image, [pts], closed, _rgb(colour), width, cv2.LINE_AA, shift=4)

    def disc(self, point: Array, colour: str, radius_px: float, width: int = -1) -> None:
        """Draw a disc (or a circle of line ``width``) at a map point (2,)."""
        x, y = self.pixels(point)[0]
        cv2.circle(
            self.image, (int(x), int(y)), round(16 * radius_px), _rgb(colour), width, cv2.LINE_AA, shift=4
        )

    def ring(self, point: Array, radius_m: float, colour: str) -> None:
        """Draw a circle of ``radius_m`` about a map point (2,)."""
        edge = self.pixels(np.stack([point, point + [radius_m, 0.0]]))
        self.disc(point, colour, float(edge[1, 0] - edge[0, 0]) / 16, width=1)


def _rgb(colour: str) -> tuple[int, int, int]:
    r, g, b = to_rgb(colour)
    return round(255 * r), round(255 * g), round(255 * b)


def write_video(
    run: RunData,
    path: Path,
    length_s: float = 24.0,
    fps: int = 12,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the video of a run, sped up to about ``length_s`` seconds.

    Raises
    ------
    OSError
        The encoder could not be started or failed.
    """
    rows = np.unique(
        np.linspace(0, len(run.t_s) - 1, max(2, min(len(run.t_s), round(length_s * fps)))).astype(int)
    )
    world = PyBulletWorld(run.network.description)
    world.reset(np.random.default_rng(0))
    temporary = path.with_name(f".{path.stem}.partial.mp4")
    try:
        frames = _frames(run, world, rows)
        first = next(frames)
        size = (first.shape[1], first.shape[0])
        writer = imageio_ffmpeg.write_frames(
            str(temporary),
            size,
            fps=fps,
            codec="libx264",
            quality=7,
            macro_block_size=2,
            ffmpeg_log_level="error",
        )
        writer.send(None)
        writer.send(np.ascontiguousarray(first))
        for k, frame in enumerate(frames, start=2):
            writer.send(np.ascontiguousarray(frame))
            if progress is not None:
                progress(k, len(rows))
        writer.close()
        temporary.replace(path)
    finally:
        world.close()
        temporary.unlink(missing_ok=True)


def _frames(run: RunData, world: World, rows: Array) -> Iterator[Image]:
    canvas, camera = MapCanvas(run), 0
    for row in rows:
        camera = _camera_in_charge(run, int(row), camera)
        world.set_state(log_snapshot(run, int(row)))
        view = world.render(camera, *_VIEW)
        _draw_map(canvas, run, int(row))
        yield _compose(canvas.image, view, run, int(row), camera)


def _camera_in_charge(run: RunData, row: int, before: int) -> int:
    """Return the camera that sees the first target, else the one that waits for it, else the one before."""
    seen_by = int(run.columns[f"{run.targets[0]}.seen_by"][row])
    if seen_by >= 0:
        return seen_by
    roles = [int(run.columns[f"{agent}.role"][row]) for agent in run.agents]
    busy = [j for j, role in enumerate(roles) if role > 0]
    return before if before in busy or not busy else max(busy, key=lambda j: roles[j])


def log_snapshot(run: RunData, row: int) -> Snapshot:
    """Poses of one row of the log as a snapshot; velocities are not needed for pictures and are zero."""
    agents, targets = run.agents, run.targets

    def stack(names: tuple[str, ...], what: str, size: int) -> Array:
        get = run.quaternion if size == 4 else run.vector
        return np.array([get(name, what)[row] for name in names]).reshape(-1, size)

    n, m = len(agents), len(targets)
    fixed = run.network.description.cameras
    camera_p = np.concatenate(
        [stack(agents, "cam_p", 3), np.array([c.p_world for c in fixed]).reshape(-1, 3)]
    )
    camera_q = np.concatenate(
        [stack(agents, "cam_q", 4), np.array([c.q_world for c in fixed]).reshape(-1, 4)]
    )
    return Snapshot(
        t_s=float(run.t_s[row]),
        step=row,
        agent_p_world=stack(agents, "p", 3),
        agent_q_world=stack(agents, "q", 4),
        agent_v_world=np.zeros((n, 3)),
        agent_w_body=np.zeros((n, 3)),
        camera_p_world=camera_p,
        camera_q_world=camera_q,
        camera_v_world=np.zeros_like(camera_p),
        camera_w_cam=np.zeros_like(camera_p),
        target_p_world=stack(targets, "p", 3),
        target_q_world=stack(targets, "q", 4),
        target_v_world=np.zeros((m, 3)),
        target_w_body=np.zeros((m, 3)),
    )


def _draw_map(canvas: MapCanvas, run: RunData, row: int) -> None:
    canvas.clear()
    cameras = [
        (j, run.vector(a, "cam_p")[row], run.quaternion(a, "cam_q")[row]) for j, a in enumerate(run.agents)
    ]
    for j, p_world, q_world in cameras:
        colour = CAMERA_COLOURS[j % len(CAMERA_COLOURS)]
        canvas.line(view_footprint(run.network, j, p_world, q_world), colour, 1, closed=True)
        canvas.disc(p_world[:2], colour, 5)
    tail = slice(max(0, row - 150), row + 1)
    for target in run.targets:
        truth, estimate = run.vector(target)[tail, :2], run.vector(f"{target}.{run.filters[0]}")[tail, :2]
        canvas.line(truth, "black", 1)
        canvas.disc(truth[-1], "black", 5)
        if np.isfinite(estimate[-1]).all():
            canvas.disc(estimate[-1], FILTER_COLOURS["learned"], 7, width=2)
            radius = float(run.columns[f"{target}.{run.filters[0]}.radius_m"][row])
            if math.isfinite(radius):
                canvas.ring(estimate[-1], radius, FILTER_COLOURS["learned"])


def _compose(map_image: Image, view: Image, run: RunData, row: int, camera: int) -> Image:
    height, width = map_image.shape[0], map_image.shape[1] + _VIEW[0]
    frame = np.full((height, width, 3), 255, dtype=np.uint8)
    frame[:, : map_image.shape[1]] = map_image
    top = (height - _VIEW[1]) // 2
    frame[top : top + _VIEW[1], map_image.shape[1] :] = view
    names = [*run.agents, *(c.name for c in run.network.description.cameras)]
    seen = run.columns[f"{run.targets[0]}.seen_by"][row] >= 0
    status = "target in view" if seen else "target unseen: predicting"
    colour = _rgb("#2a9d5c") if seen else _rgb("#c1121f")
    left = map_image.shape[1] + 8
    _text(frame, f"t = {run.t_s[row]:.1f} s   view of {names[camera]}", (left, top - 30), (30, 30, 30))
    _text(frame, status, (left, top - 10), colour)
    return frame


def _text(frame: Image, words: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(frame, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)

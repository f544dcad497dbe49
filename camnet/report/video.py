"""``video.mp4``: the moving map beside what the camera in charge sees, re-rendered from the log (H.264)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from camnet.report.encode import video_file
from camnet.report.frame import FrameState, Image, MapPainter, rgb
from camnet.report.run_data import RunData
from camnet.types import Array, IntArray, Snapshot
from camnet.world.protocol import World
from camnet.world.pybullet import PyBulletWorld

__all__ = ["log_snapshot", "write_video"]

_VIEW = (640, 480)
_TAIL = 150


def write_video(
    run: RunData,
    path: Path,
    length_s: float = 18.0,
    fps: int = 12,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the video of a run, sped up to about ``length_s`` seconds.

    Raises
    ------
    OSError
        The encoder could not be started or failed.
    """
    count = max(2, min(len(run.t_s), round(length_s * fps)))
    rows = np.unique(np.linspace(0, len(run.t_s) - 1, count).astype(int))
    world = PyBulletWorld(run.network.description)
    world.reset(np.random.default_rng(0))
    try:
        with video_file(path, fps, quality=7) as add:
            for k, frame in enumerate(_frames(run, world, rows), start=1):
                add(frame)
                if progress is not None:
                    progress(k, len(rows))
    finally:
        world.close()


def _frames(run: RunData, world: World, rows: IntArray) -> Iterator[Image]:
    painter, camera = MapPainter(run.network), 0
    for row in rows.tolist():
        camera = _camera_in_charge(run, row, camera)
        snapshot = log_snapshot(run, row)
        world.set_state(snapshot)
        view = world.render(camera, *_VIEW)
        yield _compose(painter.paint(_frame_state(run, snapshot, row)), view, run, row, camera)


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


def _frame_state(run: RunData, snapshot: Snapshot, row: int) -> FrameState:
    n, tail = len(run.agents), slice(max(0, row - _TAIL), row + 1)
    driving = [f"{target}.{run.filters[0]}" for target in run.targets]
    return FrameState(
        snapshot.camera_p_world[:n],
        snapshot.camera_q_world[:n],
        [run.vector(target)[tail, :2] for target in run.targets],
        np.array([run.vector(who)[row, :2] for who in driving]),
        np.array([run.columns[f"{who}.radius_m"][row] for who in driving]),
    )


def _compose(map_image: Image, view: Image, run: RunData, row: int, camera: int) -> Image:
    height, left = map_image.shape[:2]
    frame = np.full((height, left + _VIEW[0], 3), 255, dtype=np.uint8)
    frame[:, :left] = map_image
    top = (height - _VIEW[1]) // 2
    frame[top : top + _VIEW[1], left:] = view
    names = [*run.agents, *(c.name for c in run.network.description.cameras)]
    seen = bool(run.columns[f"{run.targets[0]}.seen_by"][row] >= 0)
    status, colour = ("target in view", "#1d7a45") if seen else ("target unseen: predicting", "#c1121f")
    _text(frame, f"t = {run.t_s[row]:.1f} s   view of {names[camera]}", (left + 8, top - 30), (30, 30, 30))
    _text(frame, status, (left + 8, top - 10), rgb(colour))
    return frame


def _text(frame: Image, words: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(frame, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)

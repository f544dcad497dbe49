"""Write every picture and page of a run into its folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from camnet.report.estimates_plot import write_estimates
from camnet.report.html import write_report
from camnet.report.instruments_plot import has_instruments, write_instruments
from camnet.report.map_plot import write_map
from camnet.report.run_data import load_run
from camnet.report.video import write_video

__all__ = ["write_all"]


def write_all(folder: Path, video: bool = True, progress: Callable[[int, int], None] | None = None) -> None:
    """Write ``map.png``, ``estimates.png``, ``report.html``, ``video.mp4`` (unless ``video`` is false), instruments."""
    run = load_run(folder)
    if len(run.t_s) >= 2:  # a run stopped at once has nothing to draw
        write_map(run, folder / "map.png")
        write_estimates(run, folder / "estimates.png")
        if has_instruments(run):
            write_instruments(run, folder / "instruments.png")
        if video:
            write_video(run, folder / "video.mp4", progress=progress)
    write_report(run, folder / "report.html")

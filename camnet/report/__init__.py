"""Maps, plots, video and the HTML report of a run."""

__all__ = ["REPORT_FILES"]

#: what `camnet.report.write` may write; here, as loading that loads Matplotlib
REPORT_FILES = ("estimates.png", "instruments.png", "map.png", "report.html", "video.mp4")

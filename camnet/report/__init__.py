"""Maps, plots, video and the HTML report of a run."""

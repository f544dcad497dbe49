"""Tracking a target without a marker: a box followed from image to image by correlation filters.

Read `tracker` first (the loop of one image), then `translation_filter` and `scale_filter` (what is learnt), `hog` (what
is correlated), `patch` (how a patch of the image is cut) and `fourier` (labels and peaks between the samples).
"""

from camnet.sensing.visual.box import Box, overlap
from camnet.sensing.visual.settings import CorrelationSettings
from camnet.sensing.visual.tracker import CorrelationTracker, TrackResult

__all__ = ["Box", "CorrelationSettings", "CorrelationTracker", "TrackResult", "overlap"]

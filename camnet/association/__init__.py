"""Whose sighting is it: association across gaps between views that do not overlap, when targets carry no name.

An exit leaves a gap open, an entry closes one; which one is the question. Everybody's crossings teach how likely each
answer is (``crossing_density``, a kernel estimate of the hazard of coming back), other people's answers teach how
far to trust that (``choice``), a window of later evidence revises it (``window``, ``marginals``, ``companions``).

Read next: ``tracklets`` (the data), ``crossing_density``, ``window``; then the measures: ``identity_scores`` (IDF1,
HOTA, switches) and ``calibration``. ``appearance`` simulates descriptors of a stated quality.
"""

from camnet.association.settings import DensitySettings, IdentitySettings
from camnet.association.tracklets import Tracklets, tracklets_of

__all__ = ["DensitySettings", "IdentitySettings", "Tracklets", "tracklets_of"]

"""The oracle: the truth and the true future, acted upon as well as the rules here can; what a score table is held to.

Targets are shared out by auction; who wins none minds whatever comes its way. Cameras stay as high as if positions were
known to ``CAUTION_M`` only: as low as a point needs, a camera has no room for the next target beside the present one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from camnet.agents.auction import Auction, Observation
from camnet.agents.policy import Action

__all__ = ["CAUTION_M", "Oracle"]

#: error radius to which positions are taken to be known, m
CAUTION_M = 0.6


class Oracle(Auction):
    """A team of agents that are shown the truth (estimator ``oracle``)."""

    def __call__(self, observations: Mapping[str, Observation]) -> dict[str, Action]:
        """Return an action for every observation."""
        careful = {name: self._careful(name, self._flat(name, seen)) for name, seen in observations.items()}
        return {
            name: self._rules[name](careful[name] if target < 0 else self._only(name, careful[name], target))
            for name, target in self._shared_out(careful).items()
        }

    def _careful(self, name: str, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Observation in which nothing is known better than to ``CAUTION_M``."""
        context = self._contexts[name]
        least, shown = np.float32(CAUTION_M / context.width_m), observation.copy()
        for m in range(context.layout.n_targets):
            for field in ("radius", "entry_radius"):
                part = context.layout.slices[f"target_{m}.{field}"]
                shown[part] = np.maximum(shown[part], least)
        return shown

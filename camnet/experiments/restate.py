"""A world restated for a certificate: speeds and extent of its targets, and how far its cameras see."""

from __future__ import annotations

import math
from typing import Any

from camnet.certification.settings import DetectionSettings
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.geometry.pixel_density import with_class_range
from camnet.motion.settings import RoadTarget, TargetSettings

__all__ = ["restate_class", "restate_detection", "restate_pixels"]

#: points that stand for an extent: a ring on the ground
_RING = 8


def restate_class(
    scenario: Scenario,
    *,
    v_lo_mps: float | None = None,
    v_max_mps: float | None = None,
    extent_m: float | None = None,
) -> Scenario:
    """Return the world with every target's class restated; None leaves a bound as it is.

    Parameters
    ----------
    v_lo_mps : least speed of targets on roads, m/s
    v_max_mps : highest speed, m/s: of the class on roads, of the bound for others
    extent_m : radius of a ring on the ground that must be in view in place of the targets' feature points, m

    Raises
    ------
    ConfigError
        A bound does not apply to one of the targets, or contradicts its motion.
    """
    targets = tuple(_restated(t, v_lo_mps, v_max_mps, extent_m) for t in scenario.targets)
    return scenario.model_copy(update={"targets": targets})


def restate_pixels(scenario: Scenario, pixel_class: str) -> Scenario:
    """Return the world with cameras that see no further than they have the pixels of a class (EN 62676-4:2015).

    Raises
    ------
    ConfigError
        There is no such class, or a camera has its pixels nowhere in its range.
    """
    cameras = tuple(with_class_range(camera, pixel_class) for camera in scenario.cameras)
    return scenario.model_copy(update={"cameras": cameras})


def restate_detection(scenario: Scenario, detection: DetectionSettings) -> Scenario:
    """Return the world in which targets count as seen where they are detected so."""
    certificate = scenario.certificate.model_copy(update={"detection": detection})
    return scenario.model_copy(update={"certificate": certificate})


def _restated(
    target: TargetSettings, v_lo: float | None, v_max: float | None, extent: float | None
) -> TargetSettings:
    change: dict[str, Any] = {}
    if isinstance(target.motion, RoadTarget):
        slow, fast = target.motion.speed_mps
        slow, fast = slow if v_lo is None else v_lo, fast if v_max is None else v_max
        if slow > fast:
            raise ConfigError(
                f"--v-lo {slow:g}, --v-max {fast:g}: target {target.name!r} needs a least speed that is not above the "
                f"highest (its file says {list(target.motion.speed_mps)} m/s)"
            )
        change["motion"] = target.motion.model_copy(update={"speed_mps": (slow, fast)})
        change["v_max_mps"] = max(fast, target.v_max_mps) if v_max is None else v_max
    else:
        if v_lo is not None:
            raise ConfigError(
                f"--v-lo {v_lo:g}: target {target.name!r} is of kind {target.motion.kind!r}, whose speed is that of "
                "its motion; a least speed is for targets of kind 'road'"
            )
        if v_max is not None:
            change["v_max_mps"] = v_max
    if extent is not None:
        angles = [2.0 * math.pi * k / _RING for k in range(_RING)]
        change["features_m"] = tuple((extent * math.cos(a), extent * math.sin(a), 0.0) for a in angles)
    return target.model_copy(update=change)

"""The six groups of the trajectory estimation experiment of li2019, section V.A: three tracks, with and without drift.

| group | steps | observers | noise covariance | drift of one observer |
| --- | --- | --- | --- | --- |
| cruise | 500 x 1 s | 4 | diag(256, 259, 64) m^2 | 8 sqrt(i - 300) m in x and y, steps 300-450 |
| swaying | 500 x 1 s | 4 | diag(256, 256, 64) m^2 | 8 sqrt(i - 200) m, steps 200-450 |
| snake | 600 x 1 s | 4 | diag(64, 69, 63) m^2 | 4 sqrt(i - 450) m, steps 450-600 |

On snake no observer sees steps 250-300. Every filter is handed biased covariances: the true ones times one random
factor in [0.4, 1.4] for each observer and axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.types import Array, BoolArray

__all__ = ["GROUPS", "Group", "draw", "track"]

GROUPS = ("cruise", "cruise_drift", "swaying", "swaying_drift", "snake", "snake_drift")
OBSERVERS = 4
_NOISE = {"cruise": (256.0, 259.0, 64.0), "swaying": (256.0, 256.0, 64.0), "snake": (64.0, 69.0, 63.0)}
_DRIFT = {"cruise": (300, 450, 8.0), "swaying": (200, 450, 8.0), "snake": (450, 600, 4.0)}


@dataclass(frozen=True, eq=False)
class Group:
    """One draw of one group.

    Attributes
    ----------
    name : as in `GROUPS`
    truth : (n,3) position, m
    observations : (n,4,3), m
    seen : (n,) whether the step is observed
    covariance : (4,3,3) as told to the filters, m^2
    true_covariance : (3,3), m^2
    drifting : (n,4) whether an observation drifts
    """

    name: str
    truth: Array
    observations: Array
    seen: BoolArray
    covariance: Array
    true_covariance: Array
    drifting: BoolArray

    def rmse(self, pooled: bool) -> float:
        """Root mean square error of the observations: of the first (drifting) observer alone, or of all four."""
        error = (self.observations - self.truth[:, None, :])[self.seen]
        chosen = error if pooled else error[:, :1]
        return float(np.sqrt(np.mean(np.sum(chosen**2, axis=-1))))


def _cruise() -> Array:
    """Straight, 3/4 circle, accelerating straight, 3/4 ellipse, decelerating straight; (500,3)."""
    out = [np.stack([np.zeros(50), -np.arange(50.0)], axis=1)]
    a = np.arange(1, 151.0) / 32.0
    out.append(out[-1][-1] + 32.0 * np.stack([np.cos(a) - 1.0, -np.sin(a)], axis=1))
    i = np.arange(1, 101.0)
    out.append(out[-1][-1] + np.stack([i + 0.005 * i**2, np.zeros(100)], axis=1))
    out.append(out[-1][-1] + np.stack([64.0 * np.sin(a), 50.0 * (1.0 - np.cos(a))], axis=1))
    i = np.arange(1, 51.0)
    out.append(out[-1][-1] - np.stack([np.zeros(50), 50.0 / 32.0 * i - 0.005 * i**2], axis=1))
    plane = np.concatenate(out)
    return np.column_stack([plane, np.zeros(len(plane))])


def _swaying() -> Array:
    """Swaying about the x axis with growing width; (500,3)."""
    i = np.arange(1, 501.0)
    return np.stack([i + i**2 / (8.0 * 500.0), 0.1 * i * np.sin(i / 20.0), np.zeros(500)], axis=1)


def _arc(start: Array, heading: float, radius: Array, rate: float) -> Array:
    """Arc (m,2) that leaves ``start`` along ``heading`` turning at ``rate`` rad/step (positive: left)."""
    angle = rate * np.arange(1, len(radius) + 1.0)
    side = np.sign(rate)
    outward = np.array([np.sin(heading), -np.cos(heading)]) * side  # from the centre to the start
    centre = start - radius[0] * outward
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.stack([cos * outward[0] - sin * outward[1], sin * outward[0] + cos * outward[1]], axis=1)
    return np.asarray(centre + radius[:, None] * turned, dtype=float)


def _snake() -> Array:
    """Drifting loop, growing half circle that dives, c-turn, two widening loops; (600,3)."""
    i = np.arange(1, 201.0)
    phase = i / 31.83 - np.pi / 4.0
    out = [np.stack([0.2 * i + 40.0 * np.sin(phase), 0.2 * i + 40.0 * np.cos(phase)], axis=1)]
    k = np.arange(1, 101.0)
    out.append(_arc(out[-1][-1], np.pi / 4.0, 40.0 + 0.2 * k, 1.0 / 31.83))
    out.append(_arc(out[-1][-1], 1.25 * np.pi, np.full(100, 50.0), -1.0 / 31.83))
    out.append(_arc(out[-1][-1], 0.25 * np.pi, 20.0 + 0.1 * np.arange(1, 201.0), 2.0 * np.pi / 100.0))
    plane = np.concatenate(out)
    z = np.zeros(600)
    z[200:300] = 10.0 * np.cos(k / 31.83) - 10.0
    z[300:] = z[299]
    return np.column_stack([plane, z])


_TRACKS = {"cruise": _cruise, "swaying": _swaying, "snake": _snake}


def track(name: str) -> Array:
    """Positions (n,3) of ``cruise``, ``swaying`` or ``snake``, m, one a second."""
    return _TRACKS[name]()


def draw(name: str, rng: np.random.Generator, steps: int | None = None) -> Group:
    """Draw one group; ``steps`` cuts it short.

    Parameters
    ----------
    name : one of `GROUPS`
    rng : generator of the noise and of the bias of the covariances
    """
    base = name.removesuffix("_drift")
    truth = track(base)
    n = len(truth)
    true_covariance = np.diag(_NOISE[base])
    noise = rng.normal(size=(n, OBSERVERS, 3)) * np.sqrt(_NOISE[base])
    factor = rng.uniform(0.4, 1.4, size=(OBSERVERS, 3))
    drifting = np.zeros((n, OBSERVERS), dtype=bool)
    if name.endswith("_drift"):
        start, stop, gain = _DRIFT[base]
        since = np.arange(stop - start, dtype=float)
        noise[start:stop, 0, :2] += gain * np.sqrt(since)[:, None]
        drifting[start:stop, 0] = True
    seen = np.ones(n, dtype=bool)
    if base == "snake":
        seen[249:300] = False
    covariance = np.zeros((OBSERVERS, 3, 3))
    covariance[:, range(3), range(3)] = np.asarray(_NOISE[base]) * factor
    cut = slice(0, steps)
    return Group(
        name,
        truth[cut],
        truth[cut, None, :] + noise[cut],
        seen[cut],
        covariance,
        true_covariance,
        drifting[cut],
    )

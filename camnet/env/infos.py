"""What an environment tells beside observations and rewards, in two forms.

| form | what |
| --- | --- |
| `nested` | dictionaries as they are written to JSON: unknown figures are None |
| `flat` | one level of floats under dotted names, the same names at every step; unknown figures are NaN |

The figures of a whole episode have the key `EPISODE`; ``episode`` is left to wrappers of other libraries, which record
return and length under it (`gymnasium.wrappers.RecordEpisodeStatistics`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from typing import Any

from camnet.simulation.loop import NetworkSimulation

__all__ = ["EPISODE", "EpisodeInfos", "finished_info", "flat_info"]

#: key of an episode's figures
EPISODE = "handoff_episode"


def flat_info(info: Mapping[str, Any]) -> dict[str, float]:
    """Return numbers of nested dictionaries and lists under dotted names, as floats; None is NaN."""
    flat: dict[str, float] = {}
    for name, value in info.items():
        if isinstance(value, Mapping):
            flat.update({f"{name}.{key}": number for key, number in flat_info(value).items()})
        elif isinstance(value, Sequence) and not isinstance(value, str):
            flat.update(flat_info({f"{name}.{k}": one for k, one in enumerate(value)}))
        else:
            flat[name] = math.nan if value is None else float(value)
    return flat


def finished_info(figures: Mapping[str, Any], flat: bool) -> dict[str, Any]:
    """Return the figures of an episode that has ended under their key, in one of the two forms."""
    info = {EPISODE: figures}
    return {**flat_info(info)} if flat else info


class EpisodeInfos:
    """Infos of the agents of one environment.

    Parameters
    ----------
    flat : which of the two forms
    simulation : at the start of an episode; names of the figures are taken from it
    """

    def __init__(self, flat: bool, simulation: NetworkSimulation) -> None:
        self._flat = flat
        figures = {EPISODE: simulation.statistics.episode(simulation)}
        self._unknown = dict.fromkeys(flat_info(figures), math.nan) if flat else {}

    def __call__(
        self, simulation: NetworkSimulation, names: Sequence[str], last: bool, failed: Set[str]
    ) -> dict[str, dict[str, Any]]:
        """Return the infos of ``names``: certificates, who has failed; figures where the step is the ``last`` one."""
        common: dict[str, Any] = {"certificate": simulation.statistics.certificate(simulation.snapshot.t_s)}
        if last:
            common[EPISODE] = simulation.statistics.episode(simulation)
        if self._flat:
            common = {**self._unknown, **flat_info(common), "failed": 0.0}
        infos = {name: dict(common) for name in names}
        for name in failed:
            infos[name]["failed"] = 1.0 if self._flat else True
        return infos

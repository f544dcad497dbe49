"""Estimators by the names of ``run.estimators``: ours, and those of other packages, ``module:attribute``."""

from __future__ import annotations

from collections.abc import Sequence

from camnet.errors import ConfigError
from camnet.estimation.protocol import TargetFilter
from camnet.plugins import is_plugin, load_plugin
from camnet.simulation.filters import TargetTruth, build_filters
from camnet.simulation.network import Network

__all__ = ["named_filters"]

_PARTS = ("name", "estimate", "correct", "predict", "rollout", "diagnostics")


def named_filters(name: str, network: Network, truths: Sequence[TargetTruth]) -> list[TargetFilter]:
    """Return one estimator for each target, in the targets' order (`camnet.simulation.filters.build_filters`)."""
    if is_plugin(name):
        return _plugin_filters(name, network)
    scenario = network.scenario
    return build_filters(
        name,
        scenario.estimator,
        network.basis,
        len(network.regions),
        scenario.sensing.rate_hz,
        network.bounds,
        truths,
        scenario.roads,
    )


def _plugin_filters(name: str, network: Network) -> list[TargetFilter]:
    """Return one estimator for each target; what ``name`` stands for is called with the network and the target's index.

    It is told no truth.

    Raises
    ------
    ConfigError
        There is no such part, or what it makes is no estimator (`camnet.estimation.protocol.TargetFilter`).
    """
    make = load_plugin(name, "run.estimators", "a function of (network, target) that returns an estimator")
    filters = []
    for m in range(network.n_targets):
        made = make(network, m)
        if not isinstance(made, TargetFilter):
            missing = [part for part in _PARTS if not hasattr(made, part)]
            raise ConfigError(
                f"run.estimators: {name!r} made {type(made).__name__}, which has no {', '.join(missing)}; an estimator "
                "was expected (camnet.estimation.protocol)"
            )
        filters.append(made)
    return filters

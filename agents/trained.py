"""A trained policy file as a team: one network for all agents, each shown its own features."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from camnet.agents.features import FEATURES, FeatureMap
from camnet.agents.learned import Learned
from camnet.agents.policy import Action, AgentContext
from camnet.agents.policy_file import PolicyNet
from camnet.errors import DataError

__all__ = ["Trained", "check_net"]

_ACTION_SIZE = 5


def check_net(net: PolicyNet) -> None:
    """Refuse a policy that was made for other features or actions than this version's (DataError)."""
    if net.header.features != FEATURES:
        raise DataError(
            f"policy: it takes {len(net.header.features)} features, this version has {len(FEATURES)}; train it anew"
        )
    if net.biases[-1].shape != (_ACTION_SIZE,):
        raise DataError(f"policy: its output has {net.biases[-1].size} numbers, an action has {_ACTION_SIZE}")


class Trained:
    """Acts as a policy file says.

    Parameters
    ----------
    known : fixed facts of every agent
    net : the policy

    Raises
    ------
    DataError
        The policy was made for other features or actions than this version's.
    """

    def __init__(self, known: Mapping[str, AgentContext], net: PolicyNet) -> None:
        check_net(net)
        self._net = net
        self._half_sizes = {name: context.half_size for name, context in known.items()}
        layout = next(iter(known.values())).layout
        self._features = FeatureMap(layout)
        base = net.header.residual_of
        self._base = {name: Learned(context) for name, context in known.items()} if base else None

    def __call__(self, observations: Mapping[str, NDArray[np.float32]]) -> dict[str, Action]:
        """Return an action for every observation."""
        names = list(observations)
        if not names:
            return {}
        shown = np.array([observations[name] for name in names])
        out = self._net(self._features(shown, np.array([self._half_sizes[name] for name in names])))
        if self._base is not None:
            rule = np.array([self._base[name](observations[name]) for name in names])
            out = np.clip(rule + self._net.header.residual_scale * out, -1.0, 1.0)
        return {name: out[i].astype(np.float32) for i, name in enumerate(names)}

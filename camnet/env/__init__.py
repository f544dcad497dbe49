"""The PettingZoo environment of the handoff problem and its metrics.

Importing this package registers the environments of `camnet.env.presets` with PettingZoo and Gymnasium.
Read next: `camnet.env.handoff_v0` (the environment), `camnet.env.layout` (observations field by field),
`camnet.env.actions` (the three action modes), `camnet.env.settings` (options, rewards and their bound).
"""

from camnet.env.presets import PRESETS, register_all

__all__ = ["PRESETS"]

register_all()

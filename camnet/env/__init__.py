"""The PettingZoo environment of the handoff problem and its metrics.

Importing this package registers ``camnet/Handoff-Quickstart-v0`` with PettingZoo, in both forms.
Read next: `camnet.env.handoff_v0` (the environment), `camnet.env.layout` (observations field by field),
`camnet.env.settings` (rewards and their bound).
"""

from pettingzoo import register

__all__ = ["PRESETS"]

#: registered id -> options of the environment
PRESETS = {"camnet/Handoff-Quickstart-v0": {"world": "quickstart"}}

for _id, _options in PRESETS.items():
    register("parallel", _id, "camnet.env.handoff_v0:parallel_env", kwargs=dict(_options))
    register("aec", _id, "camnet.env.handoff_v0:env", kwargs=dict(_options))

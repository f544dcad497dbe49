"""Registered environments: an id and the options it stands for.

| id | what |
| --- | --- |
| `camnet/Handoff-Quickstart-v0` | one robot, four regions on a loop |
| `camnet/Handoff-Loop-8-v0` | two robots, eight regions on a loop |
| `camnet/Handoff-Grid-16-v0` | four robots that turn at random, sixteen regions over the junctions of a street grid |
| `camnet/Handoff-Pursuit-v0` | three fast robots that overtake each other, six regions |
| `camnet/Handoff-Failures-v0` | the loop of eight with agents that fail, and messages that come late or get lost |
| `camnet/Handoff-Crowd-8-v1` | eight robots on a loop, narrow views: whom to look at |
| `camnet/Handoff-Crowd-8-Loss-v1` | the same, with half of all messages lost, the rest late, and a short range |
| `camnet/Handoff-City-6-v1` | six robots that turn at random on eight by eight streets: where to search |
| `camnet/Handoff-Lost-3-v1` | three robots faster than the cameras: where to wait |

The ids that end in v1 count every entry into a region as a handoff, by the truth (``score="v1"``,
`camnet.env.settings.EnvSettings`); those that end in v0 count targets that were seen before. How much of a
task is solved by replaying what was done in another episode is measured by `camnet.env.conformance_replay`.

All of them are registered with PettingZoo in both forms; ``pettingzoo.make("parallel", id, ...)`` takes the options of
`camnet.env.handoff_v0.HandoffEnv` on top. The ids are worlds to `camnet.env.batch_handoff.BatchHandoff` and to
``camnet evaluate``, too. `camnet/Handoff-Single-v0` is registered with Gymnasium
(`camnet.env.single`).
"""

from __future__ import annotations

import difflib
from typing import Any

import gymnasium
from pettingzoo import register

from camnet.errors import ConfigError

__all__ = ["PRESETS", "SINGLE", "preset_options", "register_all"]

#: registered id -> options of the environment
PRESETS: dict[str, dict[str, Any]] = {
    "camnet/Handoff-Quickstart-v0": {"world": "quickstart"},
    "camnet/Handoff-Loop-8-v0": {"world": "loop_8"},
    "camnet/Handoff-Grid-16-v0": {"world": "grid_16"},
    "camnet/Handoff-Pursuit-v0": {"world": "pursuit"},
    "camnet/Handoff-Failures-v0": {
        "world": "loop_8",
        "message_delay_s": 0.2,
        "message_loss": 0.2,
        "communication_range_m": 15.0,
        "failures": {"rate_per_s": 0.002},
    },
    "camnet/Handoff-Crowd-8-v1": {"world": "crowd_8", "score": "v1"},
    "camnet/Handoff-Crowd-8-Loss-v1": {
        "world": "crowd_8",
        "score": "v1",
        "message_delay_s": 0.5,
        "message_loss": 0.5,
        "communication_range_m": 9.0,
    },
    "camnet/Handoff-City-6-v1": {"world": "city_6", "score": "v1"},
    "camnet/Handoff-Lost-3-v1": {"world": "lost_3", "score": "v1"},
}
#: id of the single-agent form, with Gymnasium
SINGLE = "camnet/Handoff-Single-v0"


def preset_options(world: Any, options: dict[str, Any]) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401 - name or scenario
    """World and options of an environment, where ``world`` may be a registered id: ``options`` go before its own.

    Raises
    ------
    ConfigError
        ``world`` looks like an id and is none.
    """
    if isinstance(world, str) and world.startswith("camnet/Handoff-") and world not in PRESETS:
        close = difflib.get_close_matches(world, PRESETS, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"ids: {', '.join(PRESETS)}"
        raise ConfigError(
            f"world: value {world!r}: no such registered id of an environment of many agents: {hint}"
        )
    if isinstance(world, str) and world in PRESETS:
        options = {**PRESETS[world], **options}
        world = options.pop("world")
    return world, options


def register_all() -> None:
    """Register every preset with PettingZoo, and the single-agent form with Gymnasium."""
    for name, options in PRESETS.items():
        register("parallel", name, "camnet.env.handoff_v0:parallel_env", kwargs=dict(options))
        register("aec", name, "camnet.env.handoff_v0:env", kwargs=dict(options))
    if SINGLE not in gymnasium.registry:
        gymnasium.register(SINGLE, entry_point="camnet.env.single:SingleAgentEnv")

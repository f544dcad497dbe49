"""What an action is, in many environments at once: the modes of `camnet.env.actions` as setpoints in the world."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from camnet.control.setpoint_rows import SetpointRows
from camnet.env.checks import checked_box, checked_numbers
from camnet.env.encode import BeliefRows
from camnet.env.settings import EnvSettings
from camnet.errors import ConfigError
from camnet.geometry.rotations import gaze_angles, rotate
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray, IntArray

__all__ = ["AssignRows", "BatchMode", "PlainRows", "SetpointModeRows", "batch_mode"]

_FORWARD = np.array([0.0, 0.0, 1.0])


class BatchMode(Protocol):
    """One mode of actions, for N agents in E environments.

    Attributes
    ----------
    in_world : whether `ask` gives setpoints (E, N, 5), positions in the world and gaze; else shares in [-1, 1]
    needs_beliefs : whether actions are about what agents believe
    """

    in_world: bool
    needs_beliefs: bool

    def space(self) -> spaces.Space[Any]:
        """Return a space of one agent's actions."""
        ...

    def reset(self, rows: IntArray) -> None:
        """Start episodes in the environments ``rows``."""
        ...

    def ask(
        self, actions: NDArray[Any], alive: BoolArray, cameras: Array, beliefs: BeliefRows | None
    ) -> Array:
        """Turn actions (E, N, ...) into what the physics is asked for; agents that do not work hold their place.

        Parameters
        ----------
        alive : (E, N)
        cameras : (E, C, 13) as in `camnet.batch.state.State`
        beliefs : of all agents

        Raises
        ------
        ConfigError
            The actions have another shape or type, or are not finite.
        """
        ...

    def mask(self, beliefs: BeliefRows) -> NDArray[np.int8] | None:
        """Which actions (E, N, A) mean something (None: all)."""
        ...


def batch_mode(network: Network, settings: EnvSettings, environments: int, failing: bool) -> BatchMode:
    """Build the mode that ``settings.action_mode`` names; ``failing``: whether agents may have to hold.

    Raises
    ------
    ConfigError
        The batch back end has no such mode.
    """
    if settings.action_mode == "assign":
        return AssignRows(network, environments)
    if settings.action_mode != "setpoint":
        raise ConfigError(
            f"action_mode = {settings.action_mode!r}: the batch back end has 'setpoint' and 'assign'"
        )
    if failing:
        return SetpointModeRows(network, settings, environments)
    return PlainRows(environments, network.n_agents)


class _Places:
    """Where agents that hold began to do so."""

    def __init__(self, environments: int, agents: int) -> None:
        self._held = np.zeros((environments, agents, 5))
        self._holds = np.zeros((environments, agents), dtype=bool)

    def reset(self, rows: IntArray) -> None:
        """Nobody holds."""
        self._holds[rows] = False

    def hold(self, who: BoolArray, cameras: Array) -> Array:
        """Return setpoints (E, N, 5) of ``who`` holds now (E, N): its place when it began to; others begin anew."""
        begins = who & ~self._holds
        if begins.any():
            now = cameras[:, : who.shape[1]][begins]
            pan, tilt = gaze_angles(rotate(now[:, 3:7], np.broadcast_to(_FORWARD, (len(now), 3))))
            self._held[begins] = np.concatenate([now[:, :3], pan[:, None], tilt[:, None]], axis=1)
        self._holds = who.copy()
        return self._held


class PlainRows:
    """Mode ``setpoint`` where every agent works: the physics takes shares."""

    in_world, needs_beliefs = False, False

    def __init__(self, environments: int, agents: int) -> None:
        self._shape = (environments, agents, 5)

    def space(self) -> spaces.Box:
        """See `BatchMode`."""
        return spaces.Box(-1.0, 1.0, (5,), dtype=np.float32)

    def reset(self, rows: IntArray) -> None:
        """See `BatchMode`."""

    def ask(
        self, actions: NDArray[Any], alive: BoolArray, cameras: Array, beliefs: BeliefRows | None
    ) -> Array:
        """See `BatchMode`."""
        return checked_box("actions", actions, self._shape)

    def mask(self, beliefs: BeliefRows) -> None:
        """See `BatchMode`."""
        return


class SetpointModeRows(PlainRows):
    """Mode ``setpoint`` with agents that may fail."""

    in_world = True

    def __init__(self, network: Network, settings: EnvSettings, environments: int) -> None:
        super().__init__(environments, network.n_agents)
        bounds = np.stack([region.bounds for region in network.regions[: network.n_agents]])
        self._centers = bounds.mean(axis=1)
        margin = network.scenario.controller.region_margin_m
        self._reach = np.maximum(np.ptp(bounds, axis=1) / 2 - margin, 0.0)
        self._gaze_max_rad = settings.gaze_max_rad
        self._places = _Places(environments, network.n_agents)

    def reset(self, rows: IntArray) -> None:
        """See `BatchMode`."""
        self._places.reset(rows)

    def ask(
        self, actions: NDArray[Any], alive: BoolArray, cameras: Array, beliefs: BeliefRows | None
    ) -> Array:
        """See `BatchMode`."""
        flat = checked_box("actions", actions, self._shape)
        wanted = np.concatenate(
            [self._centers + flat[..., :3] * self._reach, flat[..., 3:] * self._gaze_max_rad], axis=2
        )
        return np.where(alive[..., None], wanted, self._places.hold(~alive, cameras))


class AssignRows:
    """Mode ``assign``: one task out of a list, flown by the rules of the built-in system."""

    in_world, needs_beliefs = True, True

    def __init__(self, network: Network, environments: int) -> None:
        n, self._m = network.n_agents, network.n_targets
        self._rows = SetpointRows(network.regions[:n], network.cameras[:n], network.scenario.controller)
        self._places = _Places(environments, n)

    def space(self) -> spaces.Discrete:
        """See `BatchMode`."""
        return spaces.Discrete(2 * self._m + 2)

    def reset(self, rows: IntArray) -> None:
        """See `BatchMode`."""
        self._places.reset(rows)

    def mask(self, beliefs: BeliefRows) -> NDArray[np.int8]:
        """See `BatchMode`."""
        known = np.isfinite(beliefs.last_seen_s)
        always = np.ones((*known.shape[:2], 2), dtype=bool)
        return np.concatenate([known, beliefs.entries[..., 0] > 0.0, always], axis=2).astype(np.int8)

    def ask(
        self, actions: NDArray[Any], alive: BoolArray, cameras: Array, beliefs: BeliefRows | None
    ) -> Array:
        """See `BatchMode`."""
        if beliefs is None:
            raise ConfigError("action_mode 'assign' needs beliefs")
        number, m = self._numbers(actions, alive.shape), self._m
        number = np.where(alive, number, 2 * m + 1)
        sensible = np.take_along_axis(self.mask(beliefs), number[..., None], axis=2)[..., 0] > 0
        target = (number % m)[..., None]
        own_p = beliefs.own_p_world
        rest = np.broadcast_to(self._rows.rest_p_world, own_p.shape)
        p_world, gaze = self._rows.ease(rest, own_p), np.zeros((*number.shape, 2))
        for chosen, (p, g) in (
            (sensible & (number < m), self._track(beliefs, target)),
            (sensible & (number >= m) & (number < 2 * m), self._meet(beliefs, target)),
        ):
            p_world, gaze = np.where(chosen[..., None], p, p_world), np.where(chosen[..., None], g, gaze)
        holds = number == 2 * m + 1
        held = self._places.hold(holds, cameras)
        return np.where(holds[..., None], held, np.concatenate([p_world, gaze], axis=2))

    def _numbers(self, actions: NDArray[Any], shape: tuple[int, ...]) -> IntArray:
        return checked_numbers("actions", actions, 2 * self._m + 1, shape)

    def _track(self, b: BeliefRows, target: IntArray) -> tuple[Array, Array]:
        return self._rows.track(
            _of(b.p_world, target),
            _of(b.v_world, target),
            np.take_along_axis(b.radius_m, target, axis=2)[..., 0],
            np.take_along_axis(b.seen, target, axis=2)[..., 0],
            b.own_p_world,
        )

    def _meet(self, b: BeliefRows, target: IntArray) -> tuple[Array, Array]:
        entry = _of(b.entries, target)
        late_s = b.t_s[:, None] - entry[..., 1]
        goal, gaze = self._rows.intercept(entry[..., 2:5], entry[..., 5:8], entry[..., 8], late_s)
        return self._rows.ease(goal, b.own_p_world, np.maximum(-late_s, 0.0)), gaze


def _of(values: Array, target: IntArray) -> Array:
    """Of values (E, N, M, ...) those (E, N, ...) of one target each (E, N, 1)."""
    return np.take_along_axis(values, target[..., None], axis=2)[:, :, 0]

"""What an action is: three modes.

| mode | space | meaning |
| --- | --- | --- |
| `setpoint` | Box(5) in [-1, 1] | position in the own region, gaze (pan, tilt) over `gaze_max_rad` |
| `velocity` | Box(6) in [-1, 1] | velocity over `reference_v_max_mps`, angular velocity over `reference_w_max_radps` |
| `assign` | Discrete(2M + 2) | 0..M-1 track target m, M..2M-1 wait at its predicted entry, 2M loiter, 2M + 1 hold |

A position is 0 at the region's centre and +-1 at its faces less the margin, axis by axis; sliding-mode control flies
there. Velocities are the camera's, along world axes, and the built-in controller is out of the loop. An assignment
leaves everything below it to the built-in system. An action that is not in its space is an error (beyond the bounds by
no more than what single precision rounds is on them).

Containment. In `setpoint` and `assign` the references never leave the region. In `velocity` the command is guarded so
that the camera stays in its region (`camnet.env.velocity`) unless ``region_guard=False``: then leaving is possible, and
only penalised (``reward.region_exit`` a second and agent). The angular velocity of `velocity` has world axes, since an
observation holds the optical axis but not the turn of the image about it.

An assignment that means nothing at present (a target never seen, no predicted entry) loiters;
``infos[agent]["action_mask"]`` says which ones mean something. Agents that have failed hold where they were.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from camnet.control.setpoints import Setpoint
from camnet.env.beliefs import Beliefs
from camnet.env.checks import checked_box, checked_number
from camnet.env.settings import EnvSettings
from camnet.env.velocity import VelocityPilot
from camnet.errors import ConfigError
from camnet.geometry.rotations import gaze_angles, rotate
from camnet.geometry.triples import borrowing
from camnet.simulation.coordination import Role, Task
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.simulation.run import setpoint_for
from camnet.types import Array, BoolArray

__all__ = ["ActionMode", "action_mode", "setpoint_of"]

_FORWARD = np.array([0.0, 0.0, 1.0])
#: gain from errors to velocities where a built-in task is flown in `velocity` mode, 1/s
_GAIN_PER_S = 2.0


class ActionMode(Protocol):
    """One of the three modes, for all N agents of a network."""

    def space(self) -> spaces.Space[Any]:
        """Return a space of one agent's actions."""
        ...

    def check(self, name: str, action: Any) -> None:  # noqa: ANN401 - whatever a user gives
        """Raise ConfigError unless ``action`` is one that agent ``name`` can take."""
        ...

    def reset(self) -> None:
        """Start an episode."""
        ...

    def fly(self, simulation: NetworkSimulation, actions: Mapping[str, Any], beliefs: Beliefs | None) -> None:
        """Fly one decision under the actions of the agents that still work; the others hold."""
        ...

    def mask(self, beliefs: Beliefs | None, j: int) -> NDArray[np.int8] | None:
        """Which actions mean something to agent ``j`` (None: all)."""
        ...

    def encode(self, simulation: NetworkSimulation, j: int, task: Task, setpoint: Setpoint) -> Any:  # noqa: ANN401
        """Return the action of agent ``j`` that comes nearest to a task of the built-in system and its setpoint."""
        ...


def action_mode(simulation: NetworkSimulation, settings: EnvSettings, names: Sequence[str]) -> ActionMode:
    """Build the mode that ``settings.action_mode`` names."""
    modes: dict[str, type[Any]] = {"setpoint": SetpointMode, "velocity": VelocityMode, "assign": AssignMode}
    mode: ActionMode = modes[settings.action_mode](simulation, settings, names)
    return mode


def setpoint_of(simulation: NetworkSimulation, beliefs: Beliefs, j: int, task: Task) -> Setpoint:
    """Setpoint of agent ``j`` for a task, from its own beliefs."""
    own_p = simulation.snapshot.camera_p_world[j]
    return setpoint_for(simulation.network, j, task, beliefs.estimates(j), own_p, beliefs.t_s)


@borrowing
def write_setpoints(
    actions: Array, centers: Array, reach: Array, gaze_max: float, p_world: Array, gaze: Array
) -> bool:
    """Positions (N,3) and gazes (N,2) that actions (N,5) ask for; False if one is not in [-1, 1]."""
    good = True
    for j in range(actions.shape[0]):
        for i in range(5):
            share = actions[j, i]
            good = good and -1.0 <= share <= 1.0
            if i < 3:
                p_world[j, i] = centers[j, i] + share * reach[j, i]
            else:
                gaze[j, i - 3] = share * gaze_max
    return good


class _Mode:
    """What the modes have in common."""

    def __init__(self, simulation: NetworkSimulation, settings: EnvSettings, names: Sequence[str]) -> None:
        network = simulation.network
        self._names, self._settings = tuple(names), settings
        self._controller = network.scenario.controller
        bounds = np.stack([region.bounds for region in network.regions[: network.n_agents]])
        self._centers = bounds.mean(axis=1)
        self._reach = np.maximum(np.ptp(bounds, axis=1) / 2 - self._controller.region_margin_m, 0.0)
        self._held: dict[int, tuple[Array, Array]] = {}

    def reset(self) -> None:
        """Nobody holds."""
        self._held = {}

    def mask(self, beliefs: Beliefs | None, j: int) -> NDArray[np.int8] | None:
        """All actions mean something."""
        return None

    def _boxed(self, actions: Mapping[str, Any], width: int) -> tuple[Array, BoolArray]:
        """Actions (N, width) in [-1, 1], zero where there is none, and who gave one."""
        n = len(self._names)
        given = np.array([name in actions for name in self._names])
        flat = np.zeros((n, width))
        for j in np.flatnonzero(given).tolist():
            name = self._names[j]
            flat[j] = checked_box(f"action of {name}", actions[name], (width,))
        return flat, given

    def _hold(self, simulation: NetworkSimulation, j: int) -> tuple[Array, Array]:
        """Position and gaze of agent ``j`` at the time it began to hold."""
        if j not in self._held:
            now = simulation.snapshot
            pan, tilt = gaze_angles(rotate(now.camera_q_world[j], _FORWARD))
            self._held[j] = (now.camera_p_world[j].copy(), np.array([float(pan), float(tilt)]))
        return self._held[j]


class SetpointMode(_Mode):
    """Position in the own region and gaze."""

    def space(self) -> spaces.Box:
        """Space of one agent's actions."""
        return spaces.Box(-1.0, 1.0, (5,), dtype=np.float32)

    def check(self, name: str, action: Any) -> None:  # noqa: ANN401 - whatever a user gives
        """See `ActionMode`."""
        checked_box(f"action of {name}", action, (5,))

    def setpoints(self, simulation: NetworkSimulation, actions: Mapping[str, Any]) -> Setpoints:
        """Return the setpoints that actions ask for: positions in the world, gaze angles."""
        if len(actions) == len(self._names):
            rows = [actions[name] for name in self._names]
            if all(isinstance(r, np.ndarray) and r.shape == (5,) and r.dtype.kind == "f" for r in rows):
                p_world, gaze = np.empty((len(rows), 3)), np.empty((len(rows), 2))
                given_rows, scale = np.array(rows, dtype=float), self._settings.gaze_max_rad
                if write_setpoints(given_rows, self._centers, self._reach, scale, p_world, gaze):
                    return Setpoints(p_world, gaze)
        return self._checked_setpoints(simulation, actions)

    def _checked_setpoints(self, simulation: NetworkSimulation, actions: Mapping[str, Any]) -> Setpoints:
        """Do what `setpoints` does with whatever a user gives, and where somebody has failed."""
        flat, given = self._boxed(actions, 5)
        p_world = self._centers + flat[:, :3] * self._reach
        gaze = flat[:, 3:] * self._settings.gaze_max_rad
        for j in np.flatnonzero(~given).tolist():
            p_world[j], gaze[j] = self._hold(simulation, j)
        return Setpoints(p_world, gaze)

    def fly(self, simulation: NetworkSimulation, actions: Mapping[str, Any], beliefs: Beliefs | None) -> None:
        """See `ActionMode`."""
        simulation.advance(self.setpoints(simulation, actions))

    def encode(
        self, simulation: NetworkSimulation, j: int, task: Task, setpoint: Setpoint
    ) -> NDArray[np.float32]:
        """See `ActionMode`."""
        place = (setpoint.p_world - self._centers[j]) / np.maximum(self._reach[j], 1e-6)
        flat = np.concatenate([place, setpoint.gaze / self._settings.gaze_max_rad])
        return np.asarray(np.clip(flat, -1.0, 1.0), dtype=np.float32)


class VelocityMode(_Mode):
    """Velocity of the camera and its angular velocity."""

    def __init__(self, simulation: NetworkSimulation, settings: EnvSettings, names: Sequence[str]) -> None:
        super().__init__(simulation, settings, names)
        regions = simulation.network.regions[: len(self._names)]
        self._pilot = VelocityPilot(self._controller, regions, simulation.control_dt_s, settings.region_guard)

    def space(self) -> spaces.Box:
        """Space of one agent's actions."""
        return spaces.Box(-1.0, 1.0, (6,), dtype=np.float32)

    def check(self, name: str, action: Any) -> None:  # noqa: ANN401 - whatever a user gives
        """See `ActionMode`."""
        checked_box(f"action of {name}", action, (6,))

    def reset(self) -> None:
        """Start at rest."""
        super().reset()
        self._pilot.reset()

    def fly(self, simulation: NetworkSimulation, actions: Mapping[str, Any], beliefs: Beliefs | None) -> None:
        """See `ActionMode`."""
        flat, given = self._boxed(actions, 6)
        for j in np.flatnonzero(~given).tolist():
            flat[j] = self._towards(simulation, j, *self._hold(simulation, j))
        self._pilot.ask(flat)
        simulation.advance_commanded(self._pilot)

    def _towards(self, simulation: NetworkSimulation, j: int, p_world: Array, gaze: Array) -> Array:
        """Return the action (6,) that leads agent ``j`` to a position and a gaze."""
        now, controller = simulation.snapshot, self._controller
        v = _shortened(_GAIN_PER_S * (p_world - now.camera_p_world[j]) / controller.reference_v_max_mps)
        axis = rotate(now.camera_q_world[j], _FORWARD)
        wanted = np.array([np.tan(gaze[0]), np.tan(gaze[1]), -1.0])
        turn = np.cross(axis, wanted / np.linalg.norm(wanted))  # about the world's axes, sine of the angle
        w = _shortened(_GAIN_PER_S * turn / controller.reference_w_max_radps)
        return np.concatenate([v, w])

    def encode(
        self, simulation: NetworkSimulation, j: int, task: Task, setpoint: Setpoint
    ) -> NDArray[np.float32]:
        """See `ActionMode`."""
        gaze = np.clip(setpoint.gaze, -1.4, 1.4)
        return self._towards(simulation, j, setpoint.p_world, gaze).astype(np.float32)


class AssignMode(_Mode):
    """One task out of a list."""

    def __init__(self, simulation: NetworkSimulation, settings: EnvSettings, names: Sequence[str]) -> None:
        super().__init__(simulation, settings, names)
        self._m = simulation.network.n_targets

    def space(self) -> spaces.Discrete:
        """Space of one agent's actions."""
        return spaces.Discrete(2 * self._m + 2)

    def check(self, name: str, action: Any) -> None:  # noqa: ANN401 - whatever a user gives
        """See `ActionMode`."""
        checked_number(f"action of {name}", action, 2 * self._m + 1)

    def mask(self, beliefs: Beliefs | None, j: int) -> NDArray[np.int8]:
        """See `ActionMode`."""
        if beliefs is None:
            raise ConfigError("action_mode 'assign' needs beliefs")
        known = np.isfinite(beliefs.last_seen_s[j])
        coming = [entry is not None for entry in beliefs.entries[j]]
        return np.concatenate([known, coming, [True, True]]).astype(np.int8)

    def fly(self, simulation: NetworkSimulation, actions: Mapping[str, Any], beliefs: Beliefs | None) -> None:
        """See `ActionMode`."""
        if beliefs is None:
            raise ConfigError("action_mode 'assign' needs beliefs")
        p_world, gaze = np.empty((len(self._names), 3)), np.empty((len(self._names), 2))
        last = 2 * self._m + 1
        given = {name: checked_number(f"action of {name}", a, last) for name, a in actions.items()}
        for j, name in enumerate(self._names):
            number = given.get(name, last)
            if number == last:
                p_world[j], gaze[j] = self._hold(simulation, j)
                continue
            self._held.pop(j, None)
            p_world[j], gaze[j] = setpoint_of(simulation, beliefs, j, self._task(number, beliefs, j))
        simulation.advance(Setpoints(p_world, gaze))

    def _task(self, number: int, beliefs: Beliefs, j: int) -> Task:
        if number < self._m and np.isfinite(beliefs.last_seen_s[j, number]):
            return Task(Role.TRACK, number)
        if self._m <= number < 2 * self._m:
            entry = beliefs.entries[j][number - self._m]
            if entry is not None:
                return Task(Role.INTERCEPT, number - self._m, entry)
        return Task(Role.LOITER)

    def encode(self, simulation: NetworkSimulation, j: int, task: Task, setpoint: Setpoint) -> np.int64:
        """See `ActionMode`."""
        number = {Role.TRACK: task.target, Role.INTERCEPT: self._m + task.target}.get(task.role, 2 * self._m)
        return np.int64(number)


def _shortened(share: Array) -> Array:
    """Shorten a vector to length 1."""
    return np.asarray(share / max(float(np.linalg.norm(share)), 1.0))

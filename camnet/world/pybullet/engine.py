"""One physics client: connection, parameters, and the few kinds of body that worlds are made of.

The engine's quaternions are x y z w; everything else in camnet is w x y z, and the order changes here only.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pybullet as pb

from camnet.errors import WorldError
from camnet.types import Array
from camnet.world.pybullet.shapes import Solid
from camnet.world.settings import PhysicsSettings

__all__ = ["GROUND", "GROUND_MASK", "Engine", "open_clients", "xyzw"]

#: name of the ground in collision pairs
GROUND = "ground"
#: collision groups: what flies meets everything; what stands or is driven meets only what flies; sight lines
#: leave the ground out
_FLYING, GROUND_MASK, _STANDING = 1, 2, 4
_SOLVER_ITERATIONS = 10
_Color = tuple[float, float, float, float]


def xyzw(q: Array) -> tuple[float, float, float, float]:
    """Quaternion w x y z in the engine's order."""
    w, x, y, z = q.tolist()
    return (x, y, z, w)


class Engine:
    """A headless PyBullet client with fixed step, fixed solver iterations, no damping and no sleeping.

    Parameters
    ----------
    physics : step and gravity
    substeps : physics steps that one call of the engine takes while it does not `watch` for contacts; forces, torques
        and gravity act in all of them
    """

    def __init__(self, physics: PhysicsSettings, substeps: int = 1) -> None:
        self._physics, self._substeps, self._watched = physics, substeps, False
        self.names: dict[int, str] = {}
        self._connect()
        self.restart()

    def _connect(self) -> None:
        """Open a client, which is freed by `close` or when nobody holds this engine any more."""
        self.client: int = pb.connect(pb.DIRECT)
        if self.client < 0:
            raise WorldError("PyBullet gave no physics client; too many worlds are open: close() some")
        _OPEN.add(self.client)
        self._free = weakref.finalize(self, _disconnect, self.client)

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings alone: a copy's client is a new, empty one, to be built anew and to `load` the state."""
        return {
            "_physics": self._physics,
            "_substeps": self._substeps,
            "_watched": self._watched,
            "_closed": self.client < 0,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        closed = state.pop("_closed")
        self.__dict__.update(state)
        self.names = {}
        if closed:
            self.client = -1
        else:
            self._connect()
            self.restart()

    def save(self) -> bytes:
        """State of all bodies and of their contacts, to the last bit."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "state.bullet"
            pb.saveBullet(str(file), physicsClientId=self.client)
            return file.read_bytes()

    def load(self, saved: bytes) -> None:
        """Take over a state that `save` made of an engine with the same bodies.

        Raises
        ------
        WorldError
            The bodies are others, or the state cannot be read.
        """
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "state.bullet"
            file.write_bytes(saved)
            try:
                pb.restoreState(fileName=str(file), physicsClientId=self.client)
            except pb.error as error:
                raise WorldError(f"PyBullet cannot take over the state of a copied world: {error}") from error

    def restart(self) -> None:
        """Empty the client: nothing of an earlier run (contacts, warm starts) survives."""
        c = self.client
        pb.resetSimulation(physicsClientId=c)
        gravity = self._physics.gravity_mps2 if self._physics.actuation == "quadrotor" else 0.0
        pb.setGravity(0.0, 0.0, -gravity, physicsClientId=c)
        pb.setPhysicsEngineParameter(
            numSolverIterations=_SOLVER_ITERATIONS, deterministicOverlappingPairs=1, physicsClientId=c
        )
        self.names = {}
        self._ground: int | None = None
        self._watch(self._watched)

    def watch(self, on: bool) -> None:
        """Watch for contacts: a call of the engine takes one physics step. Off: all substeps, and no ground to meet.

        The ground's bounds overlap everything, so the engine would test each body against it in each step.
        """
        if on != self._watched:
            self._watch(on)

    def _watch(self, on: bool) -> None:
        self._watched, count = on, 1 if on else self._substeps
        pb.setPhysicsEngineParameter(
            fixedTimeStep=count / self._physics.step_hz, numSubSteps=count, physicsClientId=self.client
        )
        if self._ground is not None:
            meets = _FLYING if on else 0
            pb.setCollisionFilterGroupMask(self._ground, -1, GROUND_MASK, meets, physicsClientId=self.client)

    def add(
        self, name: str, solid: Solid, p_world: Sequence[float], q: Array, color: _Color, mass_kg: float = 0.0
    ) -> int:
        """Create a body (mass 0: it stays where it is put) and return its number."""
        c = self.client
        shape = pb.createCollisionShape(**solid.collision, physicsClientId=c)
        visual = pb.createVisualShape(
            **solid.visual, rgbaColor=color, specularColor=(0.1, 0.1, 0.1), physicsClientId=c
        )
        if shape < 0 or visual < 0:
            raise WorldError(f"PyBullet could not build the body {name!r} from {solid.collision}")
        body: int = pb.createMultiBody(
            mass_kg, shape, visual, basePosition=p_world, baseOrientation=xyzw(q), physicsClientId=c
        )
        if mass_kg > 0:
            pb.setCollisionFilterGroupMask(body, -1, _FLYING, -1, physicsClientId=c)
            self.names[body] = name
        else:
            self.stand(body, name)
        return body

    def stand(self, body: int, name: str) -> None:
        """Note a body that stands or is driven: it meets only what flies."""
        pb.setCollisionFilterGroupMask(body, -1, _STANDING, _FLYING, physicsClientId=self.client)
        self.names[body] = name

    def add_picture(self, solid: Solid, color: _Color) -> None:
        """Create something that is only seen."""
        c = self.client
        visual = pb.createVisualShape(
            **solid.visual, rgbaColor=color, specularColor=(0.0, 0.0, 0.0), physicsClientId=c
        )
        pb.createMultiBody(0.0, -1, visual, physicsClientId=c)

    def make_free(self, body: int, mass_kg: float, inertia_kgm2: Sequence[float]) -> None:
        """Give a body its mass properties and take away every artificial damping."""
        pb.changeDynamics(
            body,
            -1,
            mass=mass_kg,
            localInertiaDiagonal=list(inertia_kgm2),
            linearDamping=0.0,
            angularDamping=0.0,
            restitution=0.2,
            maxJointVelocity=1e4,
            activationState=pb.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=self.client,
        )

    def add_ground(self) -> None:
        """Create the plane z = 0."""
        c = self.client
        shape = pb.createCollisionShape(pb.GEOM_PLANE, physicsClientId=c)
        # without a visual shape of its own the engine draws a chequered plane over ours
        unseen = pb.createVisualShape(
            pb.GEOM_BOX,
            halfExtents=[0.1, 0.1, 0.1],
            visualFramePosition=[0.0, 0.0, -200.0],
            physicsClientId=c,
        )
        body = pb.createMultiBody(0.0, shape, unseen, physicsClientId=c)
        self._ground, self.names[body] = body, GROUND
        self._watch(self._watched)

    def place(self, body: int, p_world: Sequence[float], q_xyzw: Sequence[float]) -> None:
        """Put a body somewhere; its velocity becomes zero."""
        pb.resetBasePositionAndOrientation(body, p_world, q_xyzw, self.client)

    def contacts(self) -> set[tuple[str, str]]:
        """Pairs of names that touched in the last step."""
        points = pb.getContactPoints(physicsClientId=self.client)
        if not points:
            return set()
        # a reported point may still be at a distance: only touching counts
        touching = ((self.names[x[1]], self.names[x[2]]) for x in points if x[8] <= 0.0)
        return {(a, b) if a < b else (b, a) for a, b in touching}

    def close(self) -> None:
        """Disconnect; nothing happens where that was done before."""
        if self.client >= 0:
            self.client = -1
            self._free()


#: clients that are open now
_OPEN: set[int] = set()


def open_clients() -> int:
    """Count the physics clients that worlds of this process hold."""
    return len(_OPEN)


def _disconnect(client: int) -> None:
    _OPEN.discard(client)
    pb.disconnect(client)

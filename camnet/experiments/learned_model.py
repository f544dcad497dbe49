"""The learned motion models of targets: learned in simulation by the built-in estimator, saved and loaded.

A model file (``.npz``) holds the kernels, one weight matrix per region, and the record of the run that made it: the
true path, who saw the target when, and every gap with the prediction's error at its end.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.certification.growth import PlanarField
from camnet.config.models import Scenario
from camnet.errors import ConfigError, DataError
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.propagate import UNIT
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.run import decide, open_simulation, setpoints_for
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["LearnedModel", "learn_model", "learn_models", "load_model", "load_models", "save_models"]

_KEYS = ("centres", "precision", "weights", "path", "gaps")


@dataclass(frozen=True, eq=False)
class LearnedModel:
    """What the estimator learned, and the run that it learned from.

    Attributes
    ----------
    centres, precision : (p, 2), (p, 2, 2) kernels, m and 1/m^2
    weights : (J, p, 8) weights of every region's model; columns 0, 1 are the planar velocity, m/s
    path : (n, 4) time (s), true x and y (m), camera that sees the target (-1: none)
    gaps : (g, 5) camera before and after, time lost and seen again (s), error of the prediction then (m)
    """

    centres: Array
    precision: Array
    weights: Array
    path: Array
    gaps: Array

    def fields(self) -> list[PlanarField]:
        """Return the learned planar velocity of every region's model."""
        return [PlanarField.create(self.centres, self.precision, w[:, :2]) for w in self.weights]

    def support(self, region: int, points: Array) -> Array:
        """Return the share of the motion that a region's model answers for at points (n, 2)."""
        delta = points[:, None, :] - self.centres
        sigma = np.exp(-0.5 * np.einsum("nki,kij,nkj->nk", delta, self.precision, delta))
        return np.asarray(np.clip(sigma @ self.weights[region][:, UNIT], 0.0, 1.0))

    def save(self, path: Path) -> None:
        """Write the model; equal models give equal files."""
        with whole_file(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for key in _KEYS:
                buffer = io.BytesIO()
                np.save(buffer, getattr(self, key), allow_pickle=False)
                archive.writestr(zipfile.ZipInfo(f"{key}.npy"), buffer.getvalue(), zipfile.ZIP_DEFLATED)


def load_model(path: str | Path) -> LearnedModel:
    """Read a model that ``save`` wrote.

    Raises
    ------
    DataError
        The file is absent or holds something else.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            return LearnedModel(*(np.asarray(data[key], dtype=float) for key in _KEYS))
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise DataError(
            f"{path}: not a learned model ({error}); camnet certify WORLD --learn --out DIR writes one"
        ) from None


def learn_model(
    scenario: Scenario, seconds: float, seed: int, progress: Callable[[float], None] | None = None
) -> LearnedModel:
    """Simulate the network in closed loop and return what the estimator learned of its first target.

    Raises
    ------
    ConfigError
        The estimator's kernels depend on the heading: the planar growth law does not apply.
    """
    return next(iter(learn_models(scenario, seconds, seed, progress).values()))


def learn_models(
    scenario: Scenario, seconds: float, seed: int, progress: Callable[[float], None] | None = None
) -> dict[str, LearnedModel]:
    """Simulate the network in closed loop and return what was learned of every target, by its name."""
    simulation = open_simulation(scenario, seed, ("learned",))
    try:
        if simulation.network.basis.centres.shape[1] != 2:
            raise ConfigError(
                f"estimator.basis.inputs = {scenario.estimator.basis.inputs!r}: the learned certificate needs a "
                "velocity that depends on the position alone; use 'position'"
            )
        paths = _follow(simulation, seconds, progress)
        return {t.name: _collect(simulation, m, paths[m]) for m, t in enumerate(scenario.targets)}
    finally:
        simulation.world.close()


def save_models(models: Mapping[str, LearnedModel], folder: Path) -> None:
    """Write ``model.npz`` for the first target and ``model_<name>.npz`` for each further one."""
    for k, (name, model) in enumerate(models.items()):
        model.save(folder / ("model.npz" if k == 0 else f"model_{name}.npz"))


def load_models(path: Path, targets: Sequence[str]) -> dict[str, LearnedModel]:
    """Read the models that ``save_models`` wrote: ``path`` is the first target's, the others lie beside it."""
    models = {targets[0]: load_model(path)}
    for name in targets[1:]:
        beside = path.parent / f"model_{name}.npz"
        if beside.is_file():
            models[name] = load_model(beside)
    return models


def _follow(
    simulation: NetworkSimulation, seconds: float, progress: Callable[[float], None] | None
) -> list[list[tuple[float, float, float, float]]]:
    paths: list[list[tuple[float, float, float, float]]] = [[] for _ in simulation.driving]
    for k in range(round(seconds * simulation.network.scenario.run.decision_hz)):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
        now = simulation.snapshot
        for m, path in enumerate(paths):
            x, y = now.target_p_world[m, :2].tolist()
            path.append((now.t_s, x, y, float(simulation.seen_by(m))))
        if progress is not None and k % 10 == 0:
            progress(now.t_s)
    return paths


def _collect(
    simulation: NetworkSimulation, m: int, path: list[tuple[float, float, float, float]]
) -> LearnedModel:
    driving = simulation.driving[m]
    if not isinstance(driving, LearningEstimator):
        raise ConfigError("only the learning estimator leaves a model behind")
    weights = [driving.model(j).weights.copy() for j in range(len(simulation.network.regions))]
    gaps = [
        (g.from_camera, g.to_camera, g.lost_s, g.seen_s, g.error_m["learned"])
        for g in simulation.gaps[m].gaps
    ]
    basis = simulation.network.basis
    return LearnedModel(
        basis.centres.copy(),
        basis.precision.copy(),
        np.array(weights),
        np.array(path, dtype=float),
        np.array(gaps, dtype=float).reshape(-1, 5),
    )

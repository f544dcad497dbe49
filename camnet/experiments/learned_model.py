"""The learned motion models of targets: learned in simulation by the built-in estimator, saved and loaded.

A model file (`camnet.storage.archive`) holds the kernels, one weight matrix per region, and the record of the run that
made it: the true path, who saw the target when, and every gap with the prediction's error at its end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camnet.certification.growth import PlanarField
from camnet.config.models import Scenario
from camnet.errors import ConfigError, DataError
from camnet.estimation.concurrent_learning import LAYER_SHARE
from camnet.estimation.delayed import underlying
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.propagate import COLUMNS, UNIT
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.run import decide, open_simulation, setpoints_for
from camnet.storage.archive import Archive, read_archive, write_archive
from camnet.types import Array

__all__ = ["LearnedModel", "learn_model", "learn_models", "load_model", "load_models", "save_models"]

FORMAT, VERSION = "camnet learned motion", 1
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
    world, target : what it was learned of
    """

    centres: Array
    precision: Array
    weights: Array
    path: Array
    gaps: Array
    world: str = ""
    target: str = ""

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
        arrays = {key: np.asarray(getattr(self, key), dtype=np.float64) for key in _KEYS}
        write_archive(path, FORMAT, VERSION, {"world": self.world, "target": self.target}, arrays)


def load_model(path: str | Path) -> LearnedModel:
    """Read a model that ``save`` wrote.

    Raises
    ------
    DataError
        The file is absent or holds something else.
    """
    try:
        archive = read_archive(Path(path), FORMAT, VERSION)
        model = _from_archive(archive)
    except DataError as error:
        raise DataError(f"{error}; camnet certify WORLD --learn --out DIR writes learned models") from None
    _check_run(path, model)
    return model


def _from_archive(archive: Archive) -> LearnedModel:
    archive.only(set(_KEYS))
    names = {key: archive.header.get(key) for key in ("world", "target")}
    if set(archive.header) != set(names) or not all(isinstance(name, str) for name in names.values()):
        raise DataError(f"{archive.path}: header {archive.header}, expected names of world and target")
    centres = archive.floats("centres", (None, 2))
    p = len(centres)
    precision = archive.floats("precision", (p, 2, 2))
    if not (np.linalg.eigvalsh(precision) > 0.0).all() or not np.allclose(
        precision[:, 0, 1], precision[:, 1, 0]
    ):
        raise DataError(
            f"{archive.path}: array 'precision' holds matrices that are not symmetric and positive"
        )
    weights = archive.floats("weights", (None, p, COLUMNS))
    path, gaps = archive.floats("path", (None, 4)), archive.floats("gaps", (None, 5))
    return LearnedModel(centres, precision, weights, path, gaps, str(names["world"]), str(names["target"]))


def _check_run(path: str | Path, model: LearnedModel) -> None:
    """See that the record of the run can be one: times in order, cameras of the network (DataError)."""
    t_s, cameras = model.path[:, 0], np.r_[model.path[:, 3], model.gaps[:, :2].ravel()]
    regions = len(model.weights)
    if len(t_s) and not (t_s[0] >= 0.0 and (np.diff(t_s) > 0.0).all()):
        raise DataError(f"{path}: array 'path': its times do not increase")
    if not regions or not np.isin(cameras, np.arange(-1, regions)).all():
        raise DataError(
            f"{path}: arrays 'path' and 'gaps': cameras are -1 to {regions - 1}, one for each of 'weights'"
        )
    if not ((model.gaps[:, 3] >= model.gaps[:, 2]) & (model.gaps[:, 4] >= 0.0)).all():
        raise DataError(f"{path}: array 'gaps': a gap ends before it begins, or has a negative error")


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
        found = (_collect(simulation, m, paths[m]) for m in range(len(scenario.targets)))
        return {
            t.name: replace(model, world=scenario.name, target=t.name)
            for t, model in zip(scenario.targets, found, strict=True)
        }
    finally:
        simulation.world.close()


def save_models(models: Mapping[str, LearnedModel], folder: Path) -> None:
    """Write ``model.npz`` for the first target and ``model_<name>.npz`` for each further one."""
    for k, (name, model) in enumerate(models.items()):
        model.save(folder / ("model.npz" if k == 0 else f"model_{name}.npz"))


def load_models(path: Path, scenario: Scenario) -> dict[str, LearnedModel]:
    """Read the models that ``save_models`` wrote: ``path`` is the first target's, the others lie beside it.

    Raises
    ------
    DataError
        A file cannot be read, is of another world or target, or its weights are beyond the estimator's bound.
    """
    first, *others = (target.name for target in scenario.targets)
    files = {first: path, **{name: path.parent / f"model_{name}.npz" for name in others}}
    found = {name: file for name, file in files.items() if name == first or file.exists()}
    models = {name: load_model(file) for name, file in found.items()}
    outputs = 6 if scenario.estimator.form == "twist" else 7
    rim = (1.0 + LAYER_SHARE) * scenario.estimator.weight_bound * (1.0 + 1e-9)
    for name, model in models.items():
        for what, stated, wanted in (("world", model.world, scenario.name), ("target", model.target, name)):
            if stated and stated != wanted:
                raise DataError(f"{found[name]}: was learned of {what} {stated!r}, not of {wanted!r}")
        if np.linalg.norm(model.weights[:, :, :outputs], axis=(1, 2)).max() > rim:
            raise DataError(
                f"{found[name]}: array 'weights' is larger than estimator.weight_bound ever leaves it"
            )
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
    driving = underlying(simulation.driving[m])
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

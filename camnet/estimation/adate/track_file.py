"""A track of AdaTE in a file: everything that the next update reads, as a sealed archive of arrays.

| member | what |
| --- | --- |
| header | model, settings, numbers of `Track` |
| ``window_*`` | rows of the window's arrays |
| ``frozen_*`` | covariances and transitions of frozen states |
| others | arrays of `Track` |
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from camnet.errors import ConfigError, DataError
from camnet.estimation.adate.settings import AdateSettings
from camnet.estimation.pls.model import ConstantTurn, PowerLimitedSteering, SteeringModel
from camnet.storage.archive import Archive, read_archive, write_archive
from camnet.types import Array

if TYPE_CHECKING:
    from camnet.estimation.adate.estimator import AdaptiveTrajectoryEstimator
    from camnet.estimation.adate.track import Track

__all__ = ["load_track", "save_track"]

_FORMAT, _VERSION = "camnet-adate-track", 1
_MODELS: dict[str, type[SteeringModel]] = {
    "power_limited_steering": PowerLimitedSteering,
    "constant_turn": ConstantTurn,
}
_NUMBERS = (
    "start",
    "steps",
    "rest",
    "keep_q",
    "power_scale",
    "steering_scale",
    "restarts",
    "fallbacks",
    "elapsed_s",
)
_ARRAYS = ("mean", "cov", "causal_cov", "pred_mean", "scale", "weight")
_FROZEN = ("filtered", "transition", "predicted")


def save_track(estimator: AdaptiveTrajectoryEstimator, path: Path) -> None:
    """Write an estimator's track."""
    track = estimator._track
    kind = next((name for name, model in _MODELS.items() if type(estimator.model) is model), None)
    if kind is None:
        raise ConfigError(
            f"model {type(estimator.model).__name__}: tracks of {', '.join(_MODELS)} can be saved"
        )
    fields = {f.name: getattr(estimator.model, f.name) for f in dataclasses.fields(estimator.model) if f.init}
    header = {
        "model": kind,
        "parameters": fields,
        "settings": estimator.settings.model_dump(mode="json"),
        "dt_s": estimator.dt_s,
        "observers": {str(name): slot for name, slot in track.ids.items()},
        "slots": track.win.slots,
        "rows": track.win.n,
        **{name: getattr(track, name) for name in _NUMBERS},
    }
    arrays = {name: np.asarray(getattr(track, name)) for name in _ARRAYS}
    arrays["trajectory"] = track.all[: track.steps]
    arrays |= {f"window_{name}": data for name, data in track.win.rows().items()}
    for k, name in enumerate(_FROZEN):
        arrays[f"frozen_{name}"] = np.array([row[k] for row in track.frozen]).reshape(-1, 10, 10)
    write_archive(path, _FORMAT, _VERSION, header, arrays)


def load_track(kind: type[AdaptiveTrajectoryEstimator], path: Path) -> AdaptiveTrajectoryEstimator:
    """Read what `save_track` wrote."""
    archive = read_archive(path, _FORMAT, _VERSION)
    header = archive.header
    try:
        model = _MODELS[header["model"]](**_tupled(header["parameters"]))
        settings = AdateSettings.model_validate_json(json.dumps(header["settings"]))
        estimator = kind(model, float(header["dt_s"]), settings)
        _fill(estimator._track, header, archive)
    except (KeyError, TypeError, ValueError, IndexError, ConfigError, ValidationError) as error:
        raise DataError(f"{path}: does not hold a whole track ({error!r}); save it again") from error
    return estimator


def _tupled(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}


def _fill(track: Track, header: dict[str, Any], archive: Archive) -> None:
    for name in _NUMBERS:
        setattr(track, name, type(getattr(track, name))(header[name]))
    track.ids = {int(name): int(slot) for name, slot in header["observers"].items()}
    track.win.restore(
        int(header["slots"]),
        int(header["rows"]),
        {name.removeprefix("window_"): a for name, a in archive.arrays.items() if name.startswith("window_")},
    )
    for name in _ARRAYS:
        setattr(track, name, archive.arrays[name].copy())
    path: Array = archive.floats("trajectory", (track.steps, 10))
    track.all = np.concatenate([path, np.zeros((max(256, track.steps), 10))])
    frozen = [archive.floats(f"frozen_{name}", (None, 10, 10)) for name in _FROZEN]
    track.frozen = [(a.copy(), b.copy(), c.copy()) for a, b, c in zip(*frozen, strict=True)]

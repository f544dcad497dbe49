"""What a certificate promises of the closed loop, as figures that the truth can break."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.types import Array

__all__ = ["Claims", "ErrorBound", "claims_of_report", "read_claims"]

_KEYS = {
    "world",
    "note",
    "unseen_max_m",
    "unseen_max_s",
    "targets_at_once",
    "into_first_view",
    "after_laps",
    "after_s",
    "error_after_laps",
    "error",
}
_ERROR_KEYS = {"initial_m", "growth_mps", "max_m"}


@dataclass(frozen=True, eq=False, slots=True)
class ErrorBound:
    """Bound of a prediction's error after a gap of length tau: ``min(initial + growth tau, max)``, m.

    Attributes
    ----------
    initial_m, growth_mps, max_m : the bound of every gap that has no table
    tables : for a target and the camera that saw it last, times (s) since then and the bound at each (m)
    """

    initial_m: float = 0.0
    growth_mps: float = 0.0
    max_m: float = math.inf
    tables: dict[tuple[int, int], tuple[Array, Array]] = field(default_factory=dict)
    factor: float = 1.0

    def at(self, target: int, camera: int, gap_s: float) -> float:
        """Return the bound after ``gap_s`` out of view, m."""
        table = self.tables.get((target, camera))
        if table is not None:
            return self.factor * float(np.interp(gap_s, *table))
        return self.factor * min(self.initial_m + self.growth_mps * gap_s, self.max_m)

    def as_dict(self) -> dict[str, Any]:
        """Return the bound as plain data for JSON; one that is infinite becomes None."""
        figures = {"initial_m": self.initial_m, "growth_mps": self.growth_mps, "max_m": self.max_m}
        finite = {key: v if math.isfinite(v) else None for key, v in figures.items()}
        rows = [
            {"target": m, "camera": c, "t_s": t.tolist(), "bound_m": r.tolist()}
            for (m, c), (t, r) in self.tables.items()
        ]
        return {**finite, "factor": self.factor, "tables": rows}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> ErrorBound:
        """Read back what `as_dict` made."""
        figures = {
            k: math.inf if content[k] is None else float(content[k])
            for k in ("initial_m", "growth_mps", "max_m")
        }
        tables = {
            (int(r["target"]), int(r["camera"])): (np.array(r["t_s"]), np.array(r["bound_m"]))
            for r in content["tables"]
        }
        return cls(**figures, tables=tables, factor=float(content["factor"]))


@dataclass(frozen=True, slots=True)
class Claims:
    """What is promised of every target.

    Attributes
    ----------
    unseen_max_m, unseen_max_s : longest stretch out of view (None: nothing is promised)
    error : bound of the estimate's error when a target is seen again (None: nothing is promised)
    targets_at_once : for how many targets at the same time (None: any number)
    into_first_view : whether the stretch before the first view counts
    after_laps, after_s : what is promised of targets that have been followed for so many laps, or so long, s
    error_after_laps : laps after which the bound of the error holds, if these are more
    ways : longest stretch out of view between two regions, (from, to, m) each
    source : where the promise was read
    """

    unseen_max_m: float | None = None
    unseen_max_s: float | None = None
    error: ErrorBound | None = None
    targets_at_once: int | None = None
    into_first_view: bool = True
    after_laps: int = 0
    after_s: float = 0.0
    error_after_laps: int = 0
    ways: tuple[tuple[str, str, float], ...] = ()
    source: str = "certificate"

    @property
    def empty(self) -> bool:
        """Whether nothing is promised."""
        return self.unseen_max_m is None and self.unseen_max_s is None and self.error is None

    def scaled(self, factor: float) -> Claims:
        """Return a promise of other figures: all of them times ``factor``."""

        def times(value: float | None) -> float | None:
            return None if value is None else factor * value

        error = self.error
        if error is not None:
            error = replace(error, factor=factor * error.factor)
        return replace(
            self,
            unseen_max_m=times(self.unseen_max_m),
            unseen_max_s=times(self.unseen_max_s),
            error=error,
            ways=tuple((a, b, factor * length_m) for a, b, length_m in self.ways),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the promise as plain data for JSON."""
        content = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**content, "error": None if self.error is None else self.error.as_dict()}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Claims:
        """Read back what `as_dict` made."""
        error = content["error"]
        ways = tuple((str(a), str(b), float(length)) for a, b, length in content.get("ways", ()))
        known = {**content, "ways": ways}
        return cls(**{**known, "error": None if error is None else ErrorBound.from_dict(error)})


def claims_of_report(report: dict[str, Any], source: str = "certificate") -> Claims:
    """Return what a report of ``camnet certify`` promises; empty where it promises nothing.

    The figures are those of the promise, whether or not they are within what is allowed. Where the promise rests on a
    learned motion (agents), it holds from the second lap on; attacks begin anywhere on a path, so that the way into the
    first view then counts only where the report states it. Between two regions of agents the way has a figure of its
    own, beside the longest of all.
    """
    promise = report["promise"]
    if promise["nobody_sees"] or not promise["bounded"] or "nothing is promised" in promise["sentence"]:
        return Claims(source=source)
    rests_on_model = promise["agents"] > 0
    return Claims(
        unseen_max_m=promise["unseen_max_m"],
        unseen_max_s=promise["unseen_max_s"],
        targets_at_once=promise["targets_served"],
        into_first_view=not rests_on_model or promise["into_first_view"] is not None,
        after_laps=1 if rests_on_model else 0,
        ways=_ways(report) if rests_on_model else (),
        source=source,
    )


def _ways(report: dict[str, Any]) -> tuple[tuple[str, str, float], ...]:
    """Return the longest stretch out of view from each region to each that follows, those without end left out.

    Behind a learned flow the target is seen again where its whole ball is in the next region: later than the gap ends.
    Nothing is promised there but the longest of all.
    """
    longest: dict[tuple[str, str], float] = {}
    for entry in report["transitions"]:
        if "seen_again_s" in entry.get("learned", {}):
            return ()
        pair, length = (entry["from"], entry["to"]), entry["longest_m"]
        longest[pair] = max(longest.get(pair, 0.0), math.inf if length is None else float(length))
    return tuple((a, b, length) for (a, b), length in longest.items() if math.isfinite(length))


def _claims_without_promise(report: dict[str, Any], source: str) -> Claims:
    """Return what a certificate promises that has no promise at its head, as earlier versions wrote it.

    A certified ``sound`` or ``learned`` stood for every transition: seen again within the longest time out of view.
    Nothing was said of the way into the first view.
    """
    certified = any(report["certificates"][k]["verdict"] == "certified" for k in ("sound", "learned"))
    limit = report["constants"]["off_max_s"] if certified else None
    return Claims(unseen_max_s=limit, into_first_view=False, source=source)


def read_claims(path: Path) -> tuple[Claims, str | None]:
    """Read a ``certificate.json`` or a promise of one's own; return it and the world that it speaks of, if it says.

    Raises
    ------
    DataError
        The file cannot be read, or a key or value is not one of a promise.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    if isinstance(content, dict) and "certificates" in content:
        claims_of = claims_of_report if "promise" in content else _claims_without_promise
        try:
            return claims_of(content, str(path)), content["network"]["name"]
        except (KeyError, TypeError) as error:
            raise DataError(
                f"{path}: the certificate lacks {error}; camnet certify --out writes one"
            ) from error
    if not isinstance(content, dict) or not set(content) <= _KEYS:
        unknown = sorted(set(content) - _KEYS) if isinstance(content, dict) else "no object"
        raise DataError(f"{path}: {unknown}: a promise has the keys {', '.join(sorted(_KEYS))}")
    claims = Claims(
        unseen_max_m=_number(path, content, "unseen_max_m"),
        unseen_max_s=_number(path, content, "unseen_max_s"),
        error=_error(path, content.get("error")),
        targets_at_once=_whole(path, content, "targets_at_once"),
        into_first_view=bool(content.get("into_first_view", True)),
        after_laps=_whole(path, content, "after_laps") or 0,
        after_s=_number(path, content, "after_s") or 0.0,
        error_after_laps=_whole(path, content, "error_after_laps") or 0,
        source=str(path),
    )
    return claims, content.get("world")


def _error(path: Path, content: Any) -> ErrorBound | None:  # noqa: ANN401 - read from a file
    if content is None:
        return None
    if not isinstance(content, dict) or not content or not set(content) <= _ERROR_KEYS:
        raise DataError(f"{path}: error = {content!r}: give some of {', '.join(sorted(_ERROR_KEYS))}")
    values = {key: _number(path, content, key) for key in content}
    if "max_m" not in content:
        return ErrorBound(values.get("initial_m") or 0.0, values.get("growth_mps") or 0.0)
    grows = "initial_m" in content or "growth_mps" in content
    initial = (values.get("initial_m") or 0.0) if grows else math.inf
    return ErrorBound(initial, values.get("growth_mps") or 0.0, values["max_m"] or 0.0)


def _number(path: Path, content: dict[str, Any], key: str) -> float | None:
    value = content.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
        raise DataError(f"{path}: {key} = {value!r}: a number from 0 on was expected")
    return float(value)


def _whole(path: Path, content: dict[str, Any], key: str) -> int | None:
    value = content.get(key)
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 0):
        raise DataError(f"{path}: {key} = {value!r}: a whole number from 0 on was expected")
    return value

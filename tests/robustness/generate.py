"""Draws cases: of every kind, in fixed shares of their natures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from random import Random

from robustness import archive_cases, csv_cases, gpx_cases, kept_cases, krtd_cases, sumo_cases, yaml_cases
from robustness.case import Case, Nature
from robustness.stage import Stage

__all__ = ["KINDS", "SHARES", "draw"]

#: shares of the natures of all cases
SHARES = {Nature.MEANING: 0.55, Nature.HARMLESS: 0.27, Nature.BROKEN: 0.18}
#: shares of the kinds; those that take long are fewer
KINDS = {
    "yaml": 0.24,
    "csv": 0.16,
    "sumo": 0.16,
    "krtd": 0.14,
    "gpx": 0.1,
    "model": 0.08,
    "policy": 0.05,
    "run folder": 0.03,
    "resume": 0.04,
}
_TEXTS = {"yaml": yaml_cases, "csv": csv_cases, "gpx": gpx_cases, "krtd": krtd_cases, "sumo": sumo_cases}


def draw(stage: Stage, seed: int, count: int, kinds: Sequence[str] = ()) -> Iterator[Case]:
    """Yield ``count`` cases, of the named kinds if any are named; the same seed gives the same ones."""
    shares = {kind: share for kind, share in KINDS.items() if not kinds or kind in kinds}
    rng = Random(seed)
    pool: dict[tuple[str, Nature], list[Callable[[Random], Case]]] = {}
    for kind, module in _TEXTS.items():
        for nature, makers in ((Nature.MEANING, module.MEANING), (Nature.BROKEN, module.BROKEN),
                               (Nature.HARMLESS, module.HARMLESS)):  # fmt: skip
            pool[kind, nature] = list(makers)
    saved = any(name.endswith(".npz") for name in stage.files)
    for kind, nature, maker in (
        [] if not saved else [*archive_cases.generators(stage), *kept_cases.generators(stage)]
    ):
        pool.setdefault((kind, nature), []).append(maker)
    for _ in range(count):
        kind = rng.choices(list(shares), list(shares.values()))[0]
        nature = rng.choices(list(SHARES), list(SHARES.values()))[0]
        yield rng.choice(pool[kind, nature])(Random(rng.getrandbits(64)))

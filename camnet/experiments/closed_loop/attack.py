"""Attack a promise in the closed loop, report the worst that was found, and replay it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from camnet.config.models import Scenario
from camnet.errors import CertificateError, ConfigError, DataError
from camnet.experiments.closed_loop.arena import check_attackable, violated, with_targets
from camnet.experiments.closed_loop.claims import Claims
from camnet.experiments.closed_loop.flight import fly
from camnet.experiments.closed_loop.flight_batch import can_fly_together, fly_together
from camnet.experiments.closed_loop.judge import Outcome, judge
from camnet.experiments.closed_loop.plan import Plan, PlanSpace
from camnet.experiments.closed_loop.search import ONE_BY_ONE, TOGETHER, Found, search_plans
from camnet.processes.place import LOCAL, Place, in_order
from camnet.simulation.network import Network, build_network

__all__ = ["Attack", "falsify_closed_loop", "prepare", "read_attack", "replay"]

_KIND = "camnet closed-loop attack"
#: flights that one worker of a cluster flies together
_AT_ONCE = 16


@dataclass(frozen=True, eq=False)
class Attack:
    """A promise and the world that it is attacked in.

    Attributes
    ----------
    scenario : the world flown
    claims : the promise
    estimator : what drives the agents and is judged; None where only fixed cameras look and no estimate is judged
    violate : assumptions falsified on request, with factors
    stop_s : longest stop of the class, s
    """

    scenario: Scenario
    claims: Claims
    estimator: str | None
    violate: Mapping[str, float]
    stop_s: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the targets."""
        return tuple(target.name for target in self.scenario.targets)


def prepare(
    scenario: Scenario,
    claims: Claims,
    violate: Mapping[str, float],
    targets: int | None = None,
    stop_s: float = 0.0,
    estimator: str | None = None,
) -> Attack:
    """Make ready to attack; ``violate`` are assumptions to falsify, see `camnet.experiments.closed_loop.arena`.

    Raises
    ------
    CertificateError
        Nothing is promised.
    ConfigError
        More targets than the promise speaks of, or a world in which nobody can be hostile.
    """
    check_attackable(scenario)
    if claims.empty:
        raise CertificateError(
            f"world {scenario.name!r}: {claims.source} promises nothing, so nothing can be broken; certify it first "
            "(agents need --learn or --model FILE), or give --promise FILE"
        )
    count = _count(scenario, claims, targets)
    flown = violated(with_targets(scenario, count), violate)
    if "promise" in violate:
        claims = claims.scaled(violate["promise"])
    flies = bool(scenario.agents) or claims.error is not None or claims.after_laps > 0
    driver = estimator or scenario.run.estimators[0]
    return Attack(flown, claims, driver if flies else None, dict(violate), stop_s)


def _count(scenario: Scenario, claims: Claims, targets: int | None) -> int:
    most = claims.targets_at_once
    if targets is not None and most is not None and targets > most:
        raise ConfigError(
            f"--targets {targets}: {claims.source} speaks of {most} at the same time; more prove nothing about it"
        )
    own = len(scenario.targets) if most is None else min(len(scenario.targets), most)
    return own if targets is None else targets


@lru_cache(maxsize=2)
def _network(content: str) -> Network:
    """Build a world once in each process."""
    return build_network(Scenario.model_validate_json(content))


def _fly_one(content: str, claims: Claims, estimator: str | None, plan: Plan) -> Outcome:
    network = _network(content)
    return judge(fly(network, plan, estimator), claims, *_names(network))


def back_end(attack: Attack) -> str:
    """Return what flies an attack: ``batch`` where that has all it needs, else ``one by one``."""
    network = _network(attack.scenario.model_dump_json())
    return "batch" if can_fly_together(network, attack.estimator) else "one by one"


def _fly_together(
    content: str, claims: Claims, estimator: str | None, plans: Sequence[Plan], threads: int
) -> list[Outcome]:
    network = _network(content)
    names = _names(network)
    return [judge(log, claims, *names) for log in fly_together(network, plans, estimator, threads)]


def _names(network: Network) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of targets and regions."""
    scenario = network.scenario
    return tuple(t.name for t in scenario.targets), tuple(r.name for r in scenario.regions)


def replay(attack: Attack, plan: Plan) -> Outcome:
    """Fly one plan on the back end that the search used; equal plans and worlds give equal figures."""
    content = attack.scenario.model_dump_json()
    if back_end(attack) == "batch":
        return _fly_together(content, attack.claims, attack.estimator, [plan], 1)[0]
    return _fly_one(content, attack.claims, attack.estimator, plan)


def falsify_closed_loop(
    attack: Attack,
    trials: int,
    seed: int,
    *,
    jobs: int = 1,
    place: Place = LOCAL,
    time_limit_s: float | None = None,
    stop_when_broken: bool = True,
    progress: Callable[[Found], None] | None = None,
) -> dict[str, Any]:
    """Search for the flight that takes most of the promise.

    Returns
    -------
    dict
        ``violations`` of ``trials`` flown, ``worst`` by figure with its margin, ``closest_fraction``, ``tightness``,
        ``assumptions`` with the one ``nearest_to_breaking``, and ``attack``, which `replay` flies again.
    """
    pace = attack.violate.get("speed", 1.0)
    space = PlanSpace(len(attack.names), attack.scenario.run.duration_s, attack.stop_s, pace)
    ends = None if time_limit_s is None else monotonic() + time_limit_s
    content = attack.scenario.model_dump_json()
    one = partial(_fly_one, content, attack.claims, attack.estimator)
    together = back_end(attack) == "batch"

    def flights(plans: Sequence[Plan]) -> list[Outcome | None]:
        if together and place == LOCAL:
            return list(_fly_together(content, attack.claims, attack.estimator, plans, jobs))
        if together:
            fly_some = partial(_fly_together, content, attack.claims, attack.estimator, threads=1)
            some = [plans[k : k + _AT_ONCE] for k in range(0, len(plans), _AT_ONCE)]
            with place.workers(jobs) as workers:
                return [outcome for part in in_order(workers, fly_some, some, None) for outcome in part]
        out: list[Outcome | None] = [None] * len(plans)
        with place.workers(jobs) as workers:
            for k, outcome in workers.finished(one, plans):
                out[k] = outcome
                if ends is not None and monotonic() >= ends:
                    break
                first = _first_broken(out) if stop_when_broken else None
                if first is not None:
                    return [*out[: first + 1], *[None] * (len(plans) - first - 1)]
        return out

    found = search_plans(
        space,
        flights,
        trials,
        np.random.default_rng(seed),
        at_a_time=TOGETHER if together else ONE_BY_ONE,
        time_limit_s=time_limit_s,
        stop_when_broken=stop_when_broken,
        progress=progress,
    )
    return _report(attack, found, trials, seed)


def _first_broken(outcomes: Sequence[Outcome | None]) -> int | None:
    """Return the first flight that broke the promise once all before it have ended, whatever the number of jobs."""
    for k, outcome in enumerate(outcomes):
        if outcome is None:
            return None
        if outcome.broken:
            return k
    return None


def _report(attack: Attack, found: Found, trials: int, seed: int) -> dict[str, Any]:
    shares = [w["share"] for w in found.worst.values() if w["share"] is not None]
    closest = max(shares, default=None)
    used = {name: share for name, share in found.use.items() if share > 0.0}
    nearest = max(used, key=lambda name: used[name], default=None)
    return {
        "promise": attack.claims.as_dict(),
        "violate": dict(attack.violate),
        "targets": list(attack.names),
        "back_end": back_end(attack),
        "trials": found.flown,
        "trials_asked": trials,
        "out_of_time": found.out_of_time,
        "violations": found.violations,
        "broken": [] if found.outcome is None else list(found.outcome.broken),
        "stretches": found.stretches,
        "gaps_judged": found.gaps,
        "closest_fraction": closest,
        "tightness": None if not closest else 1.0 / closest,
        "worst": found.worst,
        "assumptions": found.use,
        "nearest_to_breaking": nearest,
        "attack": None if found.plan is None or found.outcome is None else _record(attack, found, seed),
    }


def _record(attack: Attack, found: Found, seed: int) -> dict[str, Any]:
    assert found.plan is not None
    assert found.outcome is not None
    return {
        "kind": _KIND,
        "world": attack.scenario.name,
        "search_seed": seed,
        "config": attack.scenario.model_dump(mode="json"),
        "promise": attack.claims.as_dict(),
        "estimator": attack.estimator,
        "violate": dict(attack.violate),
        "stop_s": attack.stop_s,
        "plan": found.plan.as_dict(),
        "figures": found.outcome.as_dict(),
    }


def read_attack(path: Path) -> tuple[Attack, Plan, dict[str, Any]]:
    """Read the attack that a search wrote: the world, the plan, and the figures that it reached.

    Raises
    ------
    DataError
        The file cannot be read or holds something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(content, dict) and "attack" in content:
            content = content["attack"]
        if content["kind"] != _KIND:
            raise DataError(f"{path}: kind = {content['kind']!r}: {_KIND!r} was expected")
        scenario = Scenario.model_validate(content["config"])
        claims = Claims.from_dict(content["promise"])
        attack = Attack(scenario, claims, content["estimator"], content["violate"], float(content["stop_s"]))
        return attack, Plan.from_dict(content["plan"]), content["figures"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: is no attack that camnet falsify --closed-loop wrote: {error!r}") from error

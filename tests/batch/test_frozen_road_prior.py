"""The prior along roads of held models: without anything learned it is that of the class, step for step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from camnet.batch.frozen_model import FrozenModel, frozen_state, tabulate
from camnet.batch.frozen_motion import Frozen, midpoint
from camnet.config.load import load_scenario
from camnet.env.batch_handoff import BatchHandoff
from camnet.estimation.propagate import PRIORS, advance, roll_out
from camnet.estimation.road_prior import offset_of
from camnet.geometry.rotations import from_yaw
from camnet.simulation.network import Network, build_network

OVERRIDES = ["estimator.gap.prior=road"]


def _network() -> tuple[Network, FrozenModel]:
    """Quickstart, and a model that knows nothing."""
    network = build_network(load_scenario("quickstart", OVERRIDES))
    models = len(network.regions)
    empty = FrozenModel(
        network.basis,
        np.zeros((models, network.basis.size, 8)),
        np.arange(models)[None],
        np.full(models, 1e-4),
        np.zeros((models, 9)),
    )
    return network, empty


@njit
def _rolled(f: Frozen, p: Any, pv: Any, pw: Any, dt: float, offset: float, count: int) -> Any:
    out = np.empty((count, 3))
    fade, share = np.exp(-dt / f.turn_memory_s), -np.expm1(-dt / f.handover_s)
    for i in range(count):
        p, _, _, pv, pw = midpoint(f, 0, p, pv, pw, dt, fade, share, offset)
        out[i, 0], out[i, 1], out[i, 2] = p
    return out


def _empty_roll_out(network: Network, f: Frozen, p: Any, q: Any, prior: Any, dt: float, offset: float) -> Any:
    basis = network.basis
    return roll_out(
        p, q, prior, dt, 400, 1, PRIORS["road"], f.turn_memory_s, f.handover_s, False, np.zeros((basis.size, 8)),
        basis.centres, basis.precision, 1.0, f.low, f.high, offset, f.roads,
    )[0]  # fmt: skip


@pytest.mark.parametrize("start", [(2.9, 2.8, 2.2), (0.0, 0.0, 0.5)], ids=["on the road", "towards it"])
def test_a_step_is_that_of_the_class(start: tuple[float, float, float]) -> None:
    network, empty = _network()
    f = frozen_state(network, empty, *tabulate(empty, network.bounds), 1)
    yaw, speed = start[2], 0.35
    p, q = np.array([*start[:2], 0.1]), from_yaw(yaw)
    prior = np.array([speed * np.cos(yaw), speed * np.sin(yaw), 0.0, 0.0, 0.0, 0.05])
    offset = offset_of(p[0], p[1], prior[0], prior[1], f.roads)
    wanted = _empty_roll_out(network, f, p, q, prior, 0.1, offset)
    found = _rolled(
        f, tuple(p.tolist()), tuple(prior[:3].tolist()), tuple(prior[3:].tolist()), 0.1, offset, 400
    )
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9)
    nearest = np.hypot(*(network.basis.centres - found[-1, :2]).T).min()
    assert nearest < 0.7


@pytest.mark.slow
def test_an_unseen_target_is_carried_along_the_road() -> None:
    """From one decision to the next while unseen, in the loop, against `advance` of the class."""
    network, empty = _network()
    env = BatchHandoff("quickstart", 2, overrides=OVERRIDES, filter_name="frozen", threads=1, model=empty)
    env.reset(seed=3)
    group = env.simulation.groups[0]
    f, basis, compared, twist = group.estimators.rows, network.basis, 0, np.zeros(6)
    before, was_unseen = f.pose[0, 0].copy(), False
    for _ in range(900):
        env.step(np.zeros((2, env.n_agents, 5)))
        now, unseen = f.pose[0, 0].copy(), not group.state.estimate[0, 0, 13] > 0.0
        if unseen and was_unseen:
            prior = before[8:14].copy()
            steps = round((now[0] - before[0]) * 30.0)
            p, _, _ = advance(
                before[1:4].copy(), before[4:8].copy(), prior, now[0] - before[0], steps, PRIORS["road"],
                f.turn_memory_s, f.handover_s, False, np.zeros((basis.size, 8)), basis.centres, basis.precision,
                1.0, f.low, f.high, twist, now[14], f.roads,
            )  # fmt: skip
            # the class turns about the estimated body axis, tilted by the measured noise
            np.testing.assert_allclose(now[1:4], p, atol=2e-4)
            compared += 1
        before, was_unseen = now, unseen
    env.close()
    assert compared > 50
    assert abs(before[14]) > 0.0

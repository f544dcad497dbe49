"""The motion of held models while unseen: that of the class, whose steps have to be shorter for the same error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from camnet.batch.frozen_model import FrozenModel, frozen_state, tabulate, warm_up
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
    fade, share = np.exp(-0.5 * dt / f.turn_memory_s), -np.expm1(-dt / f.handover_s)
    for i in range(count):
        p, _, _, pv, pw = midpoint(f, 0, p, pv, pw, dt, fade, share, offset)
        out[i, 0], out[i, 1], out[i, 2] = p
    return out


def _class_roll_out(
    network: Network,
    f: Frozen,
    weights: Any,
    p: Any,
    q: Any,
    prior: Any,
    dt: float,
    offset: float,
    substeps: int,
) -> Any:
    basis = network.basis
    return roll_out(
        p, q, prior, dt, 80, substeps, f.prior, f.turn_memory_s, f.handover_s, False, weights,
        basis.centres, basis.precision, 1.0, f.low, f.high, offset, f.roads,
    )[0]  # fmt: skip


def _start(f: Frozen, x: float, y: float, yaw: float, speed: float = 0.35) -> tuple[Any, Any, Any, float]:
    prior = np.array([speed * np.cos(yaw), speed * np.sin(yaw), 0.0, 0.0, 0.0, 0.05])
    return np.array([x, y, 0.1]), from_yaw(yaw), prior, offset_of(x, y, prior[0], prior[1], f.roads)


@pytest.mark.parametrize("start", [(2.9, 2.8, 2.2), (0.0, 0.0, 0.5)], ids=["on the road", "towards it"])
def test_it_goes_where_the_class_goes_in_short_steps(start: tuple[float, float, float]) -> None:
    network, empty = _network()
    f = frozen_state(network, empty, *tabulate(empty, network.bounds), 1)
    p, q, prior, offset = _start(f, *start)
    wanted = _class_roll_out(network, f, empty.weights[0], p, q, prior, 0.5, offset, 1000)
    found = _rolled(f, tuple(p), tuple(prior[:3]), tuple(prior[3:]), 0.01, offset, 4000)[49::50]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=2e-3)
    nearest = np.hypot(*(network.basis.centres - found[-1, :2]).T).min()
    assert nearest < 0.7


def test_half_the_step_leaves_a_quarter_of_the_error() -> None:
    """Learned motion and prior at once, on a road: both of second order, the class's prior of first."""
    network, _ = _network()
    held = warm_up(network, 60.0)
    f = frozen_state(network, held, *tabulate(held, network.bounds), 1)
    errors = np.zeros(3)  # at steps of 0.8 s and 0.4 s, and the class's at 0.2 s
    for k in range(12):
        x, y = network.scenario.roads[0].points_m[k]
        p, q, prior, offset = _start(f, x, y, np.arctan2(y, x) + 0.5 * np.pi)
        coarse, fine, exact = (
            _rolled(f, tuple(p), tuple(prior[:3]), tuple(prior[3:]), dt, offset, round(16.0 / dt))[-1]
            for dt in (0.8, 0.4, 0.01)
        )
        of_class = _class_roll_out(network, f, held.weights[0], p, q, prior, 0.2, offset, 1)[-1]
        errors += [np.linalg.norm(end - exact) for end in (coarse, fine, of_class)]
    assert 3.0 < errors[0] / errors[1] < 5.5
    assert errors[1] < 0.5 * errors[2]


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

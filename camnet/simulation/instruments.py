r"""Quantities of the Lyapunov analysis along a run, logged on request (``run.instruments``).

| symbol | column | unit | meaning |
| --- | --- | --- | --- |
| V = 1/2 norm(eta_til)^2 + 1/2 tr(W_til^T Gamma^-1 W_til) | ``V`` | | harris2020 (3-25), (4-28) |
| 1/2 norm(eta_til)^2 | ``V_pose`` | | its part of the pose, eta = (p, q) |
| norm(W_hat) | ``W_hat`` | | Frobenius norm of the weights in force |
| lambda_min(Psi) | ``psi_min_s2`` | s^2 | of the history stack, (3-19) |
| | ``psi_min_visited_s2`` | s^2 | over the kernels that data has reached |
| sigma^f, sigma^d, sigma^h | ``sigma_f``, ``sigma_d``, ``sigma_h`` | 0, 1 | feedback; excited; excited before |

All are of the estimator in charge, and of the model in force. The ideal weights W of W_til = W - W_hat are not known to
anybody; those that the run ends with stand for them, so V is filled in when the run is over, and says how the estimate
came to where it ended.
"""

from __future__ import annotations

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.delayed import underlying
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.simulation.log import RunLog
from camnet.simulation.log_columns import INSTRUMENT_WORDS
from camnet.simulation.loop import NetworkSimulation
from camnet.types import Array

__all__ = ["INSTRUMENTS", "Instruments"]

#: what is logged of a target
INSTRUMENTS = tuple(INSTRUMENT_WORDS)


class Instruments:
    """Reads the quantities off a running simulation.

    Raises
    ------
    ConfigError
        The estimator in charge does not learn so.
    """

    def __init__(self, simulation: NetworkSimulation) -> None:
        self._simulation = simulation
        learners = [underlying(f) for f in simulation.driving]
        self._learners = [one for one in learners if isinstance(one, LearningEstimator)]
        if not learners or len(self._learners) < len(learners):
            raise ConfigError(
                f"run.instruments: the estimator in charge, {simulation.filter_names[0]!r}, has no history stack; put "
                "'learned', 'learned_shared' or 'printed' first in run.estimators"
            )
        self._gamma = simulation.network.scenario.estimator.gamma
        self._weights: list[list[tuple[int, Array]]] = [[] for _ in self._learners]

    def row(self, m: int) -> list[float]:
        """Return the present figures of target ``m``; V is not known yet."""
        s, learner = self._simulation, self._learners[m]
        estimate = learner.estimate
        f, d, h = s.statistics.dwell[m].signals
        if estimate.region < 0:
            self._weights[m].append((-1, np.zeros((0, 0))))
            return [np.nan] * 5 + [float(x) for x in (f, d, h)]
        error = estimate.p_world - s.snapshot.target_p_world[m]
        q, true_q = estimate.q_world, s.snapshot.target_q_world[m]
        turn = q - true_q if float(q @ true_q) >= 0.0 else q + true_q
        found = learner.model_diagnostics(estimate.region)
        self._weights[m].append(
            (learner.model_number(estimate.region), learner.law_weights(estimate.region).copy())
        )
        return [
            np.nan,
            0.5 * float(error @ error + turn @ turn),
            learner.weight_norm(estimate.region),
            found["lambda_min"],
            found["lambda_min_visited"],
            *(float(x) for x in (f, d, h)),
        ]

    def finish(self, log: RunLog) -> None:
        """Fill in V, now that the weights that the run ends with are known."""
        for m, name in enumerate(self._simulation.world.target_names):
            learner, values = self._learners[m], log.values
            of = log.columns.index(f"{name}.V")
            last: dict[int, Array] = {}
            for region in range(len(self._simulation.network.regions)):
                last[learner.model_number(region)] = learner.law_weights(region)
            for k, (j, weights) in enumerate(self._weights[m]):
                if j >= 0:
                    apart = last[j] - weights
                    values[k, of] = values[k, of + 1] + 0.5 * float((apart**2).sum()) / self._gamma

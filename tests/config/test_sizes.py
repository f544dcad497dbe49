from __future__ import annotations

from camnet.config import load_scenario, shipped_worlds
from camnet.config.check_sizes import _log_columns, size_problems
from camnet.simulation.log_columns import columns_of


def test_columns_are_those_of_the_recorder_and_shipped_worlds_are_far_from_the_limits():
    for name in shipped_worlds():
        scenario = load_scenario(name)
        written = columns_of(scenario, scenario.run.estimators)
        assert _log_columns(scenario) == len(written)
        run = scenario.run.model_copy(update={"duration_s": 10 * scenario.run.duration_s})
        assert not list(size_problems(scenario.model_copy(update={"run": run})))

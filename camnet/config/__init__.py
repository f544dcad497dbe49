"""Strict YAML to frozen settings: worlds and recipes.

``load_scenario`` is the entry. A file is parsed with the line of every value (``yaml_nodes``), merged over the world
it names and overridden (``merge``), validated (``models``, ``recorded``; messages from ``diagnose``), and checked for
what types cannot say (``check``). Read ``load`` next.
"""

from camnet.config.load import dump_scenario, load_scenario, shipped_worlds
from camnet.config.models import Scenario
from camnet.config.recorded import RecordedScenario

__all__ = ["RecordedScenario", "Scenario", "dump_scenario", "load_scenario", "shipped_worlds"]

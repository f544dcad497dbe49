"""Constants, dwell times and verdicts: how long a target may stay unseen, and which networks keep it.

Three certificates stand side by side: ``published`` (harris2020 to the letter), ``sound`` (the same argument with its
defects repaired) and ``learned`` (error growth of the learned model). Derivations: docs/theory.md.

| to read | for |
| --- | --- |
| ``constants``, ``dwell``, ``average_dwell``, ``bell_dwell`` | the papers' formulas |
| ``verdict`` | Theorem 3.1 and why disjoint views cannot meet it |
| ``network``, ``monitor`` | the dwell-time report of a network, and what happened in a run |
| ``growth``, ``growth_kernel``, ``model_error`` | the sharp growth law and its e_v |
| ``reachable``, ``crossing``, ``flow_network`` | target classes, one exit, all exits of a learned flow |
| ``road_arcs``, ``coverage``, ``road_gaps``, ``transitions`` | road-bound targets, at the scale of a city |
| ``free_network``, ``site`` | open sites; whole sites in one call |
| ``design``, ``repairs`` | the fewest cameras, the smallest repairs |
| ``benchmark`` | how the cost grows |
"""

"""Constants, dwell times and verdicts: how long a target may stay unseen, and which networks keep it.

Start with ``constants`` (the bounds that the proofs share), then ``dwell`` (how long), ``verdict`` (Theorem 3.1
of harris2020 and why disjoint views cannot meet it), ``monitor`` (what happened in a run) and ``network``
(one report for one network). Two certificates stand side by side everywhere: ``published``, the equations of
harris2020 to the letter, and ``sound``, the same argument with its defects repaired.
"""

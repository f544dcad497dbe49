"""Generated inputs, hostile and harmless, and what the program must answer to each.

`case` says what a case is, `stage` makes the valid inputs that cases start from, a module for each kind of input turns
them into cases (``yaml_cases`` and so on), `runner` runs them in forked processes, and `judge` compares what happened
with what was expected. ``scripts/robustness.py`` puts them together.
"""

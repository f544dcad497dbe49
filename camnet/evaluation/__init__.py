"""Scores of agents on worlds: episodes played on common seeds, confidence intervals, paired comparisons, tables."""

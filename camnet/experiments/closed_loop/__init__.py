"""Falsification in the closed loop: the whole system flies against hostile targets, and only the truth is judged."""

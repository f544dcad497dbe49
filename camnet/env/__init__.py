"""The PettingZoo environment of the handoff problem and its metrics."""

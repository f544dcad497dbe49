"""The closed loop: world, sensing, estimation, handoff and control, and the log of a run."""

"""Estimators and predictors of a target's pose, and the motion model they learn."""

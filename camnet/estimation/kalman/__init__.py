"""Kalman, extended and unscented Kalman filters with fixed-lag smoothing, for linear and steering models."""

from camnet.estimation.kalman.filters import ExtendedKalmanFilter, KalmanFilter, UnscentedKalmanFilter
from camnet.estimation.kalman.models import LinearModel, constant_acceleration, constant_velocity

__all__ = [
    "ExtendedKalmanFilter",
    "KalmanFilter",
    "LinearModel",
    "UnscentedKalmanFilter",
    "constant_acceleration",
    "constant_velocity",
]

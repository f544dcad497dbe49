"""Settings of the predictors across gaps. The defaults are the best of the comparison on recorded pedestrians."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["CrossingSettings", "FixFilterSettings", "FlowSettings"]


class FixFilterSettings(Settings):
    """Constant-velocity Kalman filter of position fixes about ten seconds apart.

    The defaults are near the maximum of the likelihood of walking people's GPS fixes (innovations over at most a
    minute); between 0.001 and 0.1 m^2/s^3 and 1 and 5 m its median error across gaps changes by a tenth.
    """

    accel_psd_m2ps3: Positive = 0.01
    position_noise_m: Positive = 2.0
    first_speed_std_mps: Positive = 1.4


class FlowSettings(Settings):
    """Concurrent-learning flow field: velocity as a function of position and heading.

    ``learn_across``: integral windows from the paths reconstructed across gaps, not only from seen motion.
    ``prior``: where there is no data, the exit velocity that fades with ``prior_memory_s``; without it, nothing.
    """

    spacing_m: Positive = 20.0
    width_m: Positive = 15.0
    headings: Annotated[int, Field(gt=0, le=360)] = 4
    window_s: Positive = 30.0
    regularisation: Positive = 30.0
    step_s: Positive = 5.0
    refit_after: Annotated[int, Field(gt=0, le=1_000_000)] = 100
    learn_across: bool = True
    prior: bool = True
    prior_memory_s: Positive = 20.0


class CrossingSettings(Settings):
    """The predictor taught by everybody's crossings.

    What makes two exits alike (each scale is the difference that counts 1 in the squared distance):
    ``position_scale_m``, ``velocity_scale_mps``, ``log_time_scale`` (of the logarithm of the elapsed time); a lesson
    of the same target is nearer by ``same_target_bonus``, one of the same hour by ``recency_bonus``, fading with
    ``recency_s``.

    How lessons vote: the ``neighbours`` nearest; the weight falls by e where the squared distance exceeds the nearest
    one's by that of neighbour number ``bandwidth_rank``, at least by ``bandwidth_floor``. A vote is the lesson's entry,
    moved by the share ``carry`` of the difference between the two exits.

    ``learn_reversed``: people walk both ways, so a crossing backwards is a lesson too (farther by
    ``reversed_penalty``). ``learn_extended``: so is the one from a fix earlier, or to a fix later.

    ``prior_distance``: the exit velocity, fading with ``prior_memory_s``, votes as if it were a lesson that much
    farther than the nearest; None: only where there is no lesson yet.

    ``location``: ``mode`` is the place with most votes within about ``mode_width_m`` (least median error),
    ``geometric_median`` has the least mean distance to the votes, ``mean`` the least mean square.

    ``information``: ``exit`` uses what was known when the target left view; ``now`` also what others taught since.
    """

    neighbours: Annotated[int, Field(gt=0, le=100_000)] = 50
    position_scale_m: Positive = 7.0
    velocity_scale_mps: Positive = 1.1
    log_time_scale: Positive = 0.45
    same_target_bonus: NonNegative = 1.5
    recency_bonus: NonNegative = 1.0
    recency_s: Positive = 7200.0
    bandwidth_rank: Annotated[int, Field(gt=0, le=100_000)] = 3
    bandwidth_floor: Positive = 1.0
    carry: Fraction = 0.5
    learn_reversed: bool = True
    reversed_penalty: NonNegative = 0.6
    learn_extended: bool = True
    extended_penalty: NonNegative = 1.0
    prior_distance: NonNegative | None = 0.5
    prior_memory_s: Positive = 20.0
    location: Literal["mode", "geometric_median", "mean"] = "mode"
    mode_width_m: Positive = 20.0
    information: Literal["exit", "now"] = "exit"
    coverage: Annotated[float, Field(gt=0, lt=1)] = 0.9
    calibration_size: Annotated[int, Field(gt=0, le=1_000_000)] = 300
    velocity_window_s: Positive = 60.0
    filter: FixFilterSettings = FixFilterSettings()
    flow: FlowSettings = FlowSettings()

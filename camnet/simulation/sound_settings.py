"""What the proof of ``sound`` takes from a world's settings, and the settings that it does not cover.

Refused by name: whatever moves the estimate or the weights otherwise than by the law that is analysed. Bounds of the
measurements' errors are those that the world states, five standard deviations on every axis at the level ``pose``.
"""

from __future__ import annotations

import math

from camnet.certification.constants import lattice_slope
from camnet.certification.sampled import Sampling
from camnet.simulation.network import Network

__all__ = ["sampling_of", "settings_outside"]

#: standard deviations, on each of three axes, that the error of a measured pose is taken to stay within
_DEVIATIONS = 5.0 * math.sqrt(3.0)


def sampling_of(network: Network) -> Sampling:
    """Return how a world's estimator is sampled and disturbed."""
    scenario = network.scenario
    estimator, sensing, stated = scenario.estimator, scenario.sensing, scenario.certificate
    position, orientation = stated.position_error_m, stated.orientation_error_rad
    return Sampling(
        period_s=1.0 / sensing.rate_hz,
        slope=lattice_slope(estimator.basis.spacing_m, estimator.basis.width_m),
        position_noise_m=_DEVIATIONS * sensing.position_noise_m if position is None else position,
        orientation_noise_rad=min(
            math.pi, _DEVIATIONS * sensing.orientation_noise_rad if orientation is None else orientation
        ),
        leakage=estimator.leakage,
        switching_gain=estimator.k2,
        average=estimator.stack.average,
    )


def settings_outside(network: Network) -> tuple[str, ...]:
    """Return the settings that the proof of ``sound`` does not cover, each with the reason and what would be right."""
    estimator, sensing, stated = (
        network.scenario.estimator,
        network.scenario.sensing,
        network.scenario.certificate,
    )
    unstated = stated.position_error_m is None or stated.orientation_error_rad is None
    rules = (
        (estimator.form != "twist", f"estimator.form = {estimator.form!r}: the estimate's quaternion has length 1, its "
         "learned rate has not; use twist"),
        (estimator.frame != "world", f"estimator.frame = {estimator.frame!r}: the camera's measured velocity enters "
         "with its noise; use world"),
        (estimator.basis.inputs != "position", f"estimator.basis.inputs = {estimator.basis.inputs!r}: norm(sigma) and "
         "its slope are bounded over places only; use position"),
        (estimator.alpha < 1.0, f"estimator.alpha = {estimator.alpha:g}: regressed rates have no stated bound; use 1"),
        (not estimator.reset_on_sighting, "estimator.reset_on_sighting = false: an orientation error near 180 degrees "
         "may last; use true"),
        (estimator.gap.prior != "none", f"estimator.gap.prior = {estimator.gap.prior!r}: it is blended into the law; "
         "use none"),
        (estimator.gap.pace, "estimator.gap.pace = true: it scales the learned weights; use false"),
        (estimator.gap.learn_across, "estimator.gap.learn_across = true: windows across gaps are reconstructed, not "
         "measured; use false"),
        (estimator.stack.forgetting, "estimator.stack.forgetting = true: weights are scaled when windows are dropped; "
         "use false"),
        (sensing.latency_s > 0.0, f"sensing.latency_s = {sensing.latency_s:g}: measurements are of an earlier time; "
         "use 0"),
        (sensing.dropout_probability > 0.0, f"sensing.dropout_probability = {sensing.dropout_probability:g}: a pose in "
         "view may be missing; use 0"),
        (sensing.level != "pose" and unstated, f"sensing.level = {sensing.level!r}: the error of a measured pose has "
         "no stated bound; state certificate.position_error_m and certificate.orientation_error_rad"),
    )  # fmt: skip
    return tuple(words for outside, words in rules if outside)
